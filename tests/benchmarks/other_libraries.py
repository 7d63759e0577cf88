"""Estimates of a pose by other libraries, from several starts each; what is not installed is not there.

They are given what our search is: the objective of the evidence with its derivatives, the signed distance grid in it,
and the object's surface samples. The starts are drawn from the poses that our search looks among. Of where they end the
pose of least cost is the answer.
"""

import functools
import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import tactopose_drake as tp
from tactopose_drake.core.poses import inverse, retract, right_jacobian
from tactopose_drake.core.searches.pose_problem import PoseProblem

Poses = NDArray[np.float64]
Descent = Callable[[tp.ObjectModel, tp.Contacts, PoseProblem, Poses], Poses]
"""From starts (n, 3, 4) to where they end, likewise."""


def best_of(descent: Descent, model: tp.ObjectModel, contacts: tp.Contacts, problem: PoseProblem, X: Poses) -> Poses:
    """The pose (3, 4) of least cost where a library ends from starts X (n, 3, 4)."""
    ends = descent(model, contacts, problem, X)
    best: Poses = ends[problem.objective.cost(ends).argmin()]
    return best


def by_gtsam(model: tp.ObjectModel, contacts: tp.Contacts, problem: PoseProblem, X: Poses) -> Poses:
    """GTSAM's Levenberg-Marquardt: a graph of one pose and one factor, whose residuals come from the distance grid."""
    gtsam: Any = importlib.import_module("gtsam")
    count = problem.objective.residuals(X[:1]).shape[1]

    def error(factor: Any, values: Any, jacobians: list[Any] | None) -> NDArray[np.float64]:
        at = values.atPose3(factor.keys()[0]).matrix()[None, :3]
        residuals, J = problem.objective.residuals_and_jacobian(np.ascontiguousarray(at))
        if jacobians is not None:
            # Its increments of the translation are in the object's frame.
            jacobians[0] = np.asfortranarray(np.hstack([J[0, :, :3], J[0, :, 3:] @ at[0, :, :3]]))
        return residuals[0]

    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(count), [0], error))
    ends = []
    for start in X:
        values = gtsam.Values()
        values.insert(0, gtsam.Pose3(gtsam.Rot3(start[:, :3]), start[:, 3]))
        ends.append(gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose3(0).matrix()[:3])
    return np.array(ends)


def by_small_gicp(model: tp.ObjectModel, contacts: tp.Contacts, problem: PoseProblem, X: Poses) -> Poses:
    """small_gicp's generalized ICP: a contact is flat across its normal, as the surface about a sample is."""
    small_gicp: Any = importlib.import_module("small_gicp")
    target, tree = target_of(model)
    # Each point three times: the same least squares, and no warning of so small a cloud.
    source = small_gicp.PointCloud(np.tile(contacts.p_PC, (3, 1)))
    small_gicp.estimate_covariances(source)
    for i, n in enumerate(np.tile(contacts.n_PC, (3, 1))):
        source.cov(i)[:3, :3] = np.eye(3) - (1.0 - FLAT) * np.outer(n, n)
    ends = []
    for start in inverse(X):
        found = small_gicp.align(
            target,
            source,
            tree,
            np.vstack([start, [0.0, 0.0, 0.0, 1.0]]),
            registration_type="GICP",
            max_correspondence_distance=0.1,
            max_iterations=100,
        )
        ends.append(found.T_target_source[:3])
    return inverse(np.array(ends))


FLAT = 1e-3
"""What small_gicp itself gives the least eigenvalue of a flat covariance, where the others are 1."""


@functools.cache
def target_of(model: tp.ObjectModel) -> tuple[Any, Any]:
    """The object's surface samples as small_gicp wants them, made once, as our model is."""
    small_gicp: Any = importlib.import_module("small_gicp")
    cloud = small_gicp.PointCloud(model.samples.points)
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_normals_covariances(cloud, tree)
    return cloud, tree


def by_scipy(model: tp.ObjectModel, contacts: tp.Contacts, problem: PoseProblem, X: Poses) -> Poses:
    """SciPy's Levenberg-Marquardt, MINPACK's, over the increment from the start."""

    def residuals(increment: NDArray[np.float64], start: Poses) -> NDArray[np.float64]:
        return problem.objective.residuals(retract(start, increment)[None])[0]

    def jacobian(increment: NDArray[np.float64], start: Poses) -> NDArray[np.float64]:
        _, J = problem.objective.residuals_and_jacobian(retract(start, increment)[None])
        return np.hstack([J[0, :, :3] @ right_jacobian(increment[:3]), J[0, :, 3:]])

    ends = []
    for start in X:
        found = least_squares(residuals, np.zeros(6), jacobian, method="lm", args=(start,))
        ends.append(retract(start, found.x))
    return np.array(ends)


LIBRARIES: dict[str, Descent] = {"gtsam": by_gtsam, "small_gicp": by_small_gicp, "scipy": by_scipy}
