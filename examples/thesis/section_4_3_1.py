"""The experiments of section 4.3.1 of the thesis repeated: a pose that is corrected, and one found without a prior.

    python examples/thesis/section_4_3_1.py --trials 100 --thesis-trials 20 2 --seed 0 --out out
    python examples/thesis/section_4_3_1.py --trials 100 --thesis-trials 100 100 --jobs 2 --journal trials.jsonl

Prints a table for each experiment next to the thesis' numbers, and writes it as Markdown (section_4_3_1.md) with the
plots of figures 4.8 to 4.10, 4.12, 4.13 and 4.20. All methods (`pose_experiments.py`) are applied to the same trials,
one after the other. The thesis' searches are slow and therefore run only on the first trials of each cell:
`--thesis-trials` gives their numbers, for the correction and for the global estimation, for the search with the thesis'
cost, and `--likelihood-trials` for the search with our likelihood. On these trials, ours are compared with them.

A hundred trials of each cell take about half a minute for ours, a quarter of an hour for the thesis' corrections, and
four hours of CPU time for its global searches with its own cost. The trials can be divided among several processes
(`--jobs`). After an interrupt (Ctrl-C), the thesis' searches stop after the current grasp, and the tables state the
number of trials. A run with the same `--journal` continues where the last one ended. The journal does not notice
changes of the code: delete it when a method has changed. All times are CPU times of one process.

The grasps are simulated once and kept (`grasp_library.py`; about ten minutes for a hundred of each object).
`grasp_trials.py` describes how a trial is made from a grasp, and how its errors are defined.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click
import numpy as np
from experiment_runs import Bench, run_experiment
from grasp_library import make_library, make_scenario
from pose_experiments import (
    CELLS,
    CORRECTION,
    GLOBAL,
    MAIN_CELL,
    METHODS,
    OUR_METHODS,
    PUBLISHED,
    SAME_COST,
    THESIS_METHODS,
    Results,
    Runs,
)
from pose_plots import save_figures
from rich import box
from rich.console import Console
from rich.table import Table
from trial_journal import TrialJournal

from tactopose_drake.errors import InvalidInputError

COLUMNS = ("trials", "success, %", "found, %", "said, %", "mm", "deg", "ms")
DIGITS = (0, 0, 0, 0, 1, 1, 1)  # fewer for numbers of three digits or more
LEGEND = (
    "pair_search: tp.estimate_pose with its defaults; with hand: also with the hand's volume; monte_carlo: the thesis' "
    "search with our likelihood; as published: the thesis' search with its own cost. Success: the best pose is within "
    "10 mm and 15° of the truth; found: some hypothesis is; said: the probability that the hypotheses give to such "
    "poses, which equals the success rate if the estimate is calibrated; mm, deg: mean errors of the best pose; ms: "
    "median CPU time"
)


def numbers(runs: Runs) -> tuple[float, ...]:
    """The numbers of `COLUMNS`."""
    shares = (100.0 * float(np.mean(values)) for values in (runs.errors.success, runs.found, runs.mass))
    translation, rotation = (float(values.mean()) for values in runs.errors)
    return (len(runs), *shares, 1e3 * translation, math.degrees(rotation), 1e3 * float(np.median(runs.seconds)))


def texts(runs: Runs) -> list[str]:
    """The numbers of `COLUMNS` as text; empty for NaN."""
    pairs = zip(numbers(runs), DIGITS, strict=True)
    return ["" if math.isnan(number) else f"{number:.{digits if number < 100 else 0}f}" for number, digits in pairs]


def rows(results: Results) -> list[tuple[str, ...]]:
    """The table: fingers, noise, method, and the numbers of `COLUMNS`, as text."""
    return [
        (str(cell.fingers), str(cell.noise), method, *texts(results.runs[cell, method]))
        for cell in CELLS
        for method in METHODS
        if (cell, method) in results.runs
    ]


def verdicts(results: Results) -> list[str]:
    """Compares ours with the thesis' numbers, and with the thesis' search on the same trials."""
    published = results.experiment
    claimed = [cell for cell in CELLS if cell.fingers >= published.success_fingers and cell.noise <= MAIN_CELL.noise]
    lines = []
    if len(results.initial.translation):
        distance, angle = (float(values.mean()) for values in results.initial)
        lines.append(f"Initial: {1e3 * distance:.1f} mm and {math.degrees(angle):.1f}° off on average.")
    for method in OUR_METHODS:
        *_, mm, deg, ms = numbers(results.runs[MAIN_CELL, method])
        least = min(100.0 * float(results.runs[cell, method].errors.success.mean()) for cell in claimed)
        lines.append(
            f"{method}: {mm:.1f} mm and {deg:.1f}° in {ms:.1f} ms with {MAIN_CELL.fingers} fingers at "
            f"{MAIN_CELL.noise}; success in at least {least:.0f} % with {published.success_fingers} fingers or more "
            f"and no more noise."
        )
    lines.append(
        f"The thesis, with its object, grasps and machine: {1e3 * published.mean_translation:.3g} mm and "
        f"{math.degrees(published.mean_rotation):.3g}° in {published.seconds:g} s, "
        f"over {100 * published.success:.0f} %; {published.trials} trials."
    )
    pairs = ((ours, theirs) for theirs in THESIS_METHODS for ours in OUR_METHODS)
    return lines + [comparison(results, *pair) for pair in pairs if (MAIN_CELL, pair[1]) in results.runs]


def comparison(results: Results, own: str, other: str) -> str:
    """Compares one of our methods with one of the thesis' on the same trials of each cell."""
    lost, ratios, total = [], [], [0, 0]
    for cell in CELLS:
        theirs = results.runs[cell, other]
        ours = results.runs[cell, own].first(len(theirs))
        successes = [int(runs.errors.success.sum()) for runs in (ours, theirs)]
        total = [before + now for before, now in zip(total, successes, strict=True)]
        if successes[0] < successes[1]:
            lost.append(f"{cell.fingers} fingers, {cell.noise} ({successes[0]} against {successes[1]})")
        ratios.append(float(np.median(theirs.seconds) / np.median(ours.seconds)))
    line = (
        f"{own} against the thesis' search {other}, on {len(theirs)} trials of each cell: as often successful or more "
        f"in {len(CELLS) - len(lost)} of {len(CELLS)} cells ({total[0]} against {total[1]} successes), and "
        f"{min(ratios):.0f} to {max(ratios):.0f} times as fast"
    )
    return f"{line}; less often with {'; '.join(lost)}." if lost else f"{line}."


