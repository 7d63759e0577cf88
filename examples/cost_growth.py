"""CPU time of an estimate as a function of the size of its inputs.

    python examples/cost_growth.py --out out

Prints the median CPU time of an estimate by the number of contacts, of cells of four pads, and of faces of the mesh;
that of an identification by the number of objects (up to a thousand in `identification_study.py --growth`); and cost
and time of the thesis' search by the number of particles. Writes the tables as Markdown (cost_growth.md) and the plots
(cost_growth.png). Touches are synthetic with 0.9 mm and 5 degrees of noise, and the prior is 33 mm and 16 degrees off.
"""

import math
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from object_families import make_object

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.poses import retract
from tactopose_drake.core.searches import MonteCarlo, MonteCarloDesign, PriorSpace, make_problem
from tactopose_drake.core.synthetic import flat_pad, touch_surface, touch_with_pads
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]

CONTACTS = (3, 5, 10, 20, 50)
PADS = ((4, 3), (8, 3), (12, 6), (20, 12))  # rows and columns of a pad's cells
SUBDIVISIONS = (2, 3, 4, 5)  # of an icosphere: 320 to 20 480 faces
OBJECTS = (1, 3, 10, 20)
PARTICLES = (500, 1000, 2000, 5000, 10_000, 20_000)
PITCH = 0.02  # height of a pad, the sum of its rows' pitches, m
SIGMAS = np.repeat([math.radians(16.0 / 1.6), 0.033 / 1.6], 3)  # mean lengths of 16 degrees and 33 mm


class Curve(NamedTuple):
    """One table: the measured values as functions of a size."""

    title: str
    x_label: str
    y_label: str
    x: Sequence[int]
    lines: dict[str, list[float]]


def milliseconds(solve: Callable[[int], object], trials: int) -> float:
    """Median CPU time of the trials, after a first one that compiles and caches."""
    solve(trials)
    seconds = []
    for trial in range(trials):
        started = time.process_time()
        solve(trial)
        seconds.append(time.process_time() - started)
    return 1e3 * statistics.median(seconds)


def guess(generator: np.random.Generator) -> tp.PosePrior:
    """A random prior for the identity pose."""
    return tp.PosePrior(retract(np.eye(3, 4), generator.normal(size=6) * SIGMAS))


def over_contacts(trials: int, seed: int) -> Curve:
    """Estimates of the bust with and without a prior."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    lines: dict[str, list[float]] = {"with a guess": [], "without": []}
    for count in CONTACTS:
        for has_guess, line in zip((True, False), lines.values(), strict=True):

            def solve(trial: int, count: int = count, has_guess: bool = has_guess) -> object:
                generator = np.random.default_rng((seed, trial))
                contacts = touch_surface(model, np.eye(3, 4), count, generator)
                return tp.estimate_pose(model, contacts, prior=guess(generator) if has_guess else None)

            line.append(milliseconds(solve, trials))
    return Curve("Contacts, bust", "contacts", "CPU time, ms", CONTACTS, lines)


def over_cells(trials: int, seed: int) -> Curve:
    """Estimates of the spray bottle with a prior, from four pads."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "spray_bottle.obj"))
    line = []
    for rows, columns in PADS:
        pad = flat_pad(rows, columns, PITCH / rows)

        def solve(trial: int, pad: Array = pad) -> object:
            generator = np.random.default_rng((seed, trial))
            patches = touch_with_pads(model, np.eye(3, 4), 4, generator, cells=pad)
            return tp.estimate_pose(model, tp.Contacts.empty(), patches=patches, prior=guess(generator))

        line.append(milliseconds(solve, trials))
    cells = [rows * columns for rows, columns in PADS]
    return Curve("Cells of each of four pads, spray bottle", "cells", "CPU time, ms", cells, {"with a guess": line})


def over_faces(trials: int, seed: int) -> Curve:
    """Models and estimates of a lumpy ball with finer and finer meshes."""
    lines: dict[str, list[float]] = {"estimate without a guess": [], "building the model": []}
    faces = []
    for subdivisions in SUBDIVISIONS:
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.04)
        lumps = 1.0 + 0.15 * np.sin(80.0 * ball.vertices[:, 0]) * np.cos(60.0 * ball.vertices[:, 1] + 1.0)
        ball.vertices = ball.vertices * (lumps * (1.0 + 4.0 * ball.vertices[:, 2]))[:, None]
        faces.append(len(ball.faces))
        started = time.process_time()
        model = tp.ObjectModel.from_mesh(ball, cache=False)
        lines["building the model"].append(1e3 * (time.process_time() - started))

        def solve(trial: int, model: tp.ObjectModel = model) -> object:
            contacts = touch_surface(model, np.eye(3, 4), 5, np.random.default_rng((seed, trial)))
            return tp.estimate_pose(model, contacts)

        lines["estimate without a guess"].append(milliseconds(solve, trials))
    return Curve("Faces of the mesh, a lumpy ball", "faces", "CPU time, ms", faces, lines)


