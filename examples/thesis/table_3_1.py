"""Table 3.1 of the thesis again: two local searches on a cube and a cylinder, beside `tp.estimate_pose`.

    python examples/thesis/table_3_1.py --trials 100 --seed 0 --out out

Prints the table beside the thesis' numbers, and writes it as Markdown (table_3_1.md) together with the scatter plots of
figures 3.12 to 3.19 (figures_3_12_to_3_19.png). With 100 trials it takes about a minute.

What the thesis says is done as it says: seven parameters (quaternion and translation) that move the contacts, forward
differences, each contact against its 50 nearest points of a point cloud, at most 200 iterations, Levenberg-Marquardt
with pseudo-inverse and tenfold damping rule, four exact contacts chosen among the cloud's points. It does not say how
large the objects are and how far they are displaced: the numbers below make its 'Initial' rows come out. One
distribution of displacements does so for both objects if the cube turns about one of its corners. Nor does it name its
accuracies and the step of its gradient descent: here a search also stops where it gets no further, and the step adapts.

`tp.estimate_pose` is called as by default; its prior is the displaced pose with the spread of the displacements, where
the searches of the thesis start. Its row without normals is the counterpart of w_n = 0.

No touch tells how far the cylinder has spun about its axis, so its MAE keeps at least the spin of the displacement:
about 5 deg here, whatever the method.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, chapter 3.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.distance import cdist

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.pose_problem import make_problem
from tactopose_drake.core.objectives.point_cloud_contact import PointCloudContact
from tactopose_drake.core.poses import identity_poses, retract
from tactopose_drake.core.posterior.metrics import touch_errors, truth_errors
from tactopose_drake.core.searches.base import PriorSpace, Search
from tactopose_drake.core.searches.gradient_descent import GradientDescent
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt, pseudo_inverse_steps
from tactopose_drake.core.searches.parameters import QuaternionParameters
from tactopose_drake.estimation import METHODS

Array = NDArray[np.float64]

SIGMA_ROTATION = math.radians(7.25)  # of the displacement about each axis
SIGMA_TRANSLATION = 0.002  # m, along each axis
CONTACTS = 4
NORMAL_WEIGHT = 20e-4  # w_n, m^2: the thesis' 20 cm^2
# What the exact contacts claim to be, for the likelihood of `tp.estimate_pose`: about what its grid resolves.
SIGMA_POSITION, SIGMA_NORMAL = 1e-4, math.radians(2.0)

COLUMNS = ("Its.", "MDTS, cm", "MATN, deg", "RME, cm", "MAE, deg", "Speed, s")
DIGITS = (1, 3, 2, 3, 2, 3)
ERRORS = slice(1, 5)

GD, LM, OURS = "Gradient descent", "Levenberg-Marquardt", "tp.estimate_pose"
Row = tuple[str, str]  # method, what it looks at
INITIAL: Row = ("Initial", "")
OUR_ROWS: tuple[Row, Row] = ((OURS, "distance"), (OURS, "distance, normals"))
THESIS_ROWS: tuple[Row, ...] = ((GD, "w_n = 0"), (GD, "w_n = 20"), (LM, "w_n = 0"), (LM, "w_n = 20"))
ROWS = (INITIAL, *THESIS_ROWS, *OUR_ROWS)
# [B16] table 3.1; of its two 'Initial' blocks the first (the second differs by 0.07 cm and 0.15 deg at most).
THESIS: dict[tuple[Row, str], tuple[float, ...]] = {
    (INITIAL, "cube"): (math.nan, 0.696, 16.715, 1.534, 9.015, math.nan),
    (INITIAL, "cylinder"): (math.nan, 0.265, 8.515, 0.772, 9.148, math.nan),
    ((GD, "w_n = 0"), "cube"): (198.3, 0.166, 10.177, 0.589, 4.802, 6.791),
    ((GD, "w_n = 0"), "cylinder"): (200, 0.148, 6.181, 0.574, 7.070, 7.506),
    ((GD, "w_n = 20"), "cube"): (139.5, 0.200, 3.706, 0.399, 2.832, 4.553),
    ((GD, "w_n = 20"), "cylinder"): (156.2, 0.110, 3.228, 0.426, 4.995, 4.877),
    ((LM, "w_n = 0"), "cube"): (145.9, 0.103, 11.519, 0.765, 6.847, 5.00),
    ((LM, "w_n = 0"), "cylinder"): (97.0, 0.072, 7.984, 0.633, 7.481, 4.336),
    ((LM, "w_n = 20"), "cube"): (94.2, 0.113, 4.619, 0.572, 4.638, 3.54),
    ((LM, "w_n = 20"), "cylinder"): (18.4, 0.083, 2.670, 0.397, 4.925, 0.813),
}


@dataclasses.dataclass(frozen=True)
class Shape:
    """An object of the table; its surface samples are the thesis' point cloud, about eight points a square centimetre.

    Attributes:
        model: the object.
        touchable: which of its samples may be touched, shape (n,): those at least some way from every edge.
    """

    model: tp.ObjectModel
    touchable: NDArray[np.intp]


@dataclasses.dataclass(frozen=True)
class Trial:
    """Four exact contacts with the object at X_PO = 1, and a displaced first guess."""

    contacts: tp.Contacts
    prior: tp.PosePrior


class Outcome(NamedTuple):
    """Where a method ended: the pose (3, 4), its iterations, and the seconds it took."""

    X_PO: Array
    iterations: float
    seconds: float


Solver = Callable[[Shape, Trial], Outcome]


@functools.cache
def make_shapes() -> dict[str, Shape]:
    """A cube with its frame at a corner, and a cylinder with its frame at the centre."""
    edge = 0.095
    cube = trimesh.creation.box((edge, edge, edge))
    cube.apply_translation([edge / 2, edge / 2, edge / 2])
    cylinder = trimesh.creation.cylinder(radius=0.035, height=0.11, sections=720)
    return {"cube": make_shape(cube, "cube", margin=0.01), "cylinder": make_shape(cylinder, "cylinder", margin=0.015)}


def make_shape(mesh: trimesh.Trimesh, name: str, margin: float) -> Shape:
    """A shape that is touched at least `margin` (m) away from its edges, as a fingertip would."""
    model = tp.ObjectModel.from_mesh(mesh, name=name, cache=False)
    points, normals = model.samples.points, model.samples.normals
    beyond_an_edge = normals @ normals.T < math.cos(math.radians(60))
    gap = np.where(beyond_an_edge, cdist(points, points), math.inf).min(axis=1)
    return Shape(model, np.flatnonzero(gap >= margin))


def make_trial(shape: Shape, generator: np.random.Generator) -> Trial:
    """Four random contacts, exact, and the displaced pose, which is all that is known beforehand."""
    touched = generator.choice(shape.touchable, CONTACTS, replace=False)
    samples = shape.model.samples
    contacts = tp.Contacts(
        samples.points[touched],
        samples.normals[touched],
        sigma_position=SIGMA_POSITION,
        sigma_normal=SIGMA_NORMAL,
    )
    increment = generator.normal(size=6) * np.repeat([SIGMA_ROTATION, SIGMA_TRANSLATION], 3)
    return Trial(contacts, tp.PosePrior(retract(np.eye(3, 4), increment), SIGMA_TRANSLATION, SIGMA_ROTATION))


def thesis_solver(search: Search, normal_weight: float) -> Solver:
    """A search of the thesis on the objective of the thesis."""

    def solve(shape: Shape, trial: Trial) -> Outcome:
        started = time.perf_counter()
        cloud = shape.model.samples
        objective = PointCloudContact(cloud.points, cloud.normals, trial.contacts, trial.prior.X_PO, normal_weight)
        found = search.minimize(objective, PriorSpace(trial.prior), np.random.default_rng(0))
        return Outcome(found.X_PO[0], float(found.iterations[0]), time.perf_counter() - started)

    return solve


def our_solver(with_normals: bool) -> Solver:
    """`tp.estimate_pose` as it is called by default."""

    def solve(shape: Shape, trial: Trial) -> Outcome:
        contacts = trial.contacts if with_normals else dataclasses.replace(trial.contacts, n_PC=None)
        estimate = tp.estimate_pose(shape.model, contacts, prior=trial.prior)
        X_PO = estimate.best.X_PO.GetAsMatrix34()
        return Outcome(X_PO, count_iterations(shape.model, contacts, trial.prior), estimate.duration)

    return solve


def count_iterations(model: tp.ObjectModel, contacts: tp.Contacts, prior: tp.PosePrior) -> float:
    """Steps on the way to the best pose: what the estimate does not tell, the search by itself does.

    Many poses step side by side; this counts as one, as it is one after the other that takes iterations.
    """
    evidence = Evidence(contacts, prior)
    problem, search = make_problem(model, evidence), METHODS["pair_search"](model, evidence)
    return float(search.minimize(problem.objective, problem.space, np.random.default_rng(0)).iterations[0])


def make_solvers() -> dict[Row, Solver]:
    """A solver for each row but the first."""
    # In the thesis' units, a quaternion and centimetres: lambda is the same for all seven.
    descent = GradientDescent(max_iterations=200, tolerance=1e-6, length=0.01, parameters=QuaternionParameters())
    # The tolerance, in m^4, is the cost of a single contact 0.4 mm from its nearest point.
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


def run_trials(shape: Shape, trials: int, seed: int, description: str) -> dict[Row, Array]:
    """The six columns of every row for each trial, shape (trials, 6), in the table's units."""
    generator = np.random.default_rng(seed)
    solvers = make_solvers()
    for solve in solvers.values():  # The first call compiles, or loads what is compiled.
        solve(shape, make_trial(shape, np.random.default_rng(seed)))
    values = np.empty((trials, len(ROWS), len(COLUMNS)))
    for i in track(range(trials), description, console=Console(stderr=True), transient=True):
        trial = make_trial(shape, generator)
        outcomes = [Outcome(trial.prior.X_PO, math.nan, math.nan)]
        outcomes += [solvers[row](shape, trial) for row in ROWS[1:]]
        X_PO = np.stack([outcome.X_PO for outcome in outcomes])
        touch = touch_errors(shape.model, trial.contacts, X_PO)
        assert trial.contacts.n_PC is not None
        truth = truth_errors(trial.contacts.p_PC, trial.contacts.n_PC, identity_poses(1)[0], X_PO)
        values[i, :, 0] = [outcome.iterations for outcome in outcomes]
        values[i, :, 1], values[i, :, 2] = 100 * touch.MDTS, np.degrees(touch.MATN)
        values[i, :, 3], values[i, :, 4] = 100 * truth.RME, np.degrees(truth.MAE)
        values[i, :, 5] = [outcome.seconds for outcome in outcomes]
    return {row: values[:, i] for i, row in enumerate(ROWS)}


