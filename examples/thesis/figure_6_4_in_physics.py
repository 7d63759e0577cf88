"""Figure 6.4 of the thesis in simulated physics: a hand explores with free fingers until the held pose is known.

    python examples/thesis/figure_6_4_in_physics.py --grasps 30 --out out

Three fingers grasp an object. If that leaves its pose ambiguous, the other fingers explore one after the other, with
motions that the diagram chooses by expected information, and in a second run at random. `physical_touches.py` states
what is simulated and counted. The script prints, and writes as figure_6_4_in_physics.md and .png, the number of
touches, how often the final pose is the true one, and how far the object moved in the hand meanwhile. Results in the
journal in `--out` are not simulated again. A grasp takes one to three minutes of one core.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.3.
"""

import dataclasses
import functools
import itertools
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from physical_touches import (
    AMBIGUOUS,
    MOST_TOUCHES,
    OUTCOMES,
    PhysicalExploration,
    explore_in_physics,
    scenario_of,
)
from rich.console import Console
from trial_journal import TrialJournal

import tactopose_drake as tp
from tactopose_drake.core.grasping import GraspPlan
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import model_path
from tactopose_drake.station import make_station, plan_scenario

OBJECTS = ("bust", "screwdriver", "spray_bottle")
RULES = {"information": "by information", "chance": "at random"}

Runs = dict[str, list[PhysicalExploration]]  # by rule


def study(grasps: int, first_seed: int, journal: TrialJournal) -> Runs:
    """Explores a number of ambiguous grasps, with the objects in turn, by each rule."""
    runs: Runs = {rule: [] for rule in RULES}
    for seed, name in ((seed, name) for seed in itertools.count(first_seed) for name in OBJECTS):
        if len(runs["information"]) >= grasps:
            break
        for rule in RULES:
            key = {"object": name, "seed": seed, "rule": rule}
            if key not in journal:
                journal.add(key, dataclasses.astuple(explore(name, seed, rule)))
            run = PhysicalExploration(*journal[key])
            if OUTCOMES[int(run.outcome)] in ("no grasp", "not ambiguous"):
                break
            runs[rule].append(run)
    return runs


@functools.cache
def model_of(name: str) -> tp.ObjectModel:
    """The model of one of the package's objects."""
    return tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))


@functools.lru_cache(maxsize=1)
def plan_of(name: str, seed: int) -> GraspPlan | None:
    """The grasp plan, which is the same for both rules; None if these three fingers cannot hold the object."""
    try:
        return plan_scenario(scenario_of(name, seed, next(iter(RULES))), model_of(name))[0]
    except InvalidInputError:
        return None


def explore(name: str, seed: int, rule: str) -> PhysicalExploration:
    """Explores one grasp by one rule."""
    plan = plan_of(name, seed)
    if plan is None:
        return PhysicalExploration(OUTCOMES.index("no grasp"))
    return explore_in_physics(make_station(scenario_of(name, seed, rule), plan, model=model_of(name)))


HEADINGS = ("next touch", "grasps", "one pose", "of these right", "mean touches", "slipped", "median moved, mm")


def rows(runs: Runs) -> list[tuple[str, ...]]:
    """For each rule: grasps, how many ended with one pose, how many of these right, touches, slips, and motion."""
    lines = []
    for rule, explorations in runs.items():
        unique = [run for run in explorations if OUTCOMES[int(run.outcome)] == "unique"]
        touches = [run.touches if run in unique else MOST_TOUCHES for run in explorations]
        lines.append(
            (
                RULES[rule],
                str(len(explorations)),
                str(len(unique)),
                str(sum(int(run.right) for run in unique)),
                f"{np.mean(touches):.2f}" if touches else "",
                str(sum(OUTCOMES[int(run.outcome)] == "the object slipped" for run in explorations)),
                f"{1e3 * np.median([run.moved for run in explorations]):.1f}" if explorations else "",
            )
        )
    return lines


def markdown(runs: Runs) -> str:
    """The table as Markdown, and what it says about the thesis' statement."""
    lines = [
        "# Figure 6.4 in physics: touches until one pose is left",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "|---|---:|---:|---:|---:|---:|---:|",
        *("| " + " | ".join(row) + " |" for row in rows(runs)),
        "",
        f"Grasps by three fingers with less than {AMBIGUOUS:.0%} of the belief about one pose. Mean touches count "
        f"{MOST_TOUCHES} where no one pose was left.",
    ]
    return "\n".join([*lines, ""])


def plot(runs: Runs, path: Path) -> None:
    """Plots the share of the belief about one pose before and after, and the number of touches."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    width = 0.38
    for shift, (rule, colour) in zip((-0.2, 0.2), zip(RULES, ("tab:blue", "tab:gray"), strict=True), strict=True):
        unique = [run for run in runs[rule] if OUTCOMES[int(run.outcome)] == "unique"]
        touches = [run.touches if run in unique else MOST_TOUCHES for run in runs[rule]]
        counts = np.bincount(np.array(touches, dtype=np.intp), minlength=MOST_TOUCHES + 1)
        left.bar(np.arange(len(counts)) + shift, counts, width, label=RULES[rule], color=colour)
        for run in runs[rule]:
            mark = "o" if run.right else "x"
            right.plot([run.share_before], [run.share_after], mark, color=colour, markersize=5)
    left.set(xlabel=f"touches until 95 % lie about one pose ({MOST_TOUCHES}: or more, or never)", ylabel="grasps")
    left.legend()
    right.axhline(0.95, color="k", linewidth=0.6)
    right.set(xlabel="share of the belief about one pose, before", ylabel="at the end", xlim=(0, 1), ylim=(0, 1.03))
    right.set_title("o: the true pose, x: another", fontsize=9)
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--grasps", type=click.IntRange(min=1), default=30, show_default=True, help="Ambiguous grasps in all.")
@click.option("--first-seed", type=click.IntRange(min=0), default=0, show_default=True, help="First seed of grasps.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes table and plot here, and keeps the journal.")
def main(grasps: int, first_seed: int, out: Path | None) -> None:
    """Counts the touches that a simulated hand needs until the pose of the held object is known."""
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    runs = study(grasps, first_seed, TrialJournal(None if out is None else out / "figure_6_4_in_physics.jsonl"))
    text = markdown(runs)
    Console().print(text, highlight=False, markup=False)
    if out is not None:
        (out / "figure_6_4_in_physics.md").write_text(text, encoding="utf-8")
        plot(runs, out / "figure_6_4_in_physics.png")


if __name__ == "__main__":
    main()
