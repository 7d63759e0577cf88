"""Table 5.3 of the thesis repeated: poses of held objects from tactile pads, corrected by three objectives.

    python examples/thesis/table_5_3.py --trials 100 --seed 0 --out out

Prints the table next to the thesis' numbers; writes it as Markdown (table_5_3.md) with figure 5.12 (figure_5_12.png).
The grips (see `pad_grasps.py`) are kept in the cache folder, so that only the first run simulates them, which takes
half a minute. 100 trials take about five minutes.

A trial rotates and translates the true pose uniformly by up to 20 deg about and 10 mm along each axis, in both
directions, and corrects it by

- algorithm 5.2 of the thesis (its proposal, "PCA") and algorithm 5.3 (its benchmark, "distance"), each minimised by
  DIRECT as in the thesis, in a box of that size around the displaced pose;
- ours, the likelihood of every cell's pressure, minimised by our search for patches. Its prior is a Gaussian with the
  variance of the displacements, whereas DIRECT is given their limits.

Errors are those of the position of the object's centre, and of the angle; for a solid of revolution, the minimum of the
angle over rotations about its axis, which its symmetry leaves free. Other motions that a grip does not determine are
counted, such as the translation of the bottle of grip f) along its axis.

Spearman's rho is computed between cost and error in two ways. The first is over the trials' final poses, as in the
thesis. There it depends on both search and objective: if a search ends in the same minimum in every trial, all costs
are equal apart from what the minimum leaves undetermined, and rho ranks only that. A second table shows this: our
objective minimised by three searches, of which the better ones have the smaller errors and the smaller rho. The second
way is "on the way": over the true pose displaced by a random share, from none to all, of the trials' displacements. It
does not depend on a search, and so measures the quality of the objective itself, which is what the thesis uses rho for;
and the errors of those poses are about as large as those of the thesis' final poses. The cost is the objective's,
without the prior.

The thesis' grasps are of other objects and touch other features of them: its a) to f) are listed next to ours by
letter.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.3.
"""

from collections.abc import Iterable
from pathlib import Path

import click
import numpy as np
from ideal_corrections import IdealTrials, ideal_trials
from matplotlib.figure import Figure
from pad_corrections import METHODS, SEARCHES, Trials, run_trials
from pad_grasps import DISTANCE, GRIPS, OURS, PCA, Array, load_pad_grasp
from rich import box
from rich.console import Console
from rich.table import Table

MEAN_LIMIT = (4.0, 5.0)  # mm, deg, required of ours
THESIS_MEAN = (7.6, 10.4)  # mm, deg, [B16] table 6.1
GRASPS_ASKED = 5  # number of grasps in which our rho is required to be above the thesis'

COLUMNS = ("mean, mm", "mean, deg", "at least cost, mm", "at least cost, deg", "rho, mm", "rho, deg")
WAY_COLUMNS = ("rho on the way, mm", "rho on the way, deg")
DRAWS = 100  # draws of the noise, for the ideal estimator
SAME_COST = 0.1  # trials whose final costs differ from the least by less than this end in the same minimum
DIGITS = (1, 1, 1, 1, 2, 2, 2, 2)
SEARCH_COLUMNS = (
    "in the least minimum, %",
    "mean, mm",
    "mean, deg",
    "rho, mm",
    "rho, deg",
    "above in mm",
    "above in deg",
)
SEARCH_DIGITS = (0, 1, 1, 2, 2, 0, 0)
SEARCH_LEGEND = "Our objective by three searches, means over the grips, and in how many rho is above the thesis'"
# [B16] table 5.3, in the order of `COLUMNS`.
THESIS = {
    "a": {PCA: (7.8, 4.73, 0.5, 1.24, 0.57, 0.70), DISTANCE: (7.5, 23.7, 7.1, 25.34, 0.31, 0.41)},
    "b": {PCA: (8.5, 18.8, 15.4, 20.2, -0.03, 0.42), DISTANCE: (16.2, 22.9, 26.4, 24.7, -0.04, 0.07)},
    "c": {PCA: (5.5, 11.61, 4.6, 10.53, 0.02, 0.71), DISTANCE: (4.1, 10.90, 3.7, 11.86, -0.38, 0.31)},
    "d": {PCA: (11.2, 8.30, 5.1, 2.74, 0.71, 0.56), DISTANCE: (5.6, 8.70, 4.3, 6.60, 0.4, 0.52)},
    "e": {PCA: (12.8, 8.45, 1.0, 1.19, 0.88, 0.63), DISTANCE: (14.6, 6.288, 11.5, 0.92, 0.22, 0.10)},
    "f": {PCA: (7.8, 10.3, 3.7, 6.01, 0.56, 0.80), DISTANCE: (22.0, 33.3, 20.7, 23.0, 0.74, -0.01)},
}


Results = dict[str, dict[str, Trials]]  # by grip, by method
Ideal = dict[str, IdealTrials]  # by grip


