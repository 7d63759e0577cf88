"""Figures 4.5 and 4.19 of the thesis repeated: the progress of the global search, and the costs that it evaluates.

    python examples/thesis/search_progress.py --seed 0 --out out

Corrects the pose of the bust from five synthetic contacts (0.9 mm, 5 degrees) by the thesis' search with its own cost,
eq. 4.1. Prints the result next to the thesis' numbers and writes it as Markdown (search_progress.md) with both figures:
the cost of each particle with the average of the last 200 and the minimum so far (figure_4_5.png), and each particle's
cost against each of its seven parameters, with the least cost for each value as a line (figure_4_19.png). Distances are
in m; the thesis does not state the unit of distance in its costs, so that the costs themselves cannot be compared.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, sections 4.2.6 and 4.3.3.
"""

from pathlib import Path

import click
import numpy as np
from grasp_library import Array
from grasp_trials import GUESS_SIGMA_ROTATION, GUESS_SIGMA_TRANSLATION, Trial, pose_errors
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from published_search import published_problem

import tactopose_drake as tp
from tactopose_drake.core.poses import retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

CONTACTS = 5
SIGMA_POSITION, SIGMA_NORMAL = 0.0009, np.radians(5.0)
AVERAGED = 200  # particles in the running average. [B16] figure 4.5
BINS = 60  # bins of each parameter, for the line of least cost
PARAMETERS = ("q_w", "q_x", "q_y", "q_z", "t_x, mm", "t_y, mm", "t_z, mm")
BLUE, RED, GREEN = "#0072b2", "#d55e00", "#009e73"  # distinguishable with colour blindness
# [B16] sections 4.2.6 and 4.3.3.
THESIS_PARTICLES = 15_000


def make_trial(model: tp.ObjectModel, seed: int) -> Trial:
    """A random touch of the object, and a prior with the thesis' distribution."""
    generator = np.random.default_rng(seed)
    X_PO = np.eye(3, 4)
    contacts = touch_surface(model, X_PO, CONTACTS, generator, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    sigmas = np.repeat([GUESS_SIGMA_ROTATION, GUESS_SIGMA_TRANSLATION], 3)
    guess = retract(X_PO, generator.normal(size=6) * sigmas)
    prior = tp.PosePrior(guess, sigma_translation=GUESS_SIGMA_TRANSLATION, sigma_rotation=GUESS_SIGMA_ROTATION)
    no_hand = tp.HandGeometry([[1.0, 0.0, 0.0]], [0.001])  # far away
    return Trial(contacts, prior, no_hand, X_PO)


def progress_figure(cost: Array) -> Figure:
    """Plots [B16] figure 4.5."""
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    count = np.arange(1, len(cost) + 1)
    average = np.convolve(cost, np.full(AVERAGED, 1.0 / AVERAGED), mode="valid")
    axes.plot(count, cost, ".", markersize=1.0, color=BLUE, alpha=0.4, label="each particle")
    axes.plot(count[AVERAGED - 1 :], average, color=RED, label=f"average of the last {AVERAGED}")
    axes.plot(count, np.minimum.accumulate(cost), color=GREEN, linewidth=2.0, label="least so far")
    axes.set(yscale="log", xlabel="particles", ylabel="cost, eq. 4.1", title="Progress of the search")
    axes.legend(markerscale=8.0)
    return figure


def least_costs(values: Array, cost: Array) -> tuple[Array, Array]:
    """The centres of the bins that contain a value, and the least cost in each."""
    edges = np.linspace(values.min(), values.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, BINS - 1)
    least = np.full(BINS, np.inf)
    np.minimum.at(least, place, cost)
    held = np.isfinite(least)
    return 0.5 * (edges[1:] + edges[:-1])[held], least[held]


def landscape_figure(particles: Array, cost: Array) -> Figure:
    """Plots [B16] figure 4.19: seven parameters next to each other, with the same scale of the cost."""
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    scaled = particles * np.repeat([1.0, 1e3], [4, 3])
    for axes, name, values in zip(figure.subplots(1, 7, sharey=True), PARAMETERS, scaled.T, strict=True):
        axes.plot(values, cost, ".", markersize=1.0, color=BLUE, alpha=0.3)
        axes.plot(*least_costs(values, cost), color=RED)
        axes.set(xlabel=name, yscale="log")
    figure.axes[0].set_ylabel("cost, eq. 4.1")
    figure.suptitle("Every particle's cost over each of its seven numbers; least cost as a line")
    return figure


@click.command()
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of touch and search.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown and the plots here.")
def main(seed: int, out: Path | None) -> None:
    """Figures 4.5 and 4.19 of the thesis repeated."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    trial = make_trial(model, seed)
    problem = published_problem(model, trial)
    particles, cost = problem.search.evolve(problem.objective, problem.space, np.random.default_rng(seed))
    found = problem.search.minimize(problem.objective, problem.space, np.random.default_rng(seed)).X_PO[:1]
    assert trial.prior is not None
    before, after = (pose_errors(model, X_PO, trial.X_PO) for X_PO in (trial.prior.mean[None], found))
    lines = [
        f"# Figures 4.5 and 4.19, seed {seed}",
        "",
        f"- {len(cost)} particles until the search stopped (thesis: {THESIS_PARTICLES}).",
        f"- Least cost {cost.min():.4f}, with x = {np.round(particles[cost.argmin()], 3).tolist()}.",
        f"- The guess is {1e3 * before.translation[0]:.1f} mm and {np.degrees(before.rotation[0]):.1f}° off, the best "
        f"pose {1e3 * after.translation[0]:.1f} mm and {np.degrees(after.rotation[0]):.1f}°.",
    ]
    print("\n".join(lines))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "search_progress.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        for name, figure in (
            ("figure_4_5", progress_figure(cost)),
            ("figure_4_19", landscape_figure(particles, cost)),
        ):
            FigureCanvasAgg(figure).print_png(out / f"{name}.png")


if __name__ == "__main__":
    main()