Results = dict[str, dict[Row, Array]]


def own_cells(results: Results, row: Row, shape: str) -> list[str]:
    """A row's means as text."""
    means = results[shape][row].mean(axis=0)
    return ["–" if math.isnan(mean) else f"{mean:.{digits}f}" for mean, digits in zip(means, DIGITS, strict=True)]


def thesis_cells(row: Row, shape: str) -> list[str]:
    """The thesis' numbers of a row in brackets, where it has any."""
    numbers = THESIS.get((row, shape), (math.nan,) * len(COLUMNS))
    return ["" if math.isnan(x) else f"({x:.{digits}f})" for x, digits in zip(numbers, DIGITS, strict=True)]


def verdicts(results: Results) -> list[str]:
    """Ours against the thesis' methods: like for like, then normals against everything."""
    at_zero = tuple(row for row in THESIS_ROWS if row[1] == "w_n = 0")
    against = ((OUR_ROWS[0], at_zero), (OUR_ROWS[1], THESIS_ROWS))
    return [verdict(results, ours, rows, published) for published in (False, True) for ours, rows in against]


def verdict(results: Results, ours: Row, rows: tuple[Row, ...], published: bool) -> str:
    """How many cells of the given rows one of ours is below, and the others."""
    lost = []
    for shape, values in results.items():
        own = values[ours].mean(axis=0)
        for row in rows:
            other = np.array(THESIS[row, shape]) if published else values[row].mean(axis=0)
            lost += [f"{', '.join(row)}, {shape}: {COLUMNS[i]}" for i in np.flatnonzero(~(own < other))]
    total = len(results) * len(rows) * len(COLUMNS)
    weights = " and ".join(dict.fromkeys(row[1] for row in rows))
    what = "The thesis' numbers" if published else "The same trials"
    line = f"{what}: {ours[0]} ({ours[1]}) is below {total - len(lost)} of the {total} cells at {weights}"
    return f"{line}; not below {'; '.join(lost)}." if lost else f"{line}."


