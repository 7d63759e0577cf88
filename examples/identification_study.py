"""Identification of objects: how often the first object is right, and time by the number of objects.

    python examples/identification_study.py --trials 400 --seed 0 --out identification
    python examples/identification_study.py --trials 20 --growth --out identification

The first command identifies one of twenty objects: those of the package, some of `object_families.py`, and a rotated
copy of one of them, which touch cannot distinguish from it. Objects in random poses are touched by five contacts at
random places, uniform by area, with 0.9 mm and 5 degrees of noise. The study gives the rank of the touched object, by
evidence and by the thesis' measure, the inverse of the lowest cost; and how often the first object is right, by its
stated likelihood.

With `--growth`, it identifies objects in libraries of 10 to 1000 random objects, each a part of the next, and gives the
median time of an identification in one process, with no models in memory. The libraries are indexed once before, which
takes a few minutes, and about 2 GB in the cache. Writes a plot.
"""

import itertools
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import trimesh
import yaml
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from object_families import make_object, write_objects
from rich import box
from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.estimation import forget_models
from tactopose_drake.resources import model_path

GENERATED = 7
COPIED = "bottle_0001"
CONTACTS = 5
SIZES = (10, 30, 100, 300, 1000)
MEASURES = ("evidence", "inverse_cost")
# Limits of the likelihoods by which trials are grouped.
LEVELS = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)


class Outcome(NamedTuple):
    """The result of a trial with a measure: rank of the touched object, likelihood of the first, and CPU time, s."""

    rank: int
    likelihood: float
    seconds: float


def write_library(folder: Path) -> Path:
    """Writes a manifest of the twenty objects, and the meshes that are not in the package."""
    folder.mkdir(parents=True, exist_ok=True)
    manifest = {path.stem: {"mesh": str(path)} for path in sorted(model_path("objects").glob("*.obj"))}
    meshes = dict(make_object(index, 0) for index in range(GENERATED))
    copy = meshes[COPIED].copy()
    copy.apply_transform(trimesh.transformations.euler_matrix(0.4, -1.0, 2.0))
    for name, mesh in (meshes | {"turned_copy": copy}).items():
        mesh.export(folder / f"{name}.stl")
        manifest[name] = {"mesh": f"{name}.stl"}
    path = folder / "library.yaml"
    path.write_text(yaml.safe_dump(manifest))
    return path


def random_touch(model: tp.ObjectModel, generator: np.random.Generator) -> tp.Contacts:
    """Five contacts at random places on an object in a random pose."""
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]
    return touch_surface(model, X_PO, CONTACTS, generator, spread=False)


def run_trials(library: tp.ObjectLibrary, trials: int, seed: int) -> dict[str, list[Outcome]]:
    """Touches the library's objects in turn; each trial draws from its own seed."""
    outcomes: dict[str, list[Outcome]] = {measure: [] for measure in MEASURES}
    for trial in track(range(trials), "trials", console=Console(stderr=True), transient=True):
        true = trial % len(library)
        contacts = random_touch(library.objects[true].load(), np.random.default_rng((seed, trial)))
        for measure, runs in outcomes.items():
            started = time.process_time()
            found = tp.identify(library, contacts, likelihood=measure, candidates=len(library))
            seconds = time.process_time() - started
            rank = next(identity.rank for identity in found if identity.index == true)
            first = sum(identity.likelihood for identity in found if identity.rank == 1)
            runs.append(Outcome(rank, first, seconds))
    return outcomes


def ranks_table(outcomes: dict[str, list[Outcome]]) -> Table:
    """A line for each measure."""
    trials = len(outcomes["evidence"])
    table = Table(title=f"Rank of the touched object among twenty, {trials} trials", box=box.SIMPLE_HEAD)
    table.add_column("measure")
    for heading in ("first, %", "among the first three, %", "median ms"):
        table.add_column(heading, justify="right")
    for measure, runs in outcomes.items():
        rank, _, seconds = np.array(runs).T
        shares = (f"{100 * np.mean(rank <= most):.1f}" for most in (1, 3))
        table.add_row(measure, *shares, f"{1e3 * np.median(seconds):.0f}")
    return table


