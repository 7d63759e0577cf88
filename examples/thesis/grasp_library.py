"""Simulated grasps for trials of pose estimation: true contacts and object poses of the five-fingered hand.

    python examples/thesis/grasp_library.py --count 100

The thesis took its grasps from Gazebo; these are from the package's own simulation. For each seed the hand plans grasps
by all five fingers, closes, and holds the object without support. A grasp is accepted if each fingertip carries 1 N.
For the wine glass, only grasps with the little finger on the stem are accepted: in the thesis too "the small finger
touches the glass stem, which was done in order to avoid that 'upside down' poses yield similar costs".

A grasp takes about four seconds. Each is stored as a separate file in the package's cache folder (or in a given
folder), so that an interrupted run continues where it stopped, and the next run only reads. The simulations run in a
separate process that is restarted from time to time, because a simulated diagram keeps about 100 MB of memory until the
process ends.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import dataclasses
import hashlib
import itertools
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.shape import cache_folder
from tactopose_drake.runs import GraspResult, run_grasp
from tactopose_drake.station import Scenario, load_scenario, make_station, plan_scenario

Array = NDArray[np.float64]

OBJECTS = ("bust", "wine_glass")
FINGERS = ("thumb", "first", "middle", "ring", "little")
# The stem of the wine glass is above its foot, and nearer to the axis than the bowl's lower end.
STEM_ABOVE, STEM_RADIUS = 0.015, 0.010  # m
# Number of seeds that one process simulates.
SEEDS_A_PROCESS = 10


@dataclasses.dataclass(frozen=True, eq=False)
class SimulatedGrasp:
    """The true state of one simulated grasp, in the palm frame P.

    Attributes:
        X_PO: true pose of the object, shape (3, 4).
        p_PC: centres of pressure of the fingertips, in the order of `FINGERS`, shape (5, 3), m.
        n_PC: the object's outward normals there, shape (5, 3).
        f_PC: forces on the fingertips, shape (5, 3), N.
        p_PH: centres of the spheres that fill the hand, shape (h, 3), m.
        radius: their radii, shape (h,), m.
    """

    X_PO: Array
    p_PC: Array
    n_PC: Array
    f_PC: Array
    p_PH: Array
    radius: Array


def make_library(name: str, count: int, folder: Path | None = None) -> list[SimulatedGrasp]:
    """The first `count` grasps of an object, by increasing seed; simulates those that are not in the folder yet.

    Args:
        name: one of the package's objects.
        count: number of grasps.
        folder: folder of the files; None for the package's cache folder.
    """
    grasps = _grasps(name, cache_folder() / "grasps" if folder is None else folder)
    described = track(grasps, f"grasps of the {name}", total=count, console=Console(stderr=True), transient=True)
    return list(itertools.islice(described, count))


def _grasps(name: str, folder: Path) -> Iterator[SimulatedGrasp]:
    """The object's grasps, read from the files or simulated."""
    version = hashlib.blake2b(make_scenario(name).object_mesh().read_bytes(), digest_size=4).hexdigest()
    folder.mkdir(parents=True, exist_ok=True)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=SEEDS_A_PROCESS) as executor:
        for seed in itertools.count():
            path = folder / f"{name}_{version}_{seed}.npz"
            if not path.is_file():
                _save(path, executor.submit(simulate, name, seed).result())
            with np.load(path) as arrays:
                if arrays.files:
                    yield SimulatedGrasp(**arrays)


def _save(path: Path, grasp: SimulatedGrasp | None) -> None:
    """Writes a grasp, or an empty file for a seed without one, atomically, so that no reader sees half a file.

    Another process may write the same grasp, with the same result.
    """
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as file:
        np.savez(file, **({} if grasp is None else vars(grasp)))
    os.replace(partial, path)


def make_scenario(name: str, seed: int = 0) -> Scenario:
    """The scenario of a hand without errors that grasps an object with all five fingers; no pose is estimated."""
    scenario = load_scenario("shadow_like").without_errors()
    scenario.object, scenario.seed = name, seed
    scenario.planner.least_fingers = len(FINGERS)
    scenario.check.least_fingers = len(FINGERS)
    scenario.estimation.estimator.period = 2.0 * scenario.duration  # Once at the start, before any contact.
    return scenario


def simulate(name: str, seed: int) -> SimulatedGrasp | None:
    """The best accepted grasp of a seed; None if none of its attempts is accepted."""
    scenario = make_scenario(name, seed)
    model = scenario.object_model()
    plans = plan_scenario(scenario, model)
    wanted = (plan for plan in plans if is_wanted(name, plan.X_PO, plan.fingers["little"].p_PC))
    for plan in itertools.islice(wanted, scenario.check.attempts):
        result = run_grasp(make_station(scenario, plan, model=model))
        if result.stable:
            grasp = _read(result)
            if is_wanted(name, grasp.X_PO, grasp.p_PC[FINGERS.index("little")]):
                return grasp
    return None


def is_wanted(name: str, X_PO: Array, p_PC_little: Array) -> bool:
    """Whether the little finger touches where it should; its contact is at a point (3,), m."""
    if name != "wine_glass":
        return True
    x, y, z = (p_PC_little - X_PO[:, 3]) @ X_PO[:, :3]
    return bool(np.hypot(x, y) < STEM_RADIUS and z > STEM_ABOVE)


def _read(result: GraspResult) -> SimulatedGrasp:
    station, tips = result.station, [result.truth.tips[finger] for finger in FINGERS]
    context = station.plant.GetMyContextFromRoot(result.context)
    hand = tp.HandGeometry.from_plant(station.plant, context, station.hand.palm_frame)
    return SimulatedGrasp(
        X_PO=result.X_PO.GetAsMatrix34(),
        p_PC=np.array([tip.p_PC for tip in tips]),
        n_PC=np.array([tip.n_PC for tip in tips]),
        f_PC=np.array([tip.f_PC for tip in tips]),
        p_PH=hand.p_PH,
        radius=hand.radius,
    )


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--count", type=click.IntRange(min=1), default=100, show_default=True, help="Grasps of each object.")
@click.option("--folder", type=click.Path(path_type=Path), help="Keeps them here, not in the cache folder.")
def main(count: int, folder: Path | None) -> None:
    """Simulates grasps of the bust and of the wine glass."""
    for name in OBJECTS:
        grasps = make_library(name, count, folder)
        model = make_scenario(name).object_model()
        p_OC = np.concatenate([(grasp.p_PC - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3] for grasp in grasps])
        off = 1e3 * np.abs(model.grid.distance(p_OC))
        print(
            f"{name}: {len(grasps)} grasps; contacts off the surface by {off.mean():.2f} mm, {off.max():.2f} at most."
        )


if __name__ == "__main__":
    main()
