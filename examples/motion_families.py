"""Four families of motions of an object in the hand, caused by the fingertips.

A screwdriver is rotated about its axis, a cylinder is rolled between thumb and fingers, objects are moved by the
fingertips, and objects slip under load. Each family draws an object, its contacts, and its motion, step by step.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

import tactopose_drake as tp
from tactopose_drake.core.synthetic import RollingTouch
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]
PERIOD = 0.01  # of a step, s
CARRIED = ("bust", "mug", "spray_bottle", "tea_box", "light_bulb")


@dataclasses.dataclass(frozen=True)
class Step:
    """The motion in one period: the object's twist in P, the fingertips' angular velocities, and whether they slide."""

    twist: Array
    tip_turn: Array
    slides: bool = False


Motion = tuple[tp.ObjectModel, Array, Callable[[RollingTouch], Iterator[Step]]]


@functools.cache
def load(name: str) -> tp.ObjectModel:
    """An object of the package, loaded once."""
    return tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))


def about(point: Array, axis: Array, rate: float, speed: Array | float = 0.0) -> Array:
    """The twist at P's origin of a rotation about an axis through a point, rad/s, plus a translation, m/s."""
    w = rate * axis
    return np.concatenate([w, np.cross(point, w) + speed])


def around_axis(model: tp.ObjectModel, generator: np.random.Generator, heights: Array, angles: Array) -> Array:
    """Points on the object's surface at given heights and angles about O's z axis, for fingertips."""
    radius = np.linalg.norm(model.vertices[:, :2], axis=1).max()
    angles = angles + generator.normal(size=len(angles)) * 0.15
    outside = np.stack([radius * np.cos(angles), radius * np.sin(angles), heights], axis=1)
    nearest = np.linalg.norm(model.samples.points - outside[:, None], axis=2).argmin(axis=1)
    return model.samples.points[nearest]


def spread_points(model: tp.ObjectModel, generator: np.random.Generator, count: int) -> Array:
    """Random points on the surface, far from each other."""
    points = model.samples.points
    chosen = [int(generator.integers(len(points)))]
    for _ in range(count - 1):
        some = generator.integers(len(points), size=10)
        gaps = np.linalg.norm(points[some, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(some[gaps.argmax()]))
    return points[chosen]


def turn_screwdriver(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips on a screwdriver's handle and collar rotate it back and forth, rolling on it."""
    model = load("screwdriver")
    height = model.vertices[:, 2].max()
    heights = height * generator.uniform(0.05, 0.5, size=5)
    p_OC = around_axis(model, generator, heights, np.linspace(0.0, 2.0 * np.pi, 5, endpoint=False))
    rate, share, phase = generator.uniform(0.5, 1.5), generator.uniform(-0.5, 0.5), generator.uniform(2.0, 5.0)
    tilt = 0.1 * generator.normal(size=3)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            axis = touch.X_PO[:, 2]
            now = rate * np.cos(phase * i * PERIOD)
            twist = about(touch.X_PO[:, 3], axis, now) + about(touch.X_PO[:, 3], tilt, now)
            yield Step(twist, np.tile(share * now * axis, (5, 1)))

    return model, p_OC, motion


def roll_cylinder(generator: np.random.Generator, steps: int) -> Motion:
    """A cylinder rolls between the thumb, which stays, and three or four opposite fingers, which move across it."""
    model = load("cylinder")
    height = model.vertices[:, 2].max()
    count = int(generator.integers(4, 6))
    heights = height * np.linspace(0.1, 1.0, count)
    angles = np.where(np.arange(count) == 1, np.pi, 0.4 * generator.normal(size=count))
    p_OC = around_axis(model, generator, heights, angles)
    rate, phase = generator.uniform(0.3, 0.8), generator.uniform(2.0, 4.0)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            # Rotation about the thumb's contact, which does not move.
            twist = about(touch.p_PC[1], touch.X_PO[:, 2], rate * np.cos(phase * i * PERIOD))
            yield Step(twist, np.zeros((count, 3)))

    return model, p_OC, motion


def carry(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips translate and rotate an object, without slip or rolling."""
    model = load(CARRIED[int(generator.integers(len(CARRIED)))])
    axis, way = generator.normal(size=(2, 3))
    rate, speed, phase = generator.uniform(0.2, 0.8), generator.uniform(0.01, 0.04), generator.uniform(2.0, 4.0)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            now = np.cos(phase * i * PERIOD)
            w = rate * now * axis / np.linalg.norm(axis)
            twist = about(touch.X_PO[:, 3], w, 1.0, speed * now * way / np.linalg.norm(way))
            yield Step(twist, np.tile(w, (5, 1)))

    return model, spread_points(model, generator, 5), motion


def slip(generator: np.random.Generator, steps: int) -> Motion:
    """An object slides for a while between fingers that do not move, and is then held again."""
    model = load(CARRIED[int(generator.integers(len(CARRIED)))])
    start = int(generator.uniform(0.25, 0.5) * steps)
    end = start + int(generator.uniform(0.15, 0.3) * steps)
    way = generator.normal(size=3)
    way *= generator.uniform(0.005, 0.03) / np.linalg.norm(way)
    turn = 0.2 * generator.normal(size=3)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            slides = start <= i < end
            twist = about(touch.X_PO[:, 3], turn, 1.0, way) if slides else np.zeros(6)
            yield Step(twist, np.zeros((5, 3)), slides)

    return model, spread_points(model, generator, 5), motion


FAMILIES = {"turn": turn_screwdriver, "roll": roll_cylinder, "carry": carry, "slip": slip}