def print_table(results: Results, console: Console) -> None:
    """Prints the table."""
    table = Table(title=results.experiment.title, box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    for heading in ("fingers", "noise", "method", *COLUMNS):
        alignment: Literal["left", "right"] = "left" if heading == "method" else "right"
        table.add_column(heading.replace(", ", "\n"), justify=alignment, no_wrap=True)
    shown: tuple[str, ...] = ("", "")
    for row in rows(results):
        if row[:2] != shown:
            table.add_section()
        table.add_row(*(("", "") if row[:2] == shown else row[:2]), *row[2:])
        shown = row[:2]
    console.print(table)
    for line in verdicts(results):
        console.print(f"- {line}")


def markdown(results: Results) -> list[str]:
    """The table and the verdicts as lines of Markdown."""
    lines = [f"## {results.experiment.title}", "", "| fingers | noise | method | " + " | ".join(COLUMNS) + " |"]
    lines.append("|---:|---:|---|" + "---:|" * len(COLUMNS))
    lines += ["| " + " | ".join(row) + " |" for row in rows(results)]
    return [*lines, "", *(f"- {line}" for line in verdicts(results)), ""]


def save(all_results: Sequence[Results], seed: int, folder: Path) -> None:
    """Writes the tables and the plots."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"# Section 4.3.1, seed {seed}", "", f"{LEGEND}.", ""]
    for results in all_results:
        lines += markdown(results)
        save_figures(results, folder)
    (folder / "section_4_3_1.md").write_text("\n".join(lines), encoding="utf-8")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Trials of each cell.")
@click.option(
    "--thesis-trials",
    type=(click.IntRange(min=0), click.IntRange(min=0)),
    default=(20, 2),
    show_default=True,
    help="Trials of the thesis' search with its own cost: corrections, global estimates.",
)
@click.option(
    "--likelihood-trials",
    type=(click.IntRange(min=0), click.IntRange(min=0)),
    default=(20, 2),
    show_default=True,
    help="The same for the thesis' search with our likelihood.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise and displacements.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown tables and the plots here.")
@click.option("--grasps", type=click.Path(path_type=Path), help="Keeps the grasps here, not in the cache folder.")
@click.option("--journal", type=click.Path(path_type=Path, dir_okay=False), help="Keeps the result of each trial here.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes that run trials.")
def main(
    trials: int,
    thesis_trials: tuple[int, int],
    likelihood_trials: tuple[int, int],
    seed: int,
    out: Path | None,
    grasps: Path | None,
    journal: Path | None,
    jobs: int,
) -> None:
    """Regenerates the experiments of section 4.3.1 of the thesis, next to its numbers."""
    try:
        kept = TrialJournal(journal)
    except InvalidInputError as error:
        raise click.ClickException(str(error)) from error
    console, all_results = Console(), []
    if len(kept):
        console.print(f"{journal} has {len(kept)} trials of earlier runs.")
    for experiment, slow in zip((CORRECTION, GLOBAL), zip(thesis_trials, likelihood_trials, strict=True), strict=True):
        library = make_library(experiment.object, trials, grasps)
        model = make_scenario(experiment.object).object_model()
        most = dict(zip((PUBLISHED, SAME_COST), slow, strict=True))
        counts = {method: min(most.get(method, trials), trials) for method in METHODS}
        all_results.append(run_experiment(Bench(experiment, model, library, seed), counts, kept, jobs))
        print_table(all_results[-1], console)
        if out is not None:
            save(all_results, seed, out)
    console.print(f"\n{LEGEND}.")


if __name__ == "__main__":
    main()
