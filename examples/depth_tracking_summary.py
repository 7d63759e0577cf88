"""The table and the plot of the trials of `depth_tracking_study.py`."""

import dataclasses
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

# Source of the estimate's prior: a tracker, or none.
LEAVES_OUT, TAKES, NOTHING = "leaves out the hand", "takes the hand for the object", "no guess"
TRACKERS = {LEAVES_OUT: True, TAKES: False}
LIMIT = 12.59  # of a squared Mahalanobis distance in six dimensions, 95 %


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The results of one tracker, and of the touch that corrects it, at the end of a grasp; NaN if there is no pose.

    Attributes:
        vision: errors of the tracker's last pose, mm and deg.
        stated: its largest stated standard deviations, mm and deg.
        squared: its squared Mahalanobis error.
        hidden: the share of the object that the tracker believes hidden.
        touch: errors of the estimate, mm and deg.
        inside: whether the truth is in the estimate's 95 % set.
        status: status of the estimate.
    """

    vision: tuple[float, float]
    stated: tuple[float, float]
    squared: float
    hidden: float
    touch: tuple[float, float]
    inside: bool
    status: str


def row(name: str, what: str, outcomes: list[Outcome]) -> str:
    """A line of the table: medians, with the largest values in brackets."""

    def spread(values: list[float]) -> str:
        finite = np.array(values)[np.isfinite(values)]
        return f"{np.median(finite):.1f} ({finite.max():.1f})" if len(finite) else "-"

    seen = [outcome for outcome in outcomes if np.isfinite(outcome.squared)]
    cells = [
        name,
        what,
        str(len(outcomes)),
        spread([100.0 * outcome.hidden for outcome in seen]),
        *(spread([outcome.vision[i] for outcome in seen]) for i in (0, 1)),
        *(spread([outcome.stated[i] for outcome in seen]) for i in (0, 1)),
        f"{sum(outcome.squared < LIMIT for outcome in seen)} of {len(seen)}" if seen else "-",
        *(spread([outcome.touch[i] for outcome in outcomes]) for i in (0, 1)),
        f"{sum(outcome.inside for outcome in outcomes)} of {len(outcomes)}",
    ]
    return "| " + " | ".join(cells) + " |"


def markdown(results: dict[str, list[dict[str, Outcome]]], seeds: range) -> str:
    """The table, and whether it confirms the thesis' claim."""
    grasps = [trial for trials in results.values() for trial in trials]
    lines = [
        f"# Vision from pixels, corrected by touch: {len(grasps)} grasps of {len(results)} objects, "
        f"seeds {seeds.start} to {seeds.stop - 1}",
        "",
        "Medians, in brackets the largest; mm of the base centre, and degrees. *Stated*: the largest standard "
        "deviation along or about an axis that the tracker states. *Right*: the truth is in the tracker's ellipsoid, "
        "or the estimate's set, of 95 %.",
        "",
        "| object | the tracker | grasps | hidden, % | vision, mm | deg | stated, mm | deg | right | touch, mm | deg "
        "| right |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for what in (*TRACKERS, NOTHING):
        lines += [row(name, what, [trial[what] for trial in trials]) for name, trials in results.items() if trials]
        lines.append(row("**all**", what, [trial[what] for trial in grasps]))
    lines += ["", verdict(grasps)]
    return "\n".join(lines) + "\n"


def verdict(grasps: list[dict[str, Outcome]]) -> str:
    """Whether the thesis' claim holds: vision fails on the held object, and touch corrects it."""
    failing = [trial[TAKES] for trial in grasps]
    off = np.array([outcome.vision[0] for outcome in failing])
    touched = np.array([outcome.touch[0] for outcome in failing])
    told, answers = sum(outcome.squared < LIMIT for outcome in failing), int(np.isfinite(off).sum())
    inside = sum(outcome.inside for outcome in failing)
    better = int(np.sum((touched < off) | ~np.isfinite(off)))
    if answers:
        fails = f"is off by {np.nanmean(off):.0f} mm on average here where it has an answer, in {answers},"
    else:
        fails = "loses the object in every grasp here,"
    return (
        "The thesis measured 80 to 86 mm of vision on a held object and 20 to 27 mm after touch. The tracker that "
        f"takes the hand for the object {fails} and touch gives {np.nanmean(touched):.1f} mm: the claim "
        f"{'holds' if better >= 0.95 * len(failing) else 'does not hold'} (the error falls, or there was no pose, in "
        f"{better} of {len(failing)}). Its covariance says so in {told} of the {answers} grasps in "
        f"which it has an answer; the truth is in the estimate's set of 95 % in {inside}. A tracker that leaves out "
        "the hand's pixels does not fail like this: "
        f"{np.nanmean([trial[LEAVES_OUT].vision[0] for trial in grasps]):.1f} mm on average."
    )


def save_plot(results: dict[str, list[dict[str, Outcome]]], path: Path) -> None:
    """Plots each tracker's error over its stated standard deviation, and the error after touch over that before."""
    figure, axes = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    colours = dict(zip(results, ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"), strict=False))
    for name, trials in results.items():
        for tracker, marker in ((LEAVES_OUT, "o"), (TAKES, "^")):
            outcomes = [trial[tracker] for trial in trials]
            vision = [outcome.vision[0] for outcome in outcomes]
            style = {"color": colours[name], "marker": marker, "linestyle": "none", "fillstyle": "none"}
            axes[0].plot([outcome.stated[0] for outcome in outcomes], vision, **style)
            axes[1].plot(
                vision, [outcome.touch[0] for outcome in outcomes], label=f"{name}; the tracker {tracker}", **style
            )
    for axis in axes:
        axis.set(xscale="log", yscale="log")
        axis.axline((1.0, 1.0), (100.0, 100.0), color="0.6", linewidth=1.0)
        axis.grid(alpha=0.3)
    axes[0].set(xlabel="largest standard deviation stated, mm", ylabel="error of vision, mm")
    axes[1].set(xlabel="error of vision, mm", ylabel="error after touch, mm")
    axes[1].axhspan(20.0, 26.6, color="0.85", label="thesis, after touch")
    axes[1].axvspan(80.2, 85.8, color="0.85")
    axes[1].legend(fontsize="x-small")
    figure.savefig(path, dpi=120)
    plt.close(figure)
