"""Table 3.1 of the thesis repeated: two local searches on a cube and a cylinder, next to `tp.estimate_pose`.

    python examples/thesis/table_3_1.py --trials 100 --seed 0 --out out

Prints the table next to the thesis' numbers, and writes it as Markdown (table_3_1.md) together with the scatter plots
of figures 3.12 to 3.19 (figures_3_12_to_3_19.png). With 100 trials it takes about a minute. The trials are those of
`cube_and_cylinder.py`, the methods those of `chapter_3_methods.py`.

`tp.estimate_pose` is called with its defaults; its prior is the displaced pose, at which the searches of the thesis
start, with the standard deviation of the displacements. Its row without normals corresponds to w_n = 0.

No touch determines the cylinder's rotation about its axis. Therefore its MAE, whatever the method, is at least the
displacement's rotation about this axis, here about 5 deg.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, chapter 3.
"""

import math
from pathlib import Path

import click
import numpy as np
from chapter_3_methods import GD, LM, OUR_ROWS, THESIS_ROWS, Outcome, Row, make_solvers
from cube_and_cylinder import Shape, make_shapes, make_trial
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tactopose_drake.core.poses import identity_poses
from tactopose_drake.core.posterior import touch_errors, truth_errors

Array = NDArray[np.float64]

COLUMNS = ("Its.", "MDTS, cm", "MATN, deg", "RME, cm", "MAE, deg", "Speed, s")
DIGITS = (1, 3, 2, 3, 2, 3)
ERRORS = slice(1, 5)

INITIAL: Row = ("Initial", "")
ROWS = (INITIAL, *THESIS_ROWS, *OUR_ROWS)
# [B16] table 3.1; the first of its two 'Initial' blocks (the second differs by at most 0.07 cm and 0.15 deg).
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


def run_trials(shape: Shape, trials: int, seed: int, description: str) -> dict[Row, Array]:
    """The six columns of every row for each trial, shape (trials, 6), in the table's units."""
    generator = np.random.default_rng(seed)
    solvers = make_solvers()
    for solve in solvers.values():  # The first call compiles, or loads what is compiled.
        solve(shape, make_trial(shape, np.random.default_rng(seed)))
    values = np.empty((trials, len(ROWS), len(COLUMNS)))
    for i in track(range(trials), description, console=Console(stderr=True), transient=True):
        trial = make_trial(shape, generator)
        outcomes = [Outcome(trial.prior.mean, math.nan, math.nan)]
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
    """The means of a row as text."""
    means = results[shape][row].mean(axis=0)
    return ["–" if math.isnan(mean) else f"{mean:.{digits}f}" for mean, digits in zip(means, DIGITS, strict=True)]


def thesis_cells(row: Row, shape: str) -> list[str]:
    """The thesis' numbers of a row in brackets, if there are any."""
    numbers = THESIS.get((row, shape), (math.nan,) * len(COLUMNS))
    return ["" if math.isnan(x) else f"({x:.{digits}f})" for x, digits in zip(numbers, DIGITS, strict=True)]


def verdicts(results: Results) -> list[str]:
    """Compares ours with the thesis' methods, first without and with normals alike, then with normals against all."""
    at_zero = tuple(row for row in THESIS_ROWS if row[1] == "w_n = 0")
    against = ((OUR_ROWS[0], at_zero), (OUR_ROWS[1], THESIS_ROWS))
    return [verdict(results, ours, rows, published) for published in (False, True) for ours, rows in against]


def verdict(results: Results, ours: Row, rows: tuple[Row, ...], published: bool) -> str:
    """Counts the cells of the given rows in which one of ours is less, and names the others."""
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
    """Prints the table."""
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
    """Plots initial against final error of the cube, as in figures 3.12 to 3.19, and the same for our row."""
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
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the trials.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown table and the plots here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """Regenerates table 3.1 of the thesis, next to its numbers."""
    results = {name: run_trials(shape, trials, seed, name) for name, shape in make_shapes().items()}
    print_table(results, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_3_1.md").write_text(markdown(results, seed), encoding="utf-8")
        plot(results["cube"], out / "figures_3_12_to_3_19.png")


if __name__ == "__main__":
    main()
