"""Touches of unknown objects: how often they are identified as known ones, and the calibration of `unknown`.

    python examples/unknown_objects.py --trials 300 --contacts 5 --seed 0 --out unknown
    python examples/unknown_objects.py --trials 300 --contacts 8 --seed 0 --scans folder --out unknown

Twenty objects are known, drawn at random from a pool: the package's objects, stretched and tapered copies of these,
and some of `object_families.py`; with `--scans`, the meshes of a folder and altered copies of these replace the
package's unaltered ones. Two thirds of the touches are of known objects, the others of the rest of the pool: contacts
at random places, uniform by area, with 0.9 mm and 5 degrees of noise, as the identification assumes.

The study counts how many of the names with a probability above 95 % are wrong, and how often a touch is of an unknown
object, compared with `Identification.unknown`, which it also plots.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from object_families import make_object
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

KNOWN = 20
GENERATED = 14
UNKNOWN_SHARE = 1.0 / 3.0  # of the touches
STRETCH, TAPER = 0.15, 0.2  # standard deviations of the logarithm of each axis's scale, and of the taper
CERTAIN = (0.95, 0.9)
LEVELS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)


class Outcome(NamedTuple):
    """The result of one touch: the touched object, the first names with their probability, `unknown` and the status."""

    touched: str
    is_known: bool
    named: frozenset[str]
    probability: float
    unknown: float
    status: str

    @property
    def is_right(self) -> bool:
        """Whether the touched object is among the first names, which have the same shape."""
        return self.touched in self.named


def altered(mesh: trimesh.Trimesh, generator: np.random.Generator) -> trimesh.Trimesh:
    """A copy, stretched along its axes and tapered along z."""
    copy = mesh.copy()
    vertices = (copy.vertices - copy.bounds.mean(axis=0)) * np.exp(STRETCH * generator.normal(size=3))
    along = vertices[:, 2] / np.ptp(vertices[:, 2])
    vertices[:, :2] *= (1.0 + TAPER * generator.normal() * along)[:, None]
    copy.vertices = vertices
    return copy


def make_pool(seed: int, scans: Path | None) -> list[tp.ObjectModel]:
    """The objects, known and unknown."""
    own = {path.stem: trimesh.load_mesh(path) for path in sorted(model_path("objects").glob("*.obj"))}
    plain = own if scans is None else {path.stem: trimesh.load_mesh(path) for path in sorted(scans.glob("*.obj"))}
    generator = np.random.default_rng((seed, 0))
    meshes = dict(plain)
    meshes |= {f"{name}_altered": altered(mesh, generator) for name, mesh in (own | plain).items()}
    meshes |= dict(make_object(index, seed) for index in range(GENERATED))
    progress = track(meshes.items(), "objects", console=Console(stderr=True), transient=True)
    return [tp.ObjectModel.from_mesh(mesh, name=name) for name, mesh in progress]


def run_trials(pool: Sequence[tp.ObjectModel], known: int, trials: int, contacts: int, seed: int) -> list[Outcome]:
    """Touches known and unknown objects; each trial draws from its own seed."""
    order = np.random.default_rng((seed, 1)).permutation(len(pool))
    library, others = [pool[i] for i in order[:known]], [pool[i] for i in order[known:]]
    outcomes = []
    for trial in track(range(trials), "trials", console=Console(stderr=True), transient=True):
        generator = np.random.default_rng((seed, 2, trial))
        is_known = generator.random() >= UNKNOWN_SHARE
        several = library if is_known else others
        model = several[generator.integers(len(several))]
        X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]
        found = tp.identify(library, touch_surface(model, X_PO, contacts, generator, spread=False))
        first = [identity for identity in found if identity.rank == 1]
        named, probability = frozenset(i.name for i in first), sum(i.probability for i in first)
        outcomes.append(Outcome(model.name, is_known, named, probability, found.unknown, found.status))
    return outcomes


def names_table(outcomes: Sequence[Outcome]) -> Table:
    """How many names have a large probability, and how many of those are wrong."""
    known = sum(outcome.is_known for outcome in outcomes)
    title = f"{len(outcomes)} touches, {len(outcomes) - known} of them of unknown objects"
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("name given with")
    for heading in ("names", "of known objects' touches, %", "wrong", "wrong, %", "wrong of unknown objects"):
        table.add_column(heading, justify="right")
    for least in CERTAIN:
        given = [outcome for outcome in outcomes if outcome.probability > least]
        wrong = [outcome for outcome in given if not outcome.is_right]
        table.add_row(
            f"more than {least:.0%}",
            str(len(given)),
            f"{100 * sum(outcome.is_known for outcome in given) / max(known, 1):.0f}",
            str(len(wrong)),
            f"{100 * len(wrong) / max(len(given), 1):.1f}",
            str(sum(not outcome.is_known for outcome in wrong)),
        )
    return table


def reliability(outcomes: Sequence[Outcome]) -> list[tuple[float, float, int, float, float]]:
    """For each bin of `unknown`: its limits, number of touches, mean of `unknown`, and share of unknown objects."""
    said = np.array([outcome.unknown for outcome in outcomes])
    true = np.array([not outcome.is_known for outcome in outcomes])
    rows = []
    for low, high in itertools.pairwise(LEVELS):
        inside = (said >= low) & ((said < high) | (high == 1.0))
        if inside.any():
            rows.append((low, high, int(inside.sum()), float(said[inside].mean()), float(true[inside].mean())))
    return rows


def reliability_table(outcomes: Sequence[Outcome]) -> Table:
    """How often the object is unknown, compared with `unknown`."""
    table = Table(title="Is the object unknown as often as `unknown` says?", box=box.SIMPLE_HEAD)
    for heading in ("unknown", "touches", "said, %", "true, %"):
        table.add_column(heading, justify="right")
    for low, high, count, said, true in reliability(outcomes):
        table.add_row(f"{low:g} to {high:g}", str(count), f"{100 * said:.1f}", f"{100 * true:.1f}")
    return table


def draw(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Plots the share of unknown objects over `unknown`, with its standard error."""
    figure = Figure(figsize=(5.0, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _, _, count, said, true = np.array(reliability(outcomes)).T
    axes.plot([0, 1], [0, 1], "--", color="0.6", label="as often as it says")
    off = np.minimum(np.sqrt(said * (1.0 - said) / count), [said, 1.0 - said])
    axes.errorbar(said, said, off, fmt="none", ecolor="0.6", capsize=3, label="one standard error about that")
    axes.plot(said, true, "o", label="measured")
    axes.set_xlabel("unknown, mean of each bin")
    axes.set_ylabel("share of touches of unknown objects")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=300, show_default=True, help="Touches.")
@click.option("--contacts", type=click.IntRange(min=1), default=5, show_default=True, help="Of each touch.")
@click.option("--known", type=click.IntRange(min=1), default=KNOWN, show_default=True, help="Objects.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of objects and touches.")
@click.option("--scans", type=click.Path(path_type=Path, exists=True), help="Folder of further meshes.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the plot.")
def main(trials: int, contacts: int, known: int, seed: int, scans: Path | None, out: Path) -> None:
    """Prints the tables, and plots the second."""
    outcomes = run_trials(make_pool(seed, scans), known, trials, contacts, seed)
    console = Console()
    console.print(names_table(outcomes))
    console.print(reliability_table(outcomes))
    out.mkdir(parents=True, exist_ok=True)
    draw(out / "unknown.png", outcomes)


if __name__ == "__main__":
    main()
