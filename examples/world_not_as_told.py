"""Robustness of the estimates to model errors: false contacts, rotated normals, more noise, another mesh.

python examples/world_not_as_told.py --trials 500

Objects in random poses are touched at random places, far apart, with the noise that the estimate assumes; then
something is changed that it does not know of. A pose is right within 10 mm and 15 degrees, up to the object's
symmetries. Of the best hypotheses with a probability above 95 %, the study counts those whose 99.9 % ellipsoid does not
contain the truth; and of all estimates, how often the truth is in the smallest set of hypotheses with 95 %.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from calibration import OBJECTS, region_holds
from nearest_images import least_error, nearest_increments
from numpy.typing import NDArray
from rich.progress import track
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

SURE = 0.95
BEYOND = float(chi2.ppf(0.999, 6))
RIGHT = (0.010, np.radians(15.0))
SIGMA_POSITION, SIGMA_NORMAL = 0.0009, np.radians(5.0)

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class World:
    """Errors of the model that the estimate does not know.

    Attributes:
        noise: ratio of the contacts' noise to the assumed one.
        scale: size of the touched object relative to the mesh.
        change: changes the measured points (k, 3) and normals (k, 3) in place.
    """

    noise: float = 1.0
    scale: float = 1.0
    change: Callable[[np.random.Generator, Array, Array], None] = lambda generator, p, n: None


def _directions(generator: np.random.Generator, count: int) -> Array:
    rows = generator.normal(size=(count, 3))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _one_off(generator: np.random.Generator, p: Array, n: Array) -> None:
    p[generator.integers(len(p))] += generator.uniform(0.010, 0.030) * _directions(generator, 1)[0]


def _one_flipped(generator: np.random.Generator, p: Array, n: Array) -> None:
    n[generator.integers(len(n))] *= -1.0


def _one_turned(generator: np.random.Generator, p: Array, n: Array) -> None:
    i = generator.integers(len(n))
    axis = np.cross(n[i], _directions(generator, 1)[0])
    n[i] = exp_so3(np.radians(45.0) * axis / np.linalg.norm(axis)) @ n[i]


def _each_off(generator: np.random.Generator, p: Array, n: Array) -> None:
    p += 0.002 * _directions(generator, len(p))


WORLDS = {
    "as told": World(),
    "one contact 10 to 30 mm off": World(change=_one_off),
    "one normal flipped": World(change=_one_flipped),
    "one normal 45 degrees off": World(change=_one_turned),
    "noise twice as large": World(noise=2.0),
    "object 3 % larger": World(scale=1.03),
    "each contact 2 mm off": World(change=_each_off),
}


@dataclasses.dataclass(frozen=True)
class Touch:
    """A touch of an object, and what the estimate is told.

    Attributes:
        X_PO: the true pose, shape (3, 4).
        contacts: the measured contacts, with the noise that the estimate assumes.
        prior: prior of the pose, or None.
    """

    X_PO: Array
    contacts: tp.Contacts
    prior: tp.PosePrior | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """The result of one estimate.

    Attributes:
        right: whether the best pose is right.
        sure: whether its probability is above 95 %.
        beyond: whether the truth is outside of its 99.9 % ellipsoid.
        held: whether the 95 % set contains the truth.
        status: status of the estimate.
        seconds: CPU time of the estimate.
    """

    right: bool
    sure: bool
    beyond: bool
    held: bool
    status: str
    seconds: float


def touch_object(model: tp.ObjectModel, world: World, seed: int, count: int, has_prior: bool) -> Touch:
    """Touches the object in its world."""
    generator = np.random.default_rng([seed, 77])
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    prior = tp.PosePrior(X_PO)
    prior = tp.PosePrior(retract(X_PO, generator.normal(size=6) * prior.sigmas)) if has_prior else None
    noise = {"sigma_position": world.noise * SIGMA_POSITION, "sigma_normal": world.noise * SIGMA_NORMAL}
    felt = touch_surface(model, X_PO, count, generator, spread=True, **noise)
    p_PC, n_PC = felt.p_PC.copy(), felt.n_PC.copy()
    # The object is scaled about its centre of mass.
    p_PC += (world.scale - 1.0) * (p_PC - X_PO[:, 3] - X_PO[:, :3] @ model.center_of_mass)
    world.change(generator, p_PC, n_PC)
    return Touch(X_PO, tp.Contacts(p_PC, n_PC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL), prior)


def is_right(model: tp.ObjectModel, X_PO: Array, X_true: Array) -> bool:
    """Whether a pose (3, 4) is right, given the true one."""
    near = least_error(model, X_PO, X_true)
    return bool(np.linalg.norm(near[3:]) < RIGHT[0] and np.linalg.norm(near[:3]) < RIGHT[1])


def is_beyond(model: tp.ObjectModel, X_PO: Array, covariance: Array, X_true: Array) -> bool:
    """Whether the true pose (3, 4) is outside of the 99.9 % ellipsoid of a pose (3, 4) and its covariance (6, 6)."""
    information = np.linalg.inv(covariance)
    error = nearest_increments(model, X_PO, information, X_true[None])[0]
    return float(error @ information @ error) > BEYOND


def run_trial(model: tp.ObjectModel, world: World, seed: int, count: int, has_prior: bool) -> Trial:
    """Touches the object in its world, estimates its pose, and compares."""
    touch = touch_object(model, world, seed, count, has_prior)
    started = time.process_time()
    estimate = tp.estimate_pose(model, touch.contacts, prior=touch.prior, seed=seed)
    seconds = time.process_time() - started
    best, X_PO = estimate.best, touch.X_PO
    return Trial(
        right=is_right(model, best.X_PO.GetAsMatrix34(), X_PO),
        sure=best.probability > SURE,
        beyond=is_beyond(model, best.X_PO.GetAsMatrix34(), best.covariance, X_PO),
        held=bool(region_holds(model, estimate, X_PO[None], [SURE])[0, 0]),
        status=estimate.status,
        seconds=seconds,
    )


def row(name: str, trials: list[Trial]) -> str:
    """A line of the table."""
    sure = [trial for trial in trials if trial.sure]
    said = {status: sum(trial.status == status for trial in trials) for status in ("ok", "ambiguous", "no_solution")}
    ok = [trial for trial in trials if trial.status == "ok"]
    return (
        f"{name:28s} right {np.mean([trial.right for trial in trials]):5.1%}, "
        f"sure and wrong {sum(trial.beyond for trial in sure):3d} of {len(sure):3d}, "
        f"ok and not right {sum(not trial.right for trial in ok):3d} of {len(ok):3d}, "
        f"set holds the truth {np.mean([trial.held for trial in trials]):5.1%}, {said['ambiguous']:3d} ambiguous, "
        f"{said['no_solution']:3d} no_solution, "
        f"{1e3 * np.median([trial.seconds for trial in trials]):.1f} ms (mean "
        f"{1e3 * np.mean([trial.seconds for trial in trials]):.1f})"
    )


def main() -> None:
    """Prints the table with a prior and without one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500, help="of each world")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--scans", type=Path, help="a folder of further meshes")
    parser.add_argument("--contacts", type=int, default=5)
    parser.add_argument("--worlds", nargs="+", type=int, default=list(range(len(WORLDS))), help="by their numbers")
    parser.add_argument("--out", type=Path, default=Path("out/world_not_as_told"))
    arguments = parser.parse_args()
    meshes = [model_path("objects", f"{name}.obj") for name in arguments.objects]
    if arguments.scans is not None:
        meshes += sorted(arguments.scans.glob("*.obj"))
    models = [tp.ObjectModel.from_mesh(mesh) for mesh in meshes]
    lines = []
    for title, has_prior in (("with a prior of 33 mm and 16 degrees", True), ("without a prior", False)):
        lines.append(f"{title}:")
        print(lines[-1])
        for name in (list(WORLDS)[i] for i in arguments.worlds):
            seeds = range(arguments.first_seed, arguments.first_seed + arguments.trials)
            trials = [
                run_trial(models[seed % len(models)], WORLDS[name], seed, arguments.contacts, has_prior)
                for seed in track(seeds, description=name)
            ]
            lines.append(row(name, trials))
            print(lines[-1])
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "world_not_as_told.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