def print_table(results: Results, console: Console) -> None:
    """The table for the terminal."""
    table = Table(title="Table 3.1 (in brackets: the thesis)", box=box.SIMPLE_HEAD, padding=0)
    table.add_column("method", no_wrap=True)
    table.add_column("shape")
    for heading in COLUMNS:
        table.add_column(heading.replace(", ", "\n"), justify="right")
    for row in ROWS:
        for shape in results:
            own, thesis = own_cells(results, row, shape), thesis_cells(row, shape)
            pairs = zip(own, thesis, strict=True)
            table.add_row("\n".join(row), shape, *(f"{text}\n[dim]{other}[/dim]" for text, other in pairs))
        table.add_section()
    console.print(table)
    for line in verdicts(results):
        console.print(f"- {line}")


def markdown(results: Results, seed: int) -> str:
    """The table and the verdicts as Markdown."""
    trials = len(next(iter(results["cube"].values())))
    lines = [
        f"# Table 3.1, {trials} trials, seed {seed}",
        "",
        "Means over the trials; in brackets the thesis' numbers, of its own trials, objects and machine. All methods "
        "start from the displaced pose; `tp.estimate_pose` also knows the spread of the displacements. No touch tells "
        "a cylinder's spin about its axis: its MAE keeps that of the displacement.",
        "",
        "| method | uses | shape | " + " | ".join(COLUMNS) + " |",
        "|---|---|---|" + "---:|" * len(COLUMNS),
    ]
    for row in ROWS:
        for shape in results:
            pairs = zip(own_cells(results, row, shape), thesis_cells(row, shape), strict=True)
            lines.append("| " + " | ".join((*row, shape, *(" ".join(pair).rstrip() for pair in pairs))) + " |")
    return "\n".join([*lines, "", *(f"- {line}" for line in verdicts(results)), ""])


