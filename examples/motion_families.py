"""Four families of motion of an object in the hand, as the fingertips bring them about.

A screwdriver is turned about its axis, a cylinder is rolled between thumb and fingers, objects are carried about by the
fingertips, and objects slip under load. Each draws an object, where it is touched, and how it moves, step by step.
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
    """What happens in one period: the object's twist in P, the fingertips' turning, and whether they slide."""

    twist: Array
    tip_turn: Array
    slides: bool = False


Motion = tuple[tp.ObjectModel, Array, Callable[[RollingTouch], Iterator[Step]]]


@functools.cache
def load(name: str) -> tp.ObjectModel:
    """An object of the package, loaded once."""
    return tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))


def about(point: Array, axis: Array, rate: float, speed: Array | float = 0.0) -> Array:
    """The twist at P's origin of a turn about an axis through a point, rad/s, and a translation, m/s."""
    w = rate * axis
    return np.concatenate([w, np.cross(point, w) + speed])


def around_axis(model: tp.ObjectModel, generator: np.random.Generator, heights: Array, angles: Array) -> Array:
    """Points about the z axis of O, near its surface, where fingertips may touch."""
    radius = np.linalg.norm(model.vertices[:, :2], axis=1).max()
    angles = angles + generator.normal(size=len(angles)) * 0.15
    outside = np.stack([radius * np.cos(angles), radius * np.sin(angles), heights], axis=1)
    nearest = np.linalg.norm(model.samples.points - outside[:, None], axis=2).argmin(axis=1)
    return model.samples.points[nearest]


def spread_points(model: tp.ObjectModel, generator: np.random.Generator, count: int) -> Array:
    """Points all over the surface, far from each other."""
    points = model.samples.points
    chosen = [int(generator.integers(len(points)))]
    for _ in range(count - 1):
        some = generator.integers(len(points), size=10)
        gaps = np.linalg.norm(points[some, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(some[gaps.argmax()]))
    return points[chosen]


def turn_screwdriver(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips on handle and collar turn it back and forth, and roll on it as they go."""
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
    """The thumb stays, three or four fingers opposite move across, and the cylinder rolls between them."""
    model = load("cylinder")
    height = model.vertices[:, 2].max()
    count = int(generator.integers(4, 6))
    heights = height * np.linspace(0.1, 1.0, count)
    angles = np.where(np.arange(count) == 1, np.pi, 0.4 * generator.normal(size=count))
    p_OC = around_axis(model, generator, heights, angles)
    rate, phase = generator.uniform(0.3, 0.8), generator.uniform(2.0, 4.0)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            # About the thumb's contact: there the cylinder stands still.
            twist = about(touch.p_PC[1], touch.X_PO[:, 2], rate * np.cos(phase * i * PERIOD))
            yield Step(twist, np.zeros((count, 3)))

    return model, p_OC, motion


def carry(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips that stick move it about and turn it."""
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
    """Fingers that hold still lose it after a while: it slides some way, and then it is held again."""
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
