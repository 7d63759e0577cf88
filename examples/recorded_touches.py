"""Pose estimates from points that a real robot has touched, from all of them and from a few.

    python examples/recorded_touches.py cleaner.off touches.off --sigma 0.005

MESH is the object's, in metres. TOUCHES is a list of points in the format of the data of [V16]: a line OFF, a line with
their number, and a line x y z for each, in m, without normals. No such data are included. There is no prior of the
pose.

First, all points are used. The script prints the hypotheses, the distances of the points from the surface at each, and
the estimated scale of their noise relative to the declared one. Then it draws some of the points repeatedly, and prints
how often the best pose is near the pose from all points, within 20 mm and 15 degrees; how often the status is "ok", and
how many of these answers are not near it; how many answers have a probability above 95 %, and for how many of these the
error is beyond the 99.9 % region of their own covariance; and how often the 95 % set contains the pose from all points.
That pose stands in for the truth, which is unknown. The last row is for all points in another order.

Source: [V16] G. Vezzani et al., Memory unscented particle filter for 6-DOF tactile localization, arXiv:1607.02757.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import trimesh
from nearest_images import nearest_increments
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import inverse, transform_points

Array = NDArray[np.float64]
NEAR = np.array([0.020, 15.0])  # m, deg
SURE = 0.95


def read_points(path: Path) -> Array:
    """The touched points, shape (n, 3), m.

    Raises:
        SystemExit: if the file is not a list of points; the message states the required form.
    """
    lines = path.read_text(encoding="utf-8").split("\n")
    try:
        count = int(lines[1].split()[0]) if lines[0].strip() == "OFF" else -1
        points = np.array([line.split() for line in lines[2 : 2 + count]], dtype=np.float64)
    except (IndexError, ValueError):
        count, points = -1, np.empty((0, 3))
    if points.shape != (count, 3) or not np.isfinite(points).all():
        raise SystemExit(f"{path} must be a list of points: a line OFF, one with their number n, and n lines of x y z.")
    return points


def distances(mesh: trimesh.Trimesh, X_PO: Array, points: Array) -> Array:
    """Distances of points (n, 3) in P from the surface, shape (n,), m, computed without the estimator's own field."""
    p_O = transform_points(inverse(X_PO), points)
    return np.asarray(trimesh.proximity.closest_point_naive(mesh, p_O)[1])


def error(model: tp.ObjectModel, hypothesis: tp.PoseHypothesis, X_PO: Array) -> tuple[Array, float]:
    """Error of the object's centre, m, and of its rotation, deg, and the squared Mahalanobis distance."""
    X, information = hypothesis.X_PO.GetAsMatrix34(), np.linalg.inv(hypothesis.covariance)
    u = nearest_increments(model, X, information, X_PO[None])[0]
    middle = model.vertices.mean(axis=0)
    way = np.linalg.norm((X_PO[:, :3] - X[:, :3]) @ middle + X_PO[:, 3] - X[:, 3])
    return np.array([way, np.degrees(np.linalg.norm(u[:3]))]), float(u @ information @ u)


def set_holds(model: tp.ObjectModel, estimate: tp.PoseEstimate, X_PO: Array) -> bool:
    """Whether the 95 % set of the hypotheses, each with its own 95 % ellipsoid, contains the pose."""
    before = 0.0
    for hypothesis in estimate:
        if before >= SURE:
            return False
        if error(model, hypothesis, X_PO)[1] < chi2.ppf(SURE, 6):
            return True
        before += hypothesis.probability
    return False


def print_all(mesh: trimesh.Trimesh, estimate: tp.PoseEstimate, points: Array) -> None:
    """Prints the hypotheses from all points."""
    print(f"{len(points)} points: {estimate.status}; their noise seems {estimate.noise_scale:.2f} times what is told")
    table = Table("probability", "rms distance, mm", "largest, mm", "points as told")
    for hypothesis in estimate.hypotheses[:4]:
        off = distances(mesh, hypothesis.X_PO.GetAsMatrix34(), points)
        inliers = np.count_nonzero(np.asarray(hypothesis.inlier_probability) > 0.5)
        rms, most = 1e3 * np.sqrt(np.mean(off**2)), 1e3 * off.max()
        table.add_row(f"{hypothesis.probability:.3f}", f"{rms:.2f}", f"{most:.1f}", f"{inliers} of {len(points)}")
    Console().print(table)


def row_of_some(
    model: tp.ObjectModel, points: Array, X_PO: Array, count: int, arguments: argparse.Namespace
) -> list[str]:
    """The results from this number of points."""
    near, ok, sure, held, milliseconds = [], [], [], [], []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.draws):
        chosen = np.random.default_rng(seed).choice(len(points), count, replace=False)
        started = time.perf_counter()
        estimate = tp.estimate_pose(model, tp.Contacts(points[chosen], sigma_position=arguments.sigma))
        milliseconds.append(1e3 * (time.perf_counter() - started))
        off, square = error(model, estimate.best, X_PO)
        near.append(bool(np.all(off < NEAR)))
        if estimate.status == "ok":
            ok.append(not near[-1])
        if estimate.best.probability > SURE:
            sure.append(square > chi2.ppf(0.999, 6))
        held.append(set_holds(model, estimate, X_PO))
    return [
        str(count),
        f"{sum(near)} of {len(near)}",
        f"{len(ok)}, {sum(ok)}",
        f"{len(sure)}, {sum(sure)}",
        f"{sum(held)} of {len(held)}",
        f"{np.median(milliseconds):.0f}",
    ]


def main() -> None:
    """Prints the hypotheses from all points, and a table of those from some of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("touches", type=Path)
    parser.add_argument("--sigma", type=float, default=0.005, help="standard deviation of each coordinate, m")
    parser.add_argument("--counts", type=int, nargs="*", default=[6, 8, 12, 20, 40], help="numbers of points")
    parser.add_argument("--draws", type=int, default=100, help="draws of each number of points")
    parser.add_argument("--first-seed", type=int, default=0)
    arguments = parser.parse_args()
    model, mesh = tp.ObjectModel.from_mesh(arguments.mesh), trimesh.load(arguments.mesh, force="mesh")
    points = read_points(arguments.touches)
    estimate = tp.estimate_pose(model, tp.Contacts(points, sigma_position=arguments.sigma))
    print_all(mesh, estimate, points)
    table = Table("points", "near that pose", '"ok", elsewhere', "sure, wrong", "95 % set holds it", "median ms")
    X_PO = estimate.best.X_PO.GetAsMatrix34()
    for count in (*(count for count in arguments.counts if count < len(points)), len(points)):
        table.add_row(*row_of_some(model, points, X_PO, count, arguments))
    Console().print(table)


if __name__ == "__main__":
    main()