def plot(results: dict[Row, Array], path: Path) -> None:
    """Initial against final error of the cube, as in figures 3.12 to 3.19, and the same for our row."""
    rows = (THESIS_ROWS[1], THESIS_ROWS[3], OUR_ROWS[1])
    numbers = (range(12, 16), range(16, 20), ("",) * 4)
    figure = Figure(figsize=(14, 10), layout="constrained")
    axes = figure.subplots(len(rows), 4)
    before = results[INITIAL][:, ERRORS]
    for line, row, places in zip(axes, rows, numbers, strict=True):
        after = results[row][:, ERRORS]
        for axis, x, y, name, number in zip(line, before.T, after.T, COLUMNS[ERRORS], places, strict=True):
            better = y < x
            axis.plot(x[better], y[better], "b.", x[~better], y[~better], "rx")
            axis.axline((0, 0), slope=1, color="0.7", linewidth=0.8)
            figure_name = f"Figure 3.{number}: " if number else ""
            axis.set(xlabel=f"initial {name}", ylabel=f"final {name}", title=f"{figure_name}{row[0]}\n{row[1]}")
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Trials for each shape.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of contacts, displacements.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown table and the plots here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """Regenerates table 3.1 of the thesis, beside its numbers."""
    results = {name: run_trials(shape, trials, seed, name) for name, shape in make_shapes().items()}
    print_table(results, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_3_1.md").write_text(markdown(results, seed), encoding="utf-8")
        plot(results["cube"], out / "figures_3_12_to_3_19.png")


if __name__ == "__main__":
    main()