def above_thesis(rho: Array, grips: Iterable[str]) -> Array:
    """In how many grips rho (..., grips, 2) is above that of the thesis' PCA, for mm and deg, shape (..., 2)."""
    above: Array = np.sum(rho > [THESIS[name[0]][PCA][4:] for name in grips], axis=-2)
    return above


def share_in_least_minimum(results: Results, search: str) -> float:
    """The mean, over the grips, of the share of trials that end within `SAME_COST` of the least cost."""
    costs = [trials[search].cost for trials in results.values()]
    return float(np.mean([np.mean(cost < cost.min() + SAME_COST) for cost in costs]))


def search_rows(results: Results) -> list[tuple[str, ...]]:
    """For each search of our objective, means over the grips, and in how many rho is above the thesis'."""
    lines = []
    for search in SEARCHES:
        numbers = np.array([trials[search].numbers() for trials in results.values()])
        means = numbers.mean(axis=0)
        share = 100.0 * share_in_least_minimum(results, search)
        values = (share, *means[:2], *means[4:6], *above_thesis(numbers[:, 4:6], results))
        lines.append((search, *(f"{x:.{digits}f}" for x, digits in zip(values, SEARCH_DIGITS, strict=True))))
    return lines


def verdicts(results: Results) -> list[str]:
    """The results in sentences."""
    numbers = {method: np.array([trials[method].numbers() for trials in results.values()]) for method in METHODS}
    means = {method: values[:, :2].mean(axis=0) for method, values in numbers.items()}
    held = bool(np.all(means[OURS] <= MEAN_LIMIT))
    over = [name for name, row in zip(results, numbers[OURS], strict=True) if np.any(row[:2] > MEAN_LIMIT)]
    above = above_thesis(numbers[OURS][:, 4:6], results)
    way = np.array([numbers[method][:, 6:] for method in METHODS])
    way_above = above_thesis(way[2], results)
    own_above = np.sum(way[2] > way[:2].max(axis=0), axis=0)
    off = np.mean([trials[OURS].way_error.mean(axis=0) for trials in results.values()], axis=0)
    same = share_in_least_minimum(results, OURS)
    enough, way_enough = ("held" if min(count) >= GRASPS_ASKED else "NOT held" for count in (above, way_above))
    seconds = {method: np.mean([trials[method].seconds for trials in results.values()]) for method in METHODS}
    better = np.sum(np.where([True] * 4 + [False] * 4, numbers[OURS] < numbers[PCA], numbers[OURS] > numbers[PCA]))
    return [
        "Mean error over the grips: "
        + "; ".join(f"{method} {mean[0]:.1f} mm, {mean[1]:.1f} deg" for method, mean in means.items())
        + f" (thesis {THESIS_MEAN[0]} mm, {THESIS_MEAN[1]} deg). At most {MEAN_LIMIT[0]:g} mm and {MEAN_LIMIT[1]:g} "
        f"deg were asked of ours: {'held' if held else 'NOT held'}"
        + (f"; by itself not held by {', '.join(over)}." if over else ", by every grip."),
        f"Spearman's rho over the final poses: ours is above the thesis' PCA in {above[0]} of {len(results)} grips for "
        f"mm and in {above[1]} for deg; {GRASPS_ASKED} of 6 were asked for: {enough}. {100 * same:.0f} % of ours end "
        f"within {SAME_COST:g} of the least cost of their grip.",
        f"Over poses on the way, which are off by {off[0]:.1f} mm and {off[1]:.1f} deg on average, ours is above the "
        f"thesis' PCA over its final poses in {way_above[0]} grips for mm and in {way_above[1]} for deg "
        f"({way_enough}), and above both others here in {own_above[0]} and {own_above[1]}; means over the grips: "
        + "; ".join(f"{m} {r[0]:.2f}, {r[1]:.2f}" for m, r in zip(METHODS, way.mean(axis=1), strict=True))
        + ".",
        f"Against algorithm 5.2 here ours is better in {better} of the {numbers[OURS].size} cells.",
        "Processor time of a correction: "
        + "; ".join(f"{method} {1e3 * value:.0f} ms" for method, value in seconds.items())
        + " (thesis 9.06 s and 9.68 s).",
    ]


def ideal_verdict(ideal: Ideal) -> str:
    """The result of the ideal estimator in a sentence."""
    errors, rho = (
        np.stack([getattr(trials, name) for trials in ideal.values()], axis=1) for name in IdealTrials._fields
    )
    above, (mm, deg), means = above_thesis(rho, ideal), errors.mean(axis=(0, 1)), rho.mean(axis=(0, 1))
    enough = 100.0 * np.mean(above >= GRASPS_ASKED, axis=0)
    return (
        f"An ideal estimator, the mean of the exact posterior of touches as informative as these ({len(rho)} draws of "
        f"their noise), is {mm:.1f} mm and {deg:.1f} deg off; its rho over the final poses is {means[0]:.2f} for mm "
        f"and {means[1]:.2f} for deg, above the thesis' PCA in {above[:, 0].mean():.1f} and {above[:, 1].mean():.1f} "
        f"of {len(ideal)} grips, and in {GRASPS_ASKED} or more in {enough[0]:.0f} % and {enough[1]:.0f} % of the draws."
    )


