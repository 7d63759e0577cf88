"""The methods of table 3.1: the thesis' two local searches on its objective, and `tp.estimate_pose` with its defaults.

The thesis' methods are implemented as described there: seven parameters (quaternion and translation) that move the
contacts, forward differences, each contact compared with its 50 nearest points of a point cloud, at most 200
iterations, and Levenberg-Marquardt with pseudo-inverse and a damping factor of ten. The thesis states neither its
termination tolerances nor the step size of its gradient descent. Here, a search also stops if it makes no more
progress, and the step size is adapted.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, chapter 3.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from cube_and_cylinder import Shape, Trial
from numpy.typing import NDArray

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.objectives import PointCloudContact
from tactopose_drake.core.searches import (
    GradientDescent,
    LevenbergMarquardt,
    PriorSpace,
    QuaternionParameters,
    Search,
    make_problem,
    pseudo_inverse_steps,
)
from tactopose_drake.estimation import METHODS

Array = NDArray[np.float64]

NORMAL_WEIGHT = 20e-4  # w_n, m^2: the thesis' 20 cm^2

GD, LM, OURS = "Gradient descent", "Levenberg-Marquardt", "tp.estimate_pose"
Row = tuple[str, str]  # method, evidence that it uses
OUR_ROWS: tuple[Row, Row] = ((OURS, "distance"), (OURS, "distance, normals"))
THESIS_ROWS: tuple[Row, ...] = ((GD, "w_n = 0"), (GD, "w_n = 20"), (LM, "w_n = 0"), (LM, "w_n = 20"))


class Outcome(NamedTuple):
    """The result of a method: the pose (3, 4), the number of iterations, and the time in seconds."""

    X_PO: Array
    iterations: float
    seconds: float


Solver = Callable[[Shape, Trial], Outcome]


def thesis_solver(search: Search, normal_weight: float) -> Solver:
    """One of the thesis' searches on the thesis' objective."""

    def solve(shape: Shape, trial: Trial) -> Outcome:
        started = time.perf_counter()
        cloud = shape.model.samples
        objective = PointCloudContact(cloud.points, cloud.normals, trial.contacts, trial.prior.mean, normal_weight)
        found = search.minimize(objective, PriorSpace(trial.prior), np.random.default_rng(0))
        return Outcome(found.X_PO[0], float(found.iterations[0]), time.perf_counter() - started)

    return solve


def our_solver(with_normals: bool) -> Solver:
    """`tp.estimate_pose` with its default arguments."""

    def solve(shape: Shape, trial: Trial) -> Outcome:
        contacts = trial.contacts if with_normals else dataclasses.replace(trial.contacts, n_PC=None)
        estimate = tp.estimate_pose(shape.model, contacts, prior=trial.prior)
        X_PO = estimate.best.X_PO.GetAsMatrix34()
        return Outcome(X_PO, count_iterations(shape.model, contacts, trial.prior), estimate.duration)

    return solve


def count_iterations(model: tp.ObjectModel, contacts: tp.Contacts, prior: tp.PosePrior) -> float:
    """Number of iterations to the best pose, counted by running the search alone, as the estimate does not state it.

    Many poses are refined at once; an iteration of all of them counts as one, because only successive iterations count.
    """
    evidence = Evidence(contacts, prior)
    problem, search = make_problem(model, evidence), METHODS["pair_search"](model, evidence)
    return float(search.minimize(problem.objective, problem.space, np.random.default_rng(0)).iterations[0])


def make_solvers() -> dict[Row, Solver]:
    """A solver for each row but the first."""
    # In the thesis' units, quaternion and centimetres, lambda is the same for all seven parameters.
    descent = GradientDescent(max_iterations=200, tolerance=1e-6, length=0.01, parameters=QuaternionParameters())
    # The tolerance, in m^4, is the cost of a single contact at 0.4 mm from its nearest point.
    marquardt = LevenbergMarquardt(
        max_iterations=200,
        tolerance=1e-14,
        max_damping=1e100,
        parameters=QuaternionParameters(),
        solver=pseudo_inverse_steps,
    )
    solvers: dict[Row, Solver] = {
        (method, f"w_n = {1e4 * weight:g}"): thesis_solver(search, weight)
        for method, search in ((GD, descent), (LM, marquardt))
        for weight in (0.0, NORMAL_WEIGHT)
    }
    return solvers | {row: our_solver(with_normals) for row, with_normals in zip(OUR_ROWS, (False, True), strict=True)}
