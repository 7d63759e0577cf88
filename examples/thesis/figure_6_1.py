"""Figure 6.1 of the thesis repeated: identification of the held object among four.

    python examples/thesis/figure_6_1.py --grasps 10 --seed 0 --out out

Each of four objects is held in simulated grasps by five fingers (see `grasp_library.py`), with 0.9 mm and 5 degrees of
noise on the contacts (interpreted as in `grasp_trials.py`). The pose of every object is estimated from the contacts
alone. The thesis ranks the objects by l_i = (1 / G_i) / sum_k (1 / G_k), where G_i is the lowest cost. We rank them by
the evidence, which takes into account how many poses explain the touch, and how well. One grasp is shown as in the
figure, with the best pose of each object and the likelihoods. The table evaluates both measures over all grasps.

In the thesis' grasp "the object is correctly identified (object 2), with the glass (object 4) resulting also in a low
cost, due to its similar shape and size"; it gives no numbers for more grasps. Our object 2 is the mug.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.2.1.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click
import numpy as np
from grasp_library import make_library, make_scenario
from grasp_trials import Noise
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.visualization import Scene, ShownHypothesis, save_picture

OBJECTS = ("bust", "mug", "tea_box", "wine_glass")
SHOWN = "mug"
NOISE = Noise(0.0009, math.radians(5.0))


class Trial(NamedTuple):
    """One grasp: the held object and the results of both measures."""

    held: str
    contacts: tp.Contacts
    evidence: tp.Identification
    inverse_cost: tp.Identification


def make_contacts(p_PC: NDArray[np.float64], n_PC: NDArray[np.float64], seed: tuple[int, ...]) -> tp.Contacts:
    """The true contact points and normals with noise."""
    unit = np.random.default_rng(seed).normal(size=(2, *p_PC.shape))
    return tp.Contacts(
        p_PC + NOISE.position * unit[0],
        np.einsum("kij,kj->ki", exp_so3(NOISE.normal * unit[1]), n_PC),
        sigma_position=NOISE.position,
        sigma_normal=NOISE.normal,
    )


def run_trials(models: Sequence[tp.ObjectModel], grasps: int, seed: int) -> list[Trial]:
    """Runs all grasps of all objects."""
    trials = []
    for i, model in enumerate(models):
        library = make_library(model.name, grasps)
        for k, grasp in enumerate(track(library, model.name, console=Console(stderr=True), transient=True)):
            contacts = make_contacts(grasp.p_PC, grasp.n_PC, (seed, i, k))
            by_evidence = tp.identify(models, contacts)
            by_cost = tp.identify(models, contacts, likelihood="inverse_cost")
            trials.append(Trial(model.name, contacts, by_evidence, by_cost))
    return trials


def lowest_cost(identity: tp.Identity) -> float:
    """G_i: the cost of the object's best pose."""
    assert identity.estimate is not None
    return min(hypothesis.cost for hypothesis in identity.estimate.hypotheses)


def grasp_table(trial: Trial) -> Table:
    """A table of both measures for each object in one grasp."""
    title = f"The {trial.held} is held"
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("object")
    for heading in ("lowest cost", "thesis' likelihood, %", "log evidence", "likelihood, %"):
        table.add_column(heading, justify="right")
    by_cost = {identity.index: identity for identity in trial.inverse_cost}
    for identity in sorted(trial.evidence, key=lambda identity: identity.index):
        other = by_cost[identity.index]
        table.add_row(
            f"{identity.index + 1} {identity.name}",
            f"{lowest_cost(other):.2f}",
            f"{100 * other.likelihood:.1f}",
            f"{identity.log_evidence:.1f}",
            f"{100 * identity.likelihood:.1f}",
        )
    return table


def count_table(trials: Sequence[Trial]) -> Table:
    """A table of how often each measure identifies the held object, and of the likelihood that it states."""
    table = Table(title=f"{len(trials)} grasps", box=box.SIMPLE_HEAD)
    table.add_column("held object")
    for heading in ("named by lowest cost, %", "likelihood, %", "named by evidence, %", "likelihood, %"):
        table.add_column(heading, justify="right")
    for name in (*dict.fromkeys(trial.held for trial in trials), "all"):
        chosen = [trial for trial in trials if name in (trial.held, "all")]
        cells = []
        for found in ([t.inverse_cost for t in chosen], [t.evidence for t in chosen]):
            names = [trial.held for trial in chosen]
            first = [f.best.name == held for f, held in zip(found, names, strict=True)]
            share = [i.likelihood for f, held in zip(found, names, strict=True) for i in f if i.name == held]
            cells += [f"{100 * np.mean(first):.0f}", f"{100 * np.mean(share):.0f}"]
        table.add_row(name, *cells)
    return table


def draw(path: Path, trial: Trial, models: Sequence[tp.ObjectModel]) -> None:
    """Draws the best pose of each object with the contacts, and the likelihoods by both measures."""
    figure = Figure(figsize=(13.0, 6.4), dpi=100)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, len(models), height_ratios=(2.2, 1.0), hspace=0.05, wspace=0.03, left=0.05, right=0.98, top=0.94, bottom=0.06
    )
    likelihoods = np.zeros((2, len(models)))
    with TemporaryDirectory() as folder:
        for identity in trial.evidence:
            assert identity.estimate is not None
            picture = Path(folder) / f"{identity.index}.png"
            scene = Scene(
                model=models[identity.index],
                contacts=trial.contacts,
                hypotheses=(ShownHypothesis(identity.estimate.best.X_PO),),
            )
            save_picture(picture, scene, captions=("", f"{identity.index + 1}: {identity.name}"))
            axes = figure.add_subplot(grid[0, identity.index])
            axes.imshow(imread(picture))
            axes.set_axis_off()
            likelihoods[0, identity.index] = identity.likelihood
    for identity in trial.inverse_cost:
        likelihoods[1, identity.index] = identity.likelihood
    axes = figure.add_subplot(grid[1, :])
    places = np.arange(len(models))
    for row, label in enumerate(("by evidence", "by the inverse of the lowest cost, as in the thesis")):
        bars = axes.bar(places + 0.4 * (row - 0.5), likelihoods[row], 0.38, label=label)
        axes.bar_label(bars, [f"{100 * value:.1f} %" for value in likelihoods[row]], fontsize=9)
    axes.set_xticks(places, [f"{i + 1}: {model.name}" for i, model in enumerate(models)])
    axes.set_ylim(0.0, 1.15)
    axes.set_ylabel("likelihood")
    axes.legend(loc="upper right")
    figure.suptitle(f"Held: the {trial.held.replace('_', ' ')}")
    figure.savefig(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--grasps", type=click.IntRange(min=1), default=10, show_default=True, help="Grasps of each object.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the noise.")
@click.option("--out", type=click.Path(path_type=Path), help="Draws the figure in this folder.")
def main(grasps: int, seed: int, out: Path | None) -> None:
    """Regenerates figure 6.1 of the thesis, with numbers."""
    console = Console()
    models = [tp.ObjectModel.from_mesh(make_scenario(name).object_mesh(), name=name) for name in OBJECTS]
    trials = run_trials(models, grasps, seed)
    shown = next(trial for trial in trials if trial.held == SHOWN)
    console.print(grasp_table(shown))
    console.print(count_table(trials))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        draw(out / "figure_6_1.png", shown, models)


if __name__ == "__main__":
    main()