def rows(results: Results) -> list[tuple[str, ...]]:
    """The table's cells as text, with the thesis' numbers in brackets."""
    lines = []
    for name, trials in results.items():
        for method in METHODS:
            printed = [f" ({x:g})" for x in THESIS[name[0]].get(method, ())]
            printed += [""] * (len(DIGITS) - len(printed))
            values = zip(trials[method].numbers(), DIGITS, printed, strict=True)
            lines.append((name, method, *(f"{x:.{digits}f}{other}" for x, digits, other in values)))
    return lines


def markdown(results: Results, ideal: Ideal, seed: int) -> str:
    """The table and the verdicts as Markdown."""
    trials = len(next(iter(results.values()))[OURS].cost)
    headings = ("grip", "objective", *COLUMNS, *WAY_COLUMNS)
    lines = [
        f"# Table 5.3, {trials} trials, seed {seed}",
        "",
        "In brackets the thesis' numbers for PCA (algorithm 5.2) and distance (5.3), of its own grasps. The spin of a "
        "solid of revolution about its axis is no error. rho: over the final poses; rho on the way: over the true pose "
        "displaced by shares of the trials' displacements, the same for all objectives.",
        "",
        "| " + " | ".join(headings) + " |",
        "|---|---|" + "---:|" * len(DIGITS),
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows(results)]
    lines += ["", SEARCH_LEGEND, "", "| search | " + " | ".join(SEARCH_COLUMNS) + " |"]
    lines.append("|---|" + "---:|" * len(SEARCH_DIGITS))
    lines += ["| " + " | ".join(row) + " |" for row in search_rows(results)]
    return "\n".join([*lines, "", *(f"- {line}" for line in (*verdicts(results), ideal_verdict(ideal))), ""])


def print_table(results: Results, ideal: Ideal, console: Console) -> None:
    """Prints the table."""
    table = Table(title="Table 5.3 (in brackets: the thesis)", box=box.SIMPLE_HEAD, padding=0)
    table.add_column("grip, objective", no_wrap=True)
    for heading in (*COLUMNS, *WAY_COLUMNS):
        table.add_column(heading.replace(", ", "\n"), justify="right")
    for name, method, *cells in rows(results):
        table.add_row(f"{name[:2]} {method}", *(cell.replace(" ", "\n") for cell in cells), end_section=method == OURS)
    console.print(table)
    console.print("; ".join(results))
    searches = Table(title=SEARCH_LEGEND, box=box.SIMPLE_HEAD, padding=0)
    searches.add_column("search", no_wrap=True)
    for heading in SEARCH_COLUMNS:
        searches.add_column(heading.replace(", ", "\n"), justify="right")
    for row in search_rows(results):
        searches.add_row(*row)
    console.print(searches)
    for line in (*verdicts(results), ideal_verdict(ideal)):
        console.print(f"- {line}")


def plot(trials: dict[str, Trials], path: Path) -> None:
    """Plots figure 5.12 for one grip: final poses as in the thesis in the upper row, poses on the way in the lower."""
    figure = Figure(figsize=(14, 8), layout="constrained")
    for column, (above, below) in enumerate(figure.subplots(2, len(METHODS)).T):
        method = METHODS[column]
        found = trials[method]
        for axes, error, cost, title in (
            (above, found.error[:, 1], found.cost, f"Figure 5.12: {method}"),
            (below, found.way_error[:, 1], found.way_cost, "on the way"),
        ):
            axes.plot(error, cost, ".")
            slope, offset = np.polyfit(error, cost, 1)
            axes.axline((error.mean(), slope * error.mean() + offset), slope=slope, color="0.7", linewidth=0.8)
            axes.set(title=title, xlabel="angle error, deg", ylabel="cost")
    figure.savefig(path, format="png")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=3), default=100, show_default=True, help="Trials of each grip.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the displacements.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the table and the plots here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """Regenerates table 5.3 of the thesis, next to its numbers."""
    grasps = {name: load_pad_grasp(name, grip) for name, grip in GRIPS.items()}
    results = {name: run_trials(grasp, trials, (seed, i), name) for i, (name, grasp) in enumerate(grasps.items())}
    noise = np.random.default_rng(seed)
    ideal = {name: ideal_trials(grasp, trials, DRAWS, noise) for name, grasp in grasps.items()}
    print_table(results, ideal, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_5_3.md").write_text(markdown(results, ideal, seed), encoding="utf-8")
        plot(list(results.values())[-1], out / "figure_5_12.png")


if __name__ == "__main__":
    main()
