"""Accuracy, consistency and speed of the belief while an object moves in the hand.

python examples/in_hand_motions.py --motions 200

There are four families of motions, with contacts on the true mesh at 100 Hz: a screwdriver is rotated about its axis, a
cylinder is rolled between thumb and fingers, objects are moved by the fingertips, and objects slip under load. Each
begins with a prior that is 33 mm and 16 degrees off. The belief knows the standard deviations of the contacts' noise,
and of the fingertips' velocities; it does not know of the slip. With `--calibration 4`, the constant part of the errors
is four times as large as the belief assumes; with `--fault off`, one finger's contact is always 10 to 30 mm off; with
`--fault flipped`, its normal is flipped.

A mode is right if the truth, or a symmetry image of it, is in the ellipsoid with 99.9 % of its Gaussian. If one mode
has more than 99 % of the probability, and the status is not "lost", the normalized estimation error squared (NEES) is
computed, whose mean is 6 for a consistent belief; rotations about an axis of symmetry are excluded, and the NEES is
then scaled from five dimensions to six. The errors within one motion are nearly constant, like those of a calibration.
Therefore, the standard error of the mean is that of the motions' means.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from motion_families import FAMILIES
from motion_trial import Instant, run_motion
from rich.progress import track
from scipy.stats import chi2


@dataclasses.dataclass(frozen=True)
class Figures:
    """The results of one family, with the delays until each slip is detected, and recovered from after its end."""

    motions: int
    instants: int
    right: float
    best_right: float
    ok_but_wrong: float
    unique: float
    square: float
    square_error: float
    translation: float
    rotation: float
    median: float
    slowest: float
    detected: tuple[float, ...]
    recovered: tuple[float, ...]


def figures(runs: list[list[Instant]]) -> Figures:
    """The means over all instants of all motions."""
    instants = [instant for run in runs for instant in run]
    of_runs = [[instant.square for instant in run if instant.unique] for run in runs]
    squares = np.array([square for of_run in of_runs for square in of_run])
    sums = np.array([np.sum(np.array(of_run) - squares.mean()) for of_run in of_runs]) if len(squares) else np.zeros(1)
    seconds = [instant.seconds for instant in instants]
    detected, recovered = [], []
    for run in runs:
        begins = [i for i in range(1, len(run)) if run[i].slides and not run[i - 1].slides]
        ends = [i for i in range(1, len(run)) if run[i - 1].slides and not run[i].slides]
        detected += [next((b.time - run[i].time for b in run[i:] if b.status == "slipping"), np.inf) for i in begins]
        recovered += [next((b.time - run[i].time for b in run[i:] if b.right), np.inf) for i in ends]
    return Figures(
        motions=len(runs),
        instants=len(instants),
        right=float(np.mean([instant.right for instant in instants])),
        best_right=float(np.mean([instant.best_right for instant in instants])),
        ok_but_wrong=float(np.mean([instant.ok_but_wrong for instant in instants])),
        unique=len(squares) / len(instants),
        square=float(squares.mean()) if len(squares) else np.nan,
        square_error=float(np.sqrt(np.sum(sums**2)) / len(squares)) if len(squares) else np.nan,
        translation=float(np.sqrt(np.nanmean([instant.translation**2 for instant in instants]))),
        rotation=float(np.sqrt(np.nanmean([instant.rotation**2 for instant in instants]))),
        median=float(np.median(seconds)),
        slowest=float(np.quantile(seconds, 0.99)),
        detected=tuple(detected),
        recovered=tuple(recovered),
    )


def line(name: str, f: Figures) -> str:
    """The results as text."""
    text = (
        f"{name}: {f.motions} motions, {f.instants} instants; a right mode in {f.right:.1%}, the best is right in "
        f'{f.best_right:.1%}, "ok" while wrong in {f.ok_but_wrong:.2%}; '
        f"unique in {f.unique:.0%}, NEES there {f.square:.2f} +- {f.square_error:.2f} (honest: 6); "
        f"errors {1e3 * f.translation:.2f} mm, {np.degrees(f.rotation):.2f} deg rms; "
        f"update {1e3 * f.median:.2f} ms median, {1e3 * f.slowest:.2f} ms at 99 %"
    )
    if f.recovered:
        late = [seconds for seconds in f.recovered if seconds > 0.2]
        seen = [seconds for seconds in f.detected if np.isfinite(seconds)]
        text += (
            f"; {len(f.recovered)} slips: {len(seen)} called so"
            + (f", after {1e3 * np.median(seen):.0f} ms in the median" if seen else "")
            + f"; {len(f.recovered) - len(late)} right within 200 ms of their end"
        )
    return text


def save_figure(runs: dict[str, list[list[Instant]]], path: Path) -> None:
    """Plots one motion of each family over time, and the distribution of the NEES of all."""
    figure = Figure(figsize=(16, 3.4 * len(runs)), layout="constrained")
    axes = figure.subplots(len(runs), 3, squeeze=False)
    for (family, motions), row in zip(runs.items(), axes, strict=True):
        run = motions[0]
        t = [instant.time for instant in run]
        for ax, unit, error, said in (
            (row[0], "mm", [1e3 * i.translation for i in run], [1e3 * i.said_translation for i in run]),
            (row[1], "deg", np.degrees([i.rotation for i in run]), np.degrees([i.said_rotation for i in run])),
        ):
            ax.plot(t, error, label="error")
            ax.plot(t, said, "--", label="standard deviation that the belief states")
            for name, color in (("slipping", "#b9589f"), ("ambiguous", "#e8b23a"), ("lost", "#9b2226")):
                there = [instant.status == name for instant in run]
                if any(there):
                    ax.fill_between(t, 0, 1, where=there, transform=ax.get_xaxis_transform(), alpha=0.2, color=color)
                    ax.plot([], [], color=color, alpha=0.4, linewidth=6, label=f"it says {name}")
            slides = [instant.slides for instant in run]
            if any(slides):
                ax.fill_between(t, 0, 0.03, where=slides, transform=ax.get_xaxis_transform(), color="0.3")
                ax.plot([], [], color="0.3", linewidth=4, label="it truly slides")
            ax.set(xlabel="time, s", ylabel=f"of the first motion, {unit}", title=family, yscale="log")
        squares = [i.square for motion in motions for i in motion if i.unique]
        grid = np.linspace(0, 30, 121)
        row[2].hist(np.minimum(squares, 29.9), bins=60, range=(0, 30), density=True, alpha=0.5, label="all motions")
        row[2].plot(grid, chi2.pdf(grid, 6), label="chi-square, 6 degrees of freedom: an honest belief")
        row[2].set(
            xlabel="normalised estimation error squared (the last bin: and more)", ylabel="density", title=family
        )
        row[2].legend(fontsize=7)
    # A common legend outside the axes.
    named = {label: handle for ax in axes[:, 0] for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(list(named.values()), list(named), loc="outside upper left", ncols=len(named))
    FigureCanvasAgg(figure).print_png(path)


def main() -> None:
    """Prints the figures of each family and of all, and draws them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=200, help="in all, shared out among the families")
    parser.add_argument("--steps", type=int, default=200, help="of 10 ms each")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--calibration", type=float, default=1.0, help="what lasts of the errors, over what is told")
    parser.add_argument("--fault", default="none", choices=["none", "off", "flipped"], help="of one of the fingers")
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES))
    parser.add_argument("--out", type=Path, default=Path("out/in_hand_motions"))
    arguments = parser.parse_args()
    each = max(1, arguments.motions // len(arguments.families))
    run_motion(arguments.families[0], arguments.first_seed, 3)  # The first compiles.
    runs = {
        family: [
            run_motion(family, arguments.first_seed + seed, arguments.steps, arguments.calibration, arguments.fault)
            for seed in track(range(each), description=family)
        ]
        for family in arguments.families
    }
    lines = [line(family, figures(motions)) for family, motions in runs.items()]
    lines.append(line("all", figures([motion for motions in runs.values() for motion in motions])))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "in_hand_motions.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(runs, arguments.out / "in_hand_motions.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
