"""Microseconds of processor time a pose of the objectives for tactile arrays: four pads of 24 cells, one core.

`pytest -n 0 -s tests/benchmarks/test_patches.py` prints them; --benchmark-json keeps them as extra_info.
"""

import time
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.objectives.cell_distance import CellDistance
from tactopose_drake.core.objectives.covariance_matching import CovarianceMatching
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.shape.point_grid import build_point_grid
from tactopose_drake.core.shape.surface_samples import sample_surface
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads
from tactopose_drake.resources import model_path

POSES = 2000
# Half the widths of the boxes in which poses are drawn: of rotation, rad, and of translation, m.
SPREADS = {"correction (20 deg, 10 mm)": (0.35, 0.01), "global (180 deg, 200 mm)": (3.14, 0.2)}


@pytest.fixture(scope="module", params=["mug", "tea_box"])
def model(request: pytest.FixtureRequest) -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", f"{request.param}.obj"))


@pytest.fixture(scope="module")
def fine_points(model: tp.ObjectModel) -> np.ndarray:
    return sample_surface(model.vertices, model.faces, 10_000).points


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize(
    "name",
    [
        "algorithm 5.2, 3000 points",
        "algorithm 5.2, 10000 points",
        "algorithm 5.3, 3000 points",
        "ours, cost",
        "ours, derivatives",
    ],
)
def test_a_pose(benchmark: Any, model: tp.ObjectModel, fine_points: np.ndarray, name: str, spread: str) -> None:
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))
    patches = touch_with_pads(model, X_PO[0], 4, generator)
    turn, way = SPREADS[spread]
    poses = retract(X_PO, generator.uniform(-1.0, 1.0, size=(POSES, 6)) * np.repeat([turn, way], 3))
    points = fine_points if "10000" in name else model.samples.points
    objective: LeastSquaresObjective
    if "5.2" in name:
        objective = CovarianceMatching(build_point_grid(points), patches)
    elif "5.3" in name:
        objective = CellDistance(build_point_grid(points), patches)
    else:
        objective = PatchContact(model.grid, patches)
    benchmark(objective.normal_equations if "derivatives" in name else objective.cost, poses)
    microseconds = 1e6 * benchmark.stats.stats.median / POSES
    benchmark.extra_info["us_per_pose"] = microseconds
    print(f"\n{model.name}, {name}, {spread}: {microseconds:.1f} us a pose")  # noqa: T201