def calibration_table(runs: Sequence[Outcome]) -> Table:
    """How often the first object is right, by its likelihood."""
    table = Table(title="Is the first object as often right as its likelihood says?", box=box.SIMPLE_HEAD)
    for heading in ("likelihood", "trials", "mean likelihood, %", "right, %"):
        table.add_column(heading, justify="right")
    rank, likelihood, _ = np.array(runs).T
    for low, high in itertools.pairwise(LEVELS):
        inside = (likelihood > low) & (likelihood <= high + (high == 1.0))
        if inside.any():
            means = f"{100 * likelihood[inside].mean():.1f}", f"{100 * np.mean(rank[inside] == 1):.1f}"
            table.add_row(f"{low:g} to {high:g}", str(inside.sum()), *means)
    return table


def open_library(folder: Path, executor: Executor) -> tp.ObjectLibrary:
    """Opens a library, and shows the progress of its indexing."""
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"indexing {folder.name}")
        return tp.ObjectLibrary.open(
            folder,
            executor=executor,
            on_progress=lambda done, total: progress.update(task, completed=done, total=total),
        )


class Growth(NamedTuple):
    """The result for one size of the library: median CPU time, s, and the ranks of the touched objects."""

    size: int
    seconds: float
    ranks: list[int]


def measure_growth(folder: Path, sizes: Sequence[int], trials: int, seed: int) -> list[Growth]:
    """Identifies objects of the smallest library in all of them."""
    rows = []
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as executor:
        for size in sizes:
            write_objects(folder / str(size), size, seed)
            library = open_library(folder / str(size), executor)
            names = [known.name for known in library.objects]
            runs = []
            for trial in track(range(trials), f"{size} objects", console=Console(stderr=True), transient=True):
                name = make_object(trial % min(sizes), seed)[0]
                contacts = random_touch(library.objects[names.index(name)].load(), np.random.default_rng((seed, trial)))
                forget_models()
                started = time.process_time()
                found = tp.identify(library, contacts)
                runs.append((time.process_time() - started, next(i.rank for i in found if i.name == name)))
            seconds, ranks = zip(*runs, strict=True)
            rows.append(Growth(size, float(np.median(seconds)), list(ranks)))
    return rows


def draw_growth(path: Path, rows: Sequence[Growth]) -> None:
    """Plots the time over the number of objects, beside a linear function."""
    figure = Figure(figsize=(6.0, 4.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    sizes, seconds = np.array([row.size for row in rows]), np.array([row.seconds for row in rows])
    axes.loglog(sizes, seconds, "o-", label="measured")
    axes.loglog(
        sizes, seconds[0] * sizes / sizes[0], "--", color="0.6", label="as many times longer as there are objects"
    )
    axes.set_xlabel("objects in the library")
    axes.set_ylabel("CPU time of an identification, s")
    axes.grid(which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=200, show_default=True, help="Touches.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the touches.")
@click.option("--growth", is_flag=True, help="Measures how the time grows with the library instead.")
@click.option("--largest", type=int, default=SIZES[-1], show_default=True, help="Library of the growth.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the libraries and the plot.")
def main(trials: int, seed: int, growth: bool, largest: int, out: Path) -> None:
    """Prints the tables, or measures the growth."""
    console = Console()
    if growth:
        rows = measure_growth(out, [size for size in SIZES if size <= largest], trials, seed)
        for row in rows:
            first, three = (100 * np.mean(np.array(row.ranks) <= most) for most in (1, 3))
            console.print(
                f"{row.size} objects: {row.seconds:.2f} s; the right one first in {first:.0f} %, "
                f"among the first three in {three:.0f} % of {trials} trials"
            )
        draw_growth(out / "growth.png", rows)
        return
    outcomes = run_trials(tp.ObjectLibrary.open(write_library(out / "twenty")), trials, seed)
    console.print(ranks_table(outcomes))
    console.print(calibration_table(outcomes["evidence"]))


if __name__ == "__main__":
    main()
