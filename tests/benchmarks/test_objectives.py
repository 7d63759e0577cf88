"""Microseconds of processor time a pose of the objectives for contacts: five contacts, the bust, one core.

`pytest -n 0 -s tests/benchmarks/test_objectives.py` prints them, and the ratio to our cost's; --benchmark-json keeps
them as extra_info. Those of the thesis look for nearest points in a k-d tree, or in a neighbourhood chosen once.
"""

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.objectives.nearest_point_contact import NearestPointContact
from tactopose_drake.core.objectives.point_cloud_contact import PointCloudContact
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.poses import retract
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path

POSES = 2000
# Half the widths of the boxes in which poses are drawn: of rotation, rad, and of translation, m.
SPREADS = {"16 deg, 33 mm": (0.28, 0.033), "180 deg, 200 mm": (3.14, 0.2)}
TRUTH = np.eye(3, 4)

Evaluation = Callable[[np.ndarray], object]


@functools.cache
def evaluations() -> dict[str, Evaluation]:
    """What is evaluated at a batch of poses."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    contacts = touch_surface(model, TRUTH, 5, np.random.default_rng(0))
    ours = SurfaceContact(model.grid, contacts)
    points, normals = model.samples.points, model.samples.normals
    return {
        "ours, cost": ours.cost,
        "ours, derivatives": ours.normal_equations,
        "ours, exact likelihood": SurfaceDensity(model, contacts).cost,
        "thesis, eq. 3.5": PointCloudContact(points, normals, contacts, TRUTH, normal_weight=20e-4).cost,
        "thesis, eq. 4.1": NearestPointContact(points, normals, contacts).cost,
    }


def poses(spread: str) -> np.ndarray:
    turn, way = SPREADS[spread]
    increments = np.random.default_rng(1).uniform(-1.0, 1.0, size=(POSES, 6)) * np.repeat([turn, way], 3)
    return retract(np.tile(TRUTH, (POSES, 1, 1)), increments)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize(
    "name", ["ours, cost", "ours, derivatives", "ours, exact likelihood", "thesis, eq. 3.5", "thesis, eq. 4.1"]
)
def test_a_pose(benchmark: Any, name: str, spread: str) -> None:
    X_PO, ours = poses(spread), evaluations()["ours, cost"]
    benchmark(evaluations()[name], X_PO)
    started = time.process_time()
    for _ in range(20):
        ours(X_PO)
    microseconds = 1e6 * benchmark.stats.stats.median / POSES
    ratio = microseconds / (1e6 * (time.process_time() - started) / (20 * POSES))
    benchmark.extra_info.update(us_per_pose=microseconds, times_our_cost=ratio)
    print(f"\n{name}, {spread}: {microseconds:.2f} us a pose, {ratio:.1f} times our cost's")  # noqa: T201
