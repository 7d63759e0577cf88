"""An upper bound of the success rate in section 4.3.1 of the thesis, computed from the belief itself.

    python examples/thesis/section_4_3_1_bound.py --trials 100 --seed 0 --out out

Prints a table; writes it as Markdown (section_4_3_1_bound.md) with a figure (section_4_3_1_bound.png). The trials are
those of `section_4_3_1.py`: its grasps are simulated once and kept.

The thesis states that a corrected pose is right, within 10 mm and 15 degrees, in over 80 % of the trials if at least
four fingers touch and the noise is below 1.8 mm and 10 degrees. If our estimates are not, is the search the cause, or
the touch? A calibrated belief answers that: for any answer, the probability that it is right is the belief's
probability within the limits around it. The answer that maximises this probability is right as often as any answer can
be, and its expected success rate is the mean of this probability over the trials. This is a bound for every estimate
from the same touch, noise and prior. The belief is credible if this best answer is actually right about as often as the
belief promises.

The belief is that of `tp.estimate_pose` without false contacts (`outlier_probability=0`), drawn from its hypotheses.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from experiment_runs import Bench
from grasp_library import Array, make_library, make_scenario
from grasp_trials import Trial, pose_errors
from matplotlib.figure import Figure
from pose_experiments import CELLS, CORRECTION, FINGER_COUNTS, GLOBAL, LEVELS, MAIN_CELL, Cell, Experiment
from rich.console import Console
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.poses import retract

SAMPLES, CANDIDATES = 800, 60  # samples of a belief, and how many of them are tried as answers
EXPERIMENTS = {experiment.name: experiment for experiment in (CORRECTION, GLOBAL)}


class Outcome(NamedTuple):
    """One trial, or means over several.

    Attributes:
        most_probable: whether the most probable hypothesis of the default call is right.
        best_answer: whether the answer with the largest probability within the limits is right.
        promised: that probability.
    """

    most_probable: float
    best_answer: float
    promised: float


def draw(estimate: tp.PoseEstimate, count: int, generator: np.random.Generator) -> Array:
    """Poses drawn from the belief, shape (count, 3, 4)."""
    probability = np.array([hypothesis.probability for hypothesis in estimate.hypotheses])
    which = generator.choice(len(probability), count, p=probability / probability.sum())
    roots = np.array([np.linalg.cholesky(h.covariance + 1e-14 * np.eye(6)) for h in estimate.hypotheses])
    X_PO = np.array([h.X_PO.GetAsMatrix34() for h in estimate.hypotheses])
    return retract(X_PO[which], np.einsum("bij,bj->bi", roots[which], generator.normal(size=(count, 6))))


def best_answer(model: tp.ObjectModel, X_PO: Array, candidates: Array) -> tuple[Array, float]:
    """The candidate (3, 4) with the largest share of the belief's poses (n, 3, 4) within the limits, and that share."""
    shares = [float(np.mean(pose_errors(model, X_PO, candidate).success)) for candidate in candidates]
    best = int(np.argmax(shares))
    return candidates[best], shares[best]


def judge(model: tp.ObjectModel, trial: Trial, generator: np.random.Generator) -> Outcome:
    """Evaluates one trial; the share is counted on samples that are independent of those that chose the answer."""
    default = tp.estimate_pose(model, trial.contacts, prior=trial.prior)
    taken = tp.estimate_pose(model, trial.contacts, prior=trial.prior, outlier_probability=0.0)
    X_PO = draw(taken, 2 * SAMPLES, generator)
    own = np.array([h.X_PO.GetAsMatrix34() for h in taken.hypotheses[:CANDIDATES]])
    answer, _ = best_answer(model, X_PO[:SAMPLES], np.concatenate([own, X_PO[:CANDIDATES]]))
    promised = float(np.mean(pose_errors(model, X_PO[SAMPLES:], answer).success))
    guesses = np.stack([default.best.X_PO.GetAsMatrix34(), answer])
    right = pose_errors(model, guesses, trial.X_PO).success
    return Outcome(float(right[0]), float(right[1]), promised)


def run(experiment: Experiment, trials: int, seed: int) -> dict[Cell, Outcome]:
    """The means of every cell."""
    bench = Bench(
        experiment,
        make_scenario(experiment.object).object_model(),
        make_library(experiment.object, trials),
        seed,
    )
    cells: dict[Cell, Outcome] = {}
    for cell in track(CELLS, experiment.name, console=Console(stderr=True), transient=True):
        made = [judge(bench.model, bench.trial(i, cell), np.random.default_rng((seed, i))) for i in range(trials)]
        cells[cell] = Outcome(*np.mean(made, axis=0))
    return cells


