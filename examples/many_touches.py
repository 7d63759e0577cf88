"""Estimates thousands of touches of many objects in one call, as for learning and simulation, and their rate.

    python examples/many_touches.py --touches 10000 --seed 0 --out many_touches
    python examples/many_touches.py --touches 10000 --workers processes --jobs 8 --out many_touches

The package's objects are touched in turn, with five contacts at random places, uniform by area, with 0.9 mm and 5
degrees of noise, in poses drawn from the prior about the identity. `tp.estimate_poses` estimates the poses with threads
or, if there are hundreds of touches of each object, with processes; the results are equal bit by bit. Writes arrays to
`touches.npz`: the objects' names, and for each touch its object, the true pose, the best pose, and its probability.
"""

import os
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import tactopose_drake as tp
from tactopose_drake.core.poses import identity_poses, retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

CONTACTS = 5
PRIOR = tp.PosePrior(np.eye(4))


def workers(kind: str, jobs: int) -> Executor:
    """The executor of the estimates."""
    return ThreadPoolExecutor(jobs) if kind == "threads" else ProcessPoolExecutor(jobs, get_context("spawn"))


@click.command(help=__doc__.partition("\n\n")[0])
@click.option("--touches", "count", default=1200, show_default=True, type=click.IntRange(1), help="How many.")
@click.option("--workers", "kind", default="threads", show_default=True, type=click.Choice(["threads", "processes"]))
@click.option("--jobs", default=os.cpu_count() or 1, show_default=True, type=click.IntRange(1), help="Workers.")
@click.option("--seed", default=0, show_default=True, help="Of the touches.")
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
def main(count: int, kind: str, jobs: int, seed: int, out: Path) -> None:
    """Draws the touches, makes the estimates, and prints their rate."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with (
        Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as progress,
        workers(kind, jobs) as executor,
    ):
        paths = sorted(model_path("objects").glob("*.obj"))
        models = [tp.ObjectModel.from_mesh(path) for path in progress.track(paths, description="models")]
        generator = np.random.default_rng(seed)
        sigma = [PRIOR.sigma_rotation] * 3 + [PRIOR.sigma_translation] * 3
        true = retract(identity_poses(count), sigma * generator.normal(size=(count, 6)))
        touched = [models[i % len(models)] for i in range(count)]
        contacts = [touch_surface(model, X, CONTACTS, generator) for model, X in zip(touched, true, strict=True)]
        task = progress.add_task("estimates", total=count)
        began = time.perf_counter()
        estimates = tp.estimate_poses(
            touched,
            contacts,
            priors=PRIOR,
            executor=executor,
            on_progress=lambda done, _: progress.update(task, completed=done),
        )
        duration = time.perf_counter() - began
    out.mkdir(parents=True, exist_ok=True)
    np.savez(
        out / "touches.npz",
        name=[model.name for model in models],
        touched=np.arange(count) % len(models),
        X_PO_true=true,
        X_PO=[estimate.best.X_PO.GetAsMatrix34() for estimate in estimates],
        probability=[estimate.best.probability for estimate in estimates],
    )
    speed = f"{duration:.1f} s: {count / duration:.0f} a second"
    print(f"{count} touches of {len(models)} objects by {jobs} {kind} in {speed}")


if __name__ == "__main__":
    main()