def over_library(trials: int, seed: int) -> Curve:
    """Identification among the first objects of `object_families.py`, with all models in memory."""
    models = [tp.ObjectModel.from_mesh(make_object(index, seed)[1]) for index in range(max(OBJECTS))]
    line = []
    for count in OBJECTS:

        def solve(trial: int, count: int = count) -> object:
            generator = np.random.default_rng((seed, trial))
            return tp.identify(models[:count], touch_surface(models[trial % count], np.eye(3, 4), 5, generator))

        line.append(milliseconds(solve, trials))
    return Curve("Objects to tell apart", "objects", "CPU time, ms", OBJECTS, {"identification": line})


def over_particles(trials: int, seed: int) -> Curve:
    """Medians of the least cost and of the CPU time of the thesis' search."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    batches = {1: "one at a time", 100: "in batches of 100"}

    def search(trial: int, particles: int, batch: int) -> tuple[float, float]:
        design = MonteCarloDesign(
            particles=particles, population=particles // 20, power=100.0, noise=0.4, cooling=2.0, confidence=99.0
        )
        generator = np.random.default_rng((seed, trial))
        contacts = touch_surface(model, np.eye(3, 4), 5, generator)
        prior = guess(generator)
        objective = make_problem(model, Evidence(contacts, prior)).objective
        started = time.process_time()
        evolved = MonteCarlo(scale=10.0, batch=batch, correction=design)
        least = evolved.evolve(objective, PriorSpace(prior), generator)[1].min()
        return float(least), 1e3 * (time.process_time() - started)

    lines: dict[str, list[float]] = {f"{what}, {how}": [] for what in ("cost", "ms") for how in batches.values()}
    search(0, PARTICLES[0], 1)  # The first call compiles.
    for particles in PARTICLES:
        for batch, how in batches.items():
            for what, values in zip(
                ("cost", "ms"), np.array([search(i, particles, batch) for i in range(trials)]).T, strict=True
            ):
                lines[f"{what}, {how}"].append(float(np.median(values)))
    return Curve("Particles of the thesis' search, bust", "particles", "cost; CPU time, ms", PARTICLES, lines)


def table(curve: Curve) -> list[str]:
    """The curve as lines of Markdown."""
    lines = [f"## {curve.title}", "", f"| {curve.x_label} | " + " | ".join(curve.lines) + " |"]
    lines.append("|---:|" + "---:|" * len(curve.lines))
    for row in zip(curve.x, *curve.lines.values(), strict=True):
        lines.append(f"| {row[0]} | " + " | ".join(f"{value:.3g}" for value in row[1:]) + " |")
    return [*lines, ""]


def draw(curves: Sequence[Curve], path: Path) -> None:
    """All curves, three in a row."""
    rows = math.ceil(len(curves) / 3)
    figure = Figure(figsize=(13.0, 4.0 * rows), layout="constrained")
    grid = figure.subplots(rows, 3, squeeze=False).ravel()
    for axes in grid[len(curves) :]:
        axes.set_axis_off()
    for axes, curve in zip(grid[: len(curves)], curves, strict=True):
        for name, line in curve.lines.items():
            axes.plot(curve.x, line, ".-", label=name)
        axes.set(xscale="log", yscale="log", xlabel=curve.x_label, ylabel=curve.y_label, title=curve.title)
        axes.set_xticks(curve.x, [str(x) for x in curve.x])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        axes.legend()
    FigureCanvasAgg(figure).print_png(path)


STUDIES = (over_contacts, over_cells, over_faces, over_library, over_particles)


@click.command()
@click.option("--trials", type=click.IntRange(min=1), default=20, show_default=True, help="Touches for each number.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of touches and guesses.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown and the plots here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """How the time of an estimate grows with what it is given."""
    curves = [study(trials, seed) for study in STUDIES]
    lines = [f"# How cost grows, {trials} touches for each number, seed {seed}", ""]
    text = "\n".join(lines + [line for curve in curves for line in table(curve)])
    print(text)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "cost_growth.md").write_text(text, encoding="utf-8")
        draw(curves, out / "cost_growth.png")


if __name__ == "__main__":
    main()
