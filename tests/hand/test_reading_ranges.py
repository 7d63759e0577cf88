"""Which readings of joints can be true."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, SpatialInertia

from tactopose_drake.core.geometry_checks import FARTHEST
from tactopose_drake.hand.reading_ranges import ReadingRange, ReadingRanges

LIMITS = {
    "turns": (-0.2, 1.5),
    "turns_freely": (-np.inf, np.inf),
    "slides": (0.0, 0.04),
    "slides_freely": (-np.inf, np.inf),
    "turns_from": (0.1, np.inf),
    "turns_untold": (0.0, 0.0),  # which limits that are left out may be
    "slides_untold": (0.0, 0.0),
}


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    """A joint of each kind, one behind the other, and a body that floats."""
    plant = MultibodyPlant(time_step=0.001)
    parent, inertia = plant.world_frame(), SpatialInertia.SolidSphereWithMass(0.1, 0.01)
    for name, (low, high) in LIMITS.items():
        child, kind = plant.AddRigidBody(name, inertia), PrismaticJoint if "slides" in name else RevoluteJoint
        plant.AddJoint(kind(name, parent, child.body_frame(), [0, 0, 1], low, high))
        parent = child.body_frame()
    plant.AddRigidBody("floats", inertia)
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    ("name", "least", "most", "unit"),
    [
        ("turns", -0.7, 2.0, "rad"),
        ("turns_freely", -np.inf, np.inf, "rad"),
        ("turns_from", -0.4, np.inf, "rad"),
        ("slides", -0.05, 0.09, "m"),
        ("slides_freely", -0.5 * FARTHEST, 0.5 * FARTHEST, "m"),
        ("turns_untold", -np.inf, np.inf, "rad"),
        ("slides_untold", -0.5 * FARTHEST, 0.5 * FARTHEST, "m"),
    ],
)
def test_a_reading_may_be_a_little_beyond_the_limits(
    plant: MultibodyPlant, name: str, least: float, most: float, unit: str
) -> None:
    found = ReadingRange.of(plant.GetJointByName(name))
    assert found == (pytest.approx(least), pytest.approx(most), unit)


def test_what_is_beyond_is_not_told_and_named(plant: MultibodyPlant) -> None:
    ranges, q = ReadingRanges.of(plant), np.full(plant.num_positions(), 100.0)
    place = {name: plant.GetJointByName(name).position_start() for name in LIMITS}
    untold = {place[name] for name in ("turns", "slides", "slides_freely", "slides_untold")}
    np.testing.assert_array_equal(np.flatnonzero(~ranges.told(q)), sorted(untold))  # and what floats may be anywhere
    np.testing.assert_array_equal(np.flatnonzero(~ranges.told(-q)), sorted({*untold, place["turns_from"]}))
    assert not ranges.told(np.full(len(q), np.nan)).any()
    assert ranges.fault(place["slides"], 100.0) == "joint slides reads 100 m, not from -0.05 to 0.09"
    assert ranges.fault(place["turns"], np.nan) == ""
