"""The seven-axis arm and the things around it: what the generators write, and how they behave in Drake."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.errors import UnknownNameError
from tactopose_drake.resources import make_parser, model_path
from tactopose_drake.station.arms.arm import add_arm, load_arm_config, make_arm_plant


def run(path: Path) -> dict[str, Any]:
    """What a generator defines."""
    namespace: dict[str, Any] = {"__name__": "generate", "__file__": str(path)}
    before = list(sys.path)
    exec(compile(path.read_text(), path.name, "exec"), namespace)
    sys.path[:] = before
    return namespace


def test_the_arm_is_what_the_generator_writes() -> None:
    folder = model_path("arms", "seven_axis")
    assert run(folder / "generate.py")["model_text"]() == (folder / "seven_axis.sdf").read_text()


def test_the_scene_is_what_the_generator_writes() -> None:
    folder = model_path("scenes")
    generator = run(folder / "generate.py")
    for name, text in generator["model_files"]().items():
        assert text == (folder / name).read_text(), name


def test_reach_limits_and_inertia() -> None:
    plant, arm = make_arm_plant(load_arm_config("seven_axis"), RigidTransform([0.1, 0.0, 0.0]))
    context = plant.CreateDefaultContext()
    X_WF = arm.flange.CalcPoseInWorld(context)
    np.testing.assert_allclose(X_WF.translation(), [0.1, 0.0, 0.34 + 0.42 + 0.40 + 0.12], atol=1e-12)
    assert plant.num_positions() == plant.num_actuators() == 7
    assert np.all(plant.GetEffortUpperLimits() > 0.0)
    assert np.all(np.isfinite(plant.GetVelocityUpperLimits()))
    assert np.all(plant.GetPositionUpperLimits() == -plant.GetPositionLowerLimits())
    for index in plant.GetBodyIndices(arm.model_instance):
        assert plant.get_body(index).default_spatial_inertia().IsPhysicallyValid()
    # The motors hold the arm, stretched out level with 10 kg at its end, with a third of their efforts to spare.
    plant.SetPositions(context, [0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    torque = plant.CalcGravityGeneralizedForces(context)
    J = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, arm.flange, np.zeros((3, 1)), plant.world_frame(), plant.world_frame()
    )
    needed = np.abs(torque + J.T @ [0.0, 0.0, -98.1])
    assert np.all(needed < plant.GetEffortUpperLimits() / 1.33)


def test_the_hole_takes_a_ball_of_its_radius_and_no_larger_one() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.001), builder)
    (box,) = make_parser(plant).AddModels(url="package://tactopose_drake/models/scenes/hole_box.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("hole_box", box))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))

    def clearance(point: list[float]) -> float:
        return min(found.distance for found in query.ComputeSignedDistanceToPoint(np.array(point)))

    assert clearance([0.0, 0.0, 0.097]) == pytest.approx(0.015, abs=1e-6)
    # Nowhere along a circle a little outside is there a gap in the lid.
    for angle in np.linspace(0.0, 2 * np.pi, 100):
        for radius in (0.0155, 0.03, 0.045):
            assert clearance([radius * np.cos(angle), radius * np.sin(angle), 0.097]) < 0.0


def test_an_arm_without_its_flange_is_refused() -> None:
    config = load_arm_config("seven_axis")
    config.flange_frame = "hook"
    with pytest.raises(UnknownNameError, match="hook"):
        add_arm(MultibodyPlant(time_step=0.0), config, RigidTransform())