def verdicts(results: dict[str, dict[Cell, Outcome]]) -> list[str]:
    """Sentences that compare the thesis' claims with the bound."""
    lines = []
    claims = {CORRECTION.name: LEVELS[2], GLOBAL.name: MAIN_CELL.noise}  # the noise that the thesis states
    for name, cells in results.items():
        experiment, noise = EXPERIMENTS[name], claims[name]
        for fingers in (count for count in FINGER_COUNTS if count >= experiment.success_fingers):
            found = cells[Cell(fingers, noise)]
            holds = found.best_answer > experiment.success
            lines.append(
                f"{name}, {fingers} fingers, {noise}: the thesis says over {100 * experiment.success:.0f} % below this "
                f"noise; the most probable pose is right in {100 * found.most_probable:.0f} %, the best answer in "
                f"{100 * found.best_answer:.0f} %, and the belief allows {100 * found.promised:.0f} % to any estimate: "
                f"at this noise the claim {'holds' if holds else 'does NOT hold'}."
            )
        off = np.array([cell.best_answer - cell.promised for cell in cells.values()])
        lines.append(
            f"{name}: over the {len(cells)} cells the best answer is right more often than the belief promises by "
            f"{100 * off.mean():+.1f} percentage points ({100 * off.min():+.0f} to {100 * off.max():+.0f} in a cell)."
        )
    return lines


def markdown(results: dict[str, dict[Cell, Outcome]], trials: int, seed: int) -> str:
    """The table and the verdicts as Markdown."""
    lines = [f"# What the touch allows in section 4.3.1, {trials} trials a cell, seed {seed}", ""]
    lines += ["Share of trials within 10 mm and 15 degrees, %.", ""]
    lines += ["| experiment | fingers | noise | most probable | best answer | any estimate, at most |"]
    lines += ["|---|---:|---|---:|---:|---:|"]
    for name, cells in results.items():
        for cell, found in cells.items():
            shares = " | ".join(f"{100 * share:.0f}" for share in found)
            lines.append(f"| {name} | {cell.fingers} | {cell.noise} | {shares} |")
    return "\n".join([*lines, "", *(f"- {line}" for line in verdicts(results)), ""])


def plot(results: dict[str, dict[Cell, Outcome]], path: Path) -> None:
    """Plots the shares against the noise for each experiment, with a colour for each number of fingers."""
    figure = Figure(figsize=(6.5 * len(results), 5), layout="constrained")
    for axes, (name, cells) in zip(figure.subplots(1, len(results), squeeze=False)[0], results.items(), strict=True):
        for fingers, color in zip(FINGER_COUNTS, ("tab:red", "tab:orange", "tab:blue"), strict=True):
            found = np.array([cells[Cell(fingers, noise)] for noise in LEVELS])
            axes.plot(100 * found[:, 1], "o", color=color, label=f"{fingers} fingers, best answer")
            axes.plot(100 * found[:, 0], "x", color=color, label=f"{fingers} fingers, most probable pose")
            axes.plot(100 * found[:, 2], "-", color=color, label=f"{fingers} fingers, allowed by the belief")
        axes.axhline(100 * EXPERIMENTS[name].success, color="0.7", linewidth=0.8)
        axes.set_xticks(range(len(LEVELS)), [str(noise) for noise in LEVELS])
        axes.set(title=f"{name}; line: the thesis' words", xlabel="noise", ylabel="right, %", ylim=(0.0, 100.0))
        axes.legend(fontsize=7)
    figure.savefig(path, format="png")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Trials of each cell.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise and displacements.")
@click.option("--only", type=click.Choice(list(EXPERIMENTS)), help="Runs only this one of the two experiments.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the table and the figure here.")
def main(trials: int, seed: int, only: str | None, out: Path | None) -> None:
    """An upper bound of the success rate in section 4.3.1 of the thesis."""
    chosen = [experiment for name, experiment in EXPERIMENTS.items() if only in (None, name)]
    results = {experiment.name: run(experiment, trials, seed) for experiment in chosen}
    text = markdown(results, trials, seed)
    print(text)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "section_4_3_1_bound.md").write_text(text, encoding="utf-8")
        plot(results, out / "section_4_3_1_bound.png")


if __name__ == "__main__":
    main()
