"""Figure 5.14 of the thesis repeated: a line fits a plane if only the distance to the nearest points counts.

    python examples/thesis/figure_5_14.py --seed 0 --out out

Prints the costs next to the thesis' numbers, and writes the figure (figure_5_14.png).

The active cells of a pad form a line (an edge is touched) or an area (a face is touched). The object's points form a
plane or a ridge. Each of the four combinations is fitted by ICP from a slightly rotated and shifted initial pose, and
then evaluated in two ways: by the mean squared distance from the cells to their nearest points ([B16] algorithm 5.3),
which is what ICP minimises, and by the covariance of the points under the pad ([B16] algorithm 5.2).

The thesis does not state its points, units or noise. Its numbers, for the two planes, only show which combination costs
less. Here, cells and points are those of a pad of 8 x 3 cells with a pitch of 2.5 mm, with noise of 0.2 mm.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.4.
"""

import dataclasses
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

import tactopose_drake as tp
from tactopose_drake.core.objectives import CellDistance, CovarianceMatching, Objective
from tactopose_drake.core.poses import inverse, make_poses, retract, transform_points
from tactopose_drake.core.shape import build_point_grid
from tactopose_drake.core.synthetic import flat_pad

Array = NDArray[np.float64]

PITCH, ALPHA, DEPTH = 0.0025, 1e-7, 0.001  # of the pad: m, m/Pa, m
THICKNESS = 0.002  # of its soft layer, m
NOISE = 0.0002  # standard deviation of each cell's depth and of each point, m
SPACING = 0.001  # of the object's points, m
OFF = np.array([0.1, -0.1, 0.1, 0.002, -0.002, 0.002])  # initial pose of ICP: rad, m
CELLS, POINTS = ("line", "plane"), ("ridge", "plane")
THESIS = {("line", "plane"): 0.0408, ("plane", "plane"): 0.0747}  # costs of ICP, in units that are not stated


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """Cells fitted to points.

    Attributes:
        cells: positions, after ICP, of the cells that feel the object, shape (n, 3), m.
        points: points of the object, shape (m, 3), m.
        distance: cost of algorithm 5.3 at this pose, mm^2.
        covariance: cost of algorithm 5.2 at this pose, mm.
    """

    cells: Array
    points: Array
    distance: float
    covariance: float


def touch(shape: str, generator: np.random.Generator) -> tp.Patch:
    """A pad over z = 0 that feels a face, or an edge along the middle of its three columns."""
    cells = flat_pad(pitch=PITCH)
    pressed = np.abs(cells[:, 1]) < 0.5 * PITCH if shape == "line" else np.ones(len(cells), dtype=np.bool_)
    depth = np.where(pressed, DEPTH + NOISE * generator.normal(size=len(cells)), 0.0)
    outward = np.tile([0.0, 0.0, -1.0], (len(cells), 1))
    return tp.describe_patch(cells - [0.0, 0.0, DEPTH], depth / ALPHA, alpha=ALPHA, n_PT=outward)


def surface(shape: str, generator: np.random.Generator) -> Array:
    """Points at z = 0 that extend beyond the pad on all sides; for a ridge only those along its top."""
    x, y = np.arange(-0.02, 0.02, SPACING), np.arange(-0.02, 0.02, SPACING)
    points = np.array([[a, b, 0.0] for a in x for b in (y if shape == "plane" else np.linspace(-0.0005, 0.0005, 10))])
    points[:, 2] += NOISE * generator.normal(size=len(points))
    return points


def icp(cells: Array, points: Array, X: Array, rounds: int = 100) -> Array:
    """The pose (3, 4) of the points that aligns them with the cells, by iterations to the nearest points."""
    tree = cKDTree(points)
    for _ in range(rounds):
        near = points[tree.query(transform_points(inverse(X), cells))[1]]
        middle, target = near.mean(axis=0), cells.mean(axis=0)
        U, _, Vt = np.linalg.svd((near - middle).T @ (cells - target))
        R = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
        X = make_poses(R, target - R @ middle)
    return X


def fit(cells: str, points: str, seed: int) -> Fit:
    """Fits one combination."""
    generator = np.random.default_rng(seed)
    patch, cloud = touch(cells, generator), surface(points, generator)
    X = icp(patch.points[patch.active], cloud, retract(np.eye(3, 4), OFF))
    grid = build_point_grid(cloud)

    def cost(objective: Objective) -> float:
        return float(objective.cost(X[None])[0])

    return Fit(
        cells=transform_points(inverse(X), patch.points[patch.active]),
        points=cloud,
        distance=1e6 * cost(CellDistance(grid, [patch])),
        covariance=1e3 * cost(CovarianceMatching(grid, [patch], thickness=THICKNESS)),
    )


Fits = dict[tuple[str, str], Fit]  # by cells, points


def verdicts(fits: Fits) -> list[str]:
    """Sentences that state, for each cost, whether a line or a plane fits a plane better."""
    lines = []
    for what, costs in (
        ("the thesis' ICP", THESIS),
        ("algorithm 5.3", {key: fit.distance for key, fit in fits.items()}),
        ("algorithm 5.2", {key: fit.covariance for key, fit in fits.items()}),
    ):
        ratio = costs["line", "plane"] / costs["plane", "plane"]
        verdict = "cheaper: they are not told apart" if ratio < 1 else "dearer: they are told apart"
        lines.append(f"By {what} the line on the plane costs {ratio:.2f} of the plane on the plane: {verdict}.")
    return lines


def print_table(fits: Fits, console: Console) -> None:
    """Prints the costs."""
    table = Table(title="Figure 5.14", box=box.SIMPLE_HEAD)
    for heading in ("cells", "points", "algorithm 5.3, mm^2", "thesis", "algorithm 5.2, mm"):
        table.add_column(heading)
    for (cells, points), found in fits.items():
        thesis = THESIS.get((cells, points))
        printed = "" if thesis is None else f"{thesis:g}"
        table.add_row(cells, points, f"{found.distance:.4f}", printed, f"{found.covariance:.2f}")
    console.print(table)
    for line in verdicts(fits):
        console.print(f"- {line}")


def plot(fits: Fits, path: Path) -> None:
    """Plots the four fits."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    for i, ((cells, points), found) in enumerate(fits.items()):
        axes = figure.add_subplot(2, 2, i + 1, projection="3d")
        axes.scatter(*(1e3 * found.points.T), s=2, color="tab:red", alpha=0.3)
        axes.scatter(*(1e3 * found.cells.T), s=40, marker="x", color="tab:blue")
        axes.set(xlim=(-20, 20), ylim=(-20, 20), zlim=(-8, 8), xlabel="x, mm", ylabel="y, mm", zlabel="z, mm")
        axes.set_box_aspect((40, 40, 16))
        axes.set_title(
            f"{cells} on {points}\nalgorithm 5.3: {found.distance:.4f} mm$^2$, 5.2: {found.covariance:.2f} mm"
        )
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the noise.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the figure here.")
def main(seed: int, out: Path | None) -> None:
    """Regenerates figure 5.14 of the thesis, next to its numbers."""
    fits = {(cells, points): fit(cells, points, seed) for points in POINTS[::-1] for cells in CELLS}
    print_table(fits, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        plot(fits, out / "figure_5_14.png")


if __name__ == "__main__":
    main()
