"""Figures 3.25 and 3.26 of the thesis repeated: results of local searches from priors with large errors.

    python examples/thesis/figures_3_25_and_3_26.py --trials 200 --seed 0 --out out

A bust is touched at five contacts (0.9 mm, 5 degrees); the prior is off by up to 100 mm and 60 degrees. Gradient
descent (figure 3.25) and Levenberg-Marquardt (figure 3.26) start from it and end in the nearest minimum, whereas the
pair search covers all poses that are likely under the prior. The script prints how often each method ends within 10 mm
and 15 degrees of the truth and how often the errors decrease, and writes that as Markdown (figures_3_25_and_3_26.md)
with the plots of final against initial error (figures_3_25_and_3_26.png).

The prior has the standard deviation of the displacements along each axis. The thesis gives no numbers for these
figures.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 3.3.3.
"""

import math
from pathlib import Path

import click
import numpy as np
from grasp_library import Array
from grasp_trials import Errors, pose_errors
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import tactopose_drake as tp
from tactopose_drake.core.poses import retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

METHODS = {
    "gradient_descent": "Gradient descent (figure 3.25)",
    "levenberg_marquardt": "Levenberg-Marquardt (figure 3.26)",
    "pair_search": "Pair search (not in the thesis)",
}
MOST_TRANSLATION, MOST_ROTATION = 0.1, math.radians(60.0)
CONTACTS = 5


def displacement(generator: np.random.Generator) -> Array:
    """An increment with uniformly distributed length in a random direction."""
    turn, shift = (direction / np.linalg.norm(direction) for direction in generator.normal(size=(2, 3)))
    lengths = generator.uniform(size=2) * [MOST_ROTATION, MOST_TRANSLATION]
    return np.concatenate([lengths[0] * turn, lengths[1] * shift])


def run(trials: int, seed: int) -> tuple[Errors, dict[str, Errors]]:
    """The errors of the priors, and of each method's best poses."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    X_PO = np.eye(3, 4)
    guesses, found = [], {method: [] for method in METHODS}
    for trial in range(trials):
        generator = np.random.default_rng((seed, trial))
        contacts = touch_surface(model, X_PO, CONTACTS, generator)
        guess = retract(X_PO, displacement(generator))
        # The mean square of a uniform length is a third of its maximum's square, divided among three axes.
        prior = tp.PosePrior(guess, sigma_translation=MOST_TRANSLATION / 3.0, sigma_rotation=MOST_ROTATION / 3.0)
        guesses.append(guess)
        for method, poses in found.items():
            poses.append(tp.estimate_pose(model, contacts, prior=prior, method=method).best.X_PO.GetAsMatrix34())
    ended = {method: pose_errors(model, np.array(poses), X_PO) for method, poses in found.items()}
    return pose_errors(model, np.array(guesses), X_PO), ended


def markdown(initial: Errors, ended: dict[str, Errors], seed: int) -> str:
    """The table as Markdown."""
    lines = [f"# Figures 3.25 and 3.26, {len(initial.translation)} trials, seed {seed}", ""]
    lines += ["| search | within 10 mm and 15°, % | translation falls, % | rotation falls, % |", "|---|---:|---:|---:|"]
    for method, errors in ended.items():
        falls = [np.mean(final < first) for final, first in zip(errors, initial, strict=True)]
        shares = " | ".join(f"{100 * share:.0f}" for share in (errors.success.mean(), *falls))
        lines.append(f"| {METHODS[method]} | {shares} |")
    return "\n".join(lines) + "\n"


def plot(initial: Errors, ended: dict[str, Errors], path: Path) -> None:
    """Plots final against initial errors; points below the line have a decreased error."""
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    units = (("translation, mm", 1e3), ("rotation, °", math.degrees(1.0)))
    for column, (method, errors) in zip(
        figure.subplots(2, 3, sharex="row", sharey="row").T, ended.items(), strict=True
    ):
        for axes, first, final, (name, unit) in zip(column, initial, errors, units, strict=True):
            axes.plot(unit * first, unit * final, ".", markersize=4)
            most = unit * float(first.max())
            axes.plot([0, most], [0, most], color="#2e7d32")
            axes.set(xlabel=f"initial {name}", ylabel=f"final {name}")
        column[0].set_title(METHODS[method])
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=200, show_default=True, help="Guesses.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of touches and priors.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown and the plots here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """Figures 3.25 and 3.26 of the thesis repeated."""
    initial, ended = run(trials, seed)
    text = markdown(initial, ended, seed)
    print(text)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "figures_3_25_and_3_26.md").write_text(text, encoding="utf-8")
        plot(initial, ended, out / "figures_3_25_and_3_26.png")


if __name__ == "__main__":
    main()
