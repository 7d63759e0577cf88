"""A finger small enough to know every number of: a link in the world with a fingertip welded to it."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, Frame, SpatialInertia, WeldJoint
from pydrake.systems.framework import DiagramBuilder

TIP_MASS = 0.02


@dataclasses.dataclass
class Finger:
    builder: DiagramBuilder
    plant: MultibodyPlant
    weld: WeldJoint
    sensor_frame: Frame


def make_finger() -> Finger:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    link = plant.AddRigidBody("link", SpatialInertia.SolidSphereWithMass(0.05, 0.01))
    inertia = SpatialInertia.MakeFromCentralInertia(
        TIP_MASS,
        np.array([1e-3, 2e-3, 8e-3]),
        SpatialInertia.SolidSphereWithMass(TIP_MASS, 0.01).CalcRotationalInertia(),
    )
    tip = plant.AddRigidBody("tip", inertia)
    plant.WeldFrames(
        plant.world_frame(), link.body_frame(), RigidTransform(RollPitchYaw(0.3, 0.8, -1.1), [0.1, 0.0, 0.3])
    )
    sensor_frame = plant.AddFrame(
        FixedOffsetFrame("sensor", link.body_frame(), RigidTransform(RollPitchYaw(0, 0.2, 0.4), [0, 0, 0.01]))
    )
    weld = plant.AddJoint(
        WeldJoint(
            "tip_weld", link.body_frame(), tip.body_frame(), RigidTransform(RollPitchYaw(0.5, 0, 0), [0, 0, 0.02])
        )
    )
    plant.Finalize()
    return Finger(builder, plant, weld, sensor_frame)


@pytest.fixture
def finger() -> Finger:
    return make_finger()


@pytest.fixture
def new_finger() -> Callable[[], Finger]:
    """For tests that need several."""
    return make_finger
