"""The experiments of section 4.3.1 of the thesis again: a pose corrected, and one found without a guess.

    python examples/thesis/section_4_3_1.py --trials 100 --thesis-trials 20 --seed 0 --out out

Prints a table for each experiment beside the thesis' numbers, and writes it as Markdown (section_4_3_1.md) with the
plots of figures 4.8 to 4.10, 4.12, 4.13 and 4.20. Both searches, `tp.estimate_pose` as it is called by default and the
thesis' own (`method="monte_carlo"`), see the same trials, one after the other on the same core; the slow one sees the
first `--thesis-trials` of each cell, and is compared on those.

The grasps are simulated once and kept (`grasp_library.py`; about ten minutes for a hundred of each object). How a
trial is made from a grasp, and what its errors mean, is in `grasp_trials.py`.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from grasp_library import make_library, make_scenario
from pose_experiments import CELLS, CORRECTION, GLOBAL, MAIN_CELL, OURS, THEIRS, Results, Runs, run_experiment
from pose_plots import save_figures
from rich import box
from rich.console import Console
from rich.table import Table

import tactopose_drake as tp

COLUMNS = ("success, %", "found, %", "said, %", "mm", "deg", "ms")
DIGITS = (0, 0, 0, 1, 1, 1)
LEGEND = (
    "success: the best pose is within 10 mm and 15° of the truth; found: some hypothesis is; said: the probability "
    "that the hypotheses give to such poses, which a calibrated estimate matches with its successes; mm, deg: mean "
    "errors of the best pose; ms: median CPU time"
)


def means(runs: Runs) -> tuple[float, ...]:
    """The numbers of `COLUMNS`."""
    shares = (100.0 * float(np.mean(values)) for values in (runs.errors.success, runs.found, runs.mass))
    translation, rotation = (float(values.mean()) for values in runs.errors)
    return (*shares, 1e3 * translation, math.degrees(rotation), 1e3 * float(np.median(runs.seconds)))


def texts(runs: Runs | None) -> list[str]:
    """The numbers of `COLUMNS` as text; empty where nothing has run."""
    if runs is None:
        return [""] * len(COLUMNS)
    return [f"{value:.{digits}f}" for value, digits in zip(means(runs), DIGITS, strict=True)]


def verdicts(results: Results) -> list[str]:
    """Against the thesis' numbers, and against its search on the same trials."""
    published, main = results.experiment, results.runs[MAIN_CELL, OURS]
    _, _, _, mm, deg, ms = means(main)
    claimed = [cell for cell in CELLS if cell.fingers >= published.success_fingers and cell.noise <= MAIN_CELL.noise]
    least = min(100.0 * float(results.runs[cell, OURS].errors.success.mean()) for cell in claimed)
    lines = [
        f"{MAIN_CELL.fingers} fingers, {MAIN_CELL.noise}: {mm:.1f} mm and {deg:.1f}° in {ms:.1f} ms "
        f"(the thesis: {1e3 * published.mean_translation:.3g} mm and {math.degrees(published.mean_rotation):.3g}° in "
        f"{published.seconds:g} s on its machine, with its object and grasps).",
        f"At least {published.success_fingers} fingers and at most that noise: success in {least:.0f} % or more "
        f"(the thesis: over {100 * published.success:.0f} %).",
    ]
    if len(results.initial.translation):
        distance, angle = (float(values.mean()) for values in results.initial)
        lines.insert(0, f"Initial: {1e3 * distance:.1f} mm and {math.degrees(angle):.1f}° off on average.")
    return lines + (comparison(results) if (MAIN_CELL, THEIRS) in results.runs else [])


def comparison(results: Results) -> list[str]:
    """Ours and the thesis' search on the same trials of each cell."""
    lost, ratios = [], []
    for cell in CELLS:
        theirs = results.runs[cell, THEIRS]
        ours = results.runs[cell, OURS].first(len(theirs))
        successes = [int(runs.errors.success.sum()) for runs in (ours, theirs)]
        if successes[0] < successes[1]:
            lost.append(f"{cell.fingers} fingers, {cell.noise}: {successes[0]} against {successes[1]}")
        ratios.append(float(np.median(theirs.seconds) / np.median(ours.seconds)))
    line = (
        f"On the same {len(theirs)} trials of each cell, success at least as often as the thesis' search in "
        f"{len(CELLS) - len(lost)} of {len(CELLS)} cells"
    )
    return [
        f"{line}; less often with {'; '.join(lost)}." if lost else f"{line}.",
        f"Its median time there is {min(ratios):.0f} to {max(ratios):.0f} times ours.",
    ]


def print_table(results: Results, console: Console) -> None:
    """The table for the terminal; below each of our numbers that of the thesis' search."""
    table = Table(title=results.experiment.title, box=box.SIMPLE_HEAD, padding=(0, 1))
    for heading in ("fingers", "noise", *COLUMNS):
        table.add_column(heading.replace(", ", "\n"), justify="right", no_wrap=True)
    for cell in CELLS:
        ours, theirs = (texts(results.runs.get((cell, method))) for method in (OURS, THEIRS))
        joined = [f"{own}\n[dim]{other}[/dim]" if other else own for own, other in zip(ours, theirs, strict=True)]
        table.add_row(str(cell.fingers), str(cell.noise), *joined)
    console.print(table)
    for line in verdicts(results):
        console.print(f"- {line}")


def markdown(results: Results) -> list[str]:
    """The table and the verdicts as lines of Markdown; in brackets the thesis' search."""
    lines = [f"## {results.experiment.title}", "", "| fingers | noise | " + " | ".join(COLUMNS) + " |"]
    lines.append("|" + "---:|" * (2 + len(COLUMNS)))
    for cell in CELLS:
        ours, theirs = (texts(results.runs.get((cell, method))) for method in (OURS, THEIRS))
        joined = [f"{own} ({other})" if other else own for own, other in zip(ours, theirs, strict=True)]
        lines.append("| " + " | ".join((str(cell.fingers), str(cell.noise), *joined)) + " |")
    return [*lines, "", *(f"- {line}" for line in verdicts(results)), ""]


def save(all_results: Sequence[Results], heading: str, folder: Path) -> None:
    """Writes the tables and the plots."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"# {heading}", "", f"Ours, and in brackets the thesis' search. {LEGEND}.", ""]
    for results in all_results:
        lines += markdown(results)
        save_figures(results, folder)
    (folder / "section_4_3_1.md").write_text("\n".join(lines), encoding="utf-8")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Trials of each cell.")
@click.option(
    "--thesis-trials",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="The first so many of them also with the thesis' own, slow search.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise and displacements.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown tables and the plots here.")
@click.option("--grasps", type=click.Path(path_type=Path), help="Keeps the grasps here, not in the cache folder.")
def main(trials: int, thesis_trials: int, seed: int, out: Path | None, grasps: Path | None) -> None:
    """Regenerates the experiments of section 4.3.1 of the thesis, beside its numbers."""
    counts = {OURS: trials, THEIRS: min(thesis_trials, trials)}
    console, all_results = Console(), []
    heading = f"Section 4.3.1: {trials} trials of each cell, {counts[THEIRS]} with the thesis' search, seed {seed}"
    console.print(heading)
    for experiment in (CORRECTION, GLOBAL):
        library = make_library(experiment.object, trials, grasps)
        model = tp.ObjectModel.from_mesh(make_scenario(experiment.object).object_mesh())
        all_results.append(run_experiment(experiment, model, library, counts, seed))
        print_table(all_results[-1], console)
    console.print(f"\n{LEGEND}.")
    if out is not None:
        save(all_results, heading, out)


if __name__ == "__main__":
    main()
