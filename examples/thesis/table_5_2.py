"""Table 5.2 of the thesis repeated: searches compared on its two objectives for tactile pads, with equal input.

    python examples/thesis/table_5_2.py --trials 20 --seed 0 --out out

Prints the table next to the thesis' numbers; writes it as Markdown (table_5_2.md). The input is that of table 5.3: six
simulated grips (see `pad_grasps.py`), kept in the cache folder, and displaced poses to correct. The thesis' searches
take nearly all of the time.

The thesis' three searches may evaluate the same number of poses, that of its Monte Carlo method, and each ends with a
refinement of its best poses. Ours proposes a few poses from pairs of patches, and then refines populations around the
best of them by their costs alone, without gradients, because both objectives have kinks and jumps. All searches are
given the limits of the displacement and nothing else. Costs are the objectives' own: sums over the pads, of algorithm
5.2 in m, of 5.3 in m^2. The thesis does not state its units, its trials, or whether its averages are over corrections,
over global searches or over both; here they are over corrections. Therefore only the order of the rows can be compared,
not the numbers.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.2.5.
"""

import time
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from pad_grasps import DISTANCE, GRIPS, PCA, DisplacedSpace, PadGrasp, displaced_poses, load_pad_grasp
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tactopose_drake.core.searches import MonteCarlo, Search, SimulatedAnnealing, corner_search
from tactopose_drake.estimation import Direct

POSES = MonteCarlo(scale=1.0).correction.particles  # number of poses that a search of the thesis evaluates
REFINED = 10  # number of poses that DIRECT and annealing refine
# Costs below which the Monte Carlo method stops, m and m^2: less than the minimum of most grips.
SCALES = {PCA: 0.01, DISTANCE: 1e-6}
OURS = "ours"
# [B16] table 5.2: average cost, average duration, s.
THESIS = {
    PCA: {"Monte Carlo": (0.1343, 16.4901), "DIRECT": (0.1058, 10.7876), "annealing": (0.1308, 38.6335)},
    DISTANCE: {"Monte Carlo": (1.2877, 20.7059), "DIRECT": (1.1102, 9.2987), "annealing": (1.1513, 30.7758)},
}
SEARCHES = (*THESIS[PCA], OURS)


class Outcome(NamedTuple):
    """Means over trials: the least cost that was found, and CPU time, s."""

    cost: float
    seconds: float


def make_search(name: str, objective: str, grasp: PadGrasp) -> Search:
    """A search by its name, for one of the objectives."""
    if name == OURS:
        return corner_search(grasp.model, grasp.patches)
    if name == "DIRECT":
        return Direct(max_evaluations=POSES, refined=REFINED)
    if name == "annealing":
        return SimulatedAnnealing(max_evaluations=POSES, refined=REFINED)
    return MonteCarlo(scale=SCALES[objective])


def run_trials(grasp: PadGrasp, trials: int, seed: tuple[int, int], label: str) -> dict[tuple[str, str], Outcome]:
    """Corrects the same displaced poses by every search, on both objectives; keys: objective, search."""
    starts = displaced_poses(grasp.X_PO, trials, np.random.default_rng(seed))
    outcomes = {}
    for key in [(objective, name) for objective in THESIS for name in SEARCHES]:
        search, objective = make_search(key[1], key[0], grasp), grasp.objectives[key[0]]
        generator = np.random.default_rng(seed)
        # Compiles, and computes what a model keeps.
        search.minimize(objective, DisplacedSpace(starts[0]), generator, should_stop=lambda: True)
        begin, cost = time.process_time(), 0.0
        described = f"{label}: {key[1]}, {key[0]}"
        for start in track(starts, described, console=Console(stderr=True), transient=True):
            cost += float(search.minimize(objective, DisplacedSpace(start), generator).cost[0])
        outcomes[key] = Outcome(cost / trials, (time.process_time() - begin) / trials)
    return outcomes


Results = dict[str, dict[tuple[str, str], Outcome]]  # by grip


def averages(results: Results) -> dict[tuple[str, str], Outcome]:
    """The means over the grips."""
    keys = next(iter(results.values()))
    return {key: Outcome(*np.mean([outcomes[key] for outcomes in results.values()], axis=0)) for key in keys}


def rows(results: Results) -> list[tuple[str, ...]]:
    """The table's cells as text, with the thesis' numbers in brackets."""
    means = averages(results)
    lines = []
    for objective, printed in THESIS.items():
        for i, heading in enumerate(("average cost", "average duration, s")):
            thesis = [f" ({printed[name][i]:g})" if name in printed else "" for name in SEARCHES]
            cells = [f"{means[objective, name][i]:.3g}" for name in SEARCHES]
            lines.append((objective, heading, *(a + b for a, b in zip(cells, thesis, strict=True))))
    return lines


def verdicts(results: Results) -> list[str]:
    """Sentences that state which search reaches the least average cost, and which is quickest."""
    means = averages(results)
    lines = []
    for objective in THESIS:
        cheapest = min(SEARCHES, key=lambda name: means[objective, name].cost)
        quickest = min(SEARCHES, key=lambda name: means[objective, name].seconds)
        ratio = means[objective, OURS].cost / min(means[objective, name].cost for name in THESIS[objective])
        lines.append(
            f"{objective}: least average cost by {cheapest}, quickest {quickest} (thesis: DIRECT, DIRECT); "
            f"the cost of ours is {ratio:.2f} of the best other's."
        )
    return lines


def markdown(results: Results, trials: int, seed: int) -> str:
    """The table and the verdicts as Markdown."""
    lines = [
        f"# Table 5.2, {len(results)} grips, {trials} trials each, seed {seed}",
        "",
        "In brackets the thesis' numbers, of its own input, units and machine.",
        "",
        "| objective | | " + " | ".join(SEARCHES) + " |",
        "|---|---|" + "---:|" * len(SEARCHES),
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows(results)]
    return "\n".join([*lines, "", *(f"- {line}" for line in verdicts(results)), ""])


def print_table(results: Results, console: Console) -> None:
    """Prints the table."""
    table = Table(title="Table 5.2 (in brackets: the thesis)", box=box.SIMPLE_HEAD, padding=0)
    for heading in ("objective", "", *SEARCHES):
        table.add_column(heading, justify="right" if heading in SEARCHES else "left")
    for row in rows(results):
        table.add_row(*(cell.replace(" (", "\n(") for cell in row))
    console.print(table)
    for line in verdicts(results):
        console.print(f"- {line}")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=20, show_default=True, help="Trials of each grip.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the displacements.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown table here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """Regenerates table 5.2 of the thesis, next to its numbers."""
    grasps = {name: load_pad_grasp(name, grip) for name, grip in GRIPS.items()}
    results = {name: run_trials(grasp, trials, (seed, i), name) for i, (name, grasp) in enumerate(grasps.items())}
    print_table(results, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_5_2.md").write_text(markdown(results, trials, seed), encoding="utf-8")


if __name__ == "__main__":
    main()
