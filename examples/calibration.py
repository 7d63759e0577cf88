"""Calibration of the estimates: how often the truth is in the 95 % region of the hypotheses.

python examples/calibration.py --trials 1000

Objects in random poses are touched at random places, with the noise that the estimate assumes. A hypothesis contains
the truth if the squared Mahalanobis distance between them, up to the object's symmetries, is below the 95 % quantile of
the chi-square distribution with six degrees of freedom. The study counts how often the truth is contained in one of the
smallest set of hypotheses with 95 % of the probability.

Even an exact belief does not reach 95 % by this count. It may reach only 0.95 x 0.95 if the set has less than the whole
probability, and more if ellipsoids overlap or a symmetry leaves fewer than six dimensions. What an exact belief would
reach is computed by drawing truths from each belief itself: the number "promised".
"""

import argparse
import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from calibration_summary import LEVEL, LEVELS, WELL_KNOWN, Trial, save_figure, summary
from nearest_images import nearest_increments
from numpy.typing import NDArray
from rich.progress import Progress
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.posterior import cramer_rao_bound
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

OBJECTS = (
    "bust",
    "cube",
    "cylinder",
    "light_bulb",
    "mug",
    "pencil",
    "screwdriver",
    "soda_can",
    "spray_bottle",
    "tea_box",
    "thermal_bottle",
    "wine_glass",
)
# A pose is unique if its hypothesis has more than this probability, and no direction is free there or at the truth. The
# truth may still be in the rest of the probability: with 0.99, that happens about once in every fifth set of 1000
# trials, and the squared error of that trial, in the thousands, then dominates the set's mean.
UNIQUE = 0.999
DRAWS = 20  # Number of truths drawn from each belief.
WITH_PRIOR, WITHOUT = "with a prior of 33 mm and 16 degrees", "without a prior"

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Touch:
    """A touch of an object in a random pose.

    Attributes:
        model: the object.
        X_PO: the pose, shape (3, 4).
        contacts: the measured contacts.
        exact: the contacts without noise, with the standard deviations of the measured ones.
        prior: prior of the pose, or None.
        generator: random generator for later draws.
    """

    model: tp.ObjectModel
    X_PO: Array
    contacts: tp.Contacts
    exact: tp.Contacts
    prior: tp.PosePrior | None
    generator: np.random.Generator


def region_holds(
    model: tp.ObjectModel, estimate: tp.PoseEstimate, X_true: Array, levels: Sequence[float] | Array
) -> NDArray[np.bool_]:
    """Whether the region of each level contains each of the poses (n, 3, 4), shape (n, levels)."""
    before = np.cumsum([0.0] + [hypothesis.probability for hypothesis in estimate.hypotheses])[:-1]
    held = np.zeros((len(X_true), len(levels)), dtype=np.bool_)
    for mass_before, hypothesis in zip(before, estimate.hypotheses, strict=True):
        if mass_before >= max(levels):
            break
        information = np.linalg.inv(hypothesis.covariance)
        u = nearest_increments(model, hypothesis.X_PO.GetAsMatrix34(), information, X_true)
        square = np.einsum("bi,ij,bj->b", u, information, u)
        held |= (square[:, None] < chi2.ppf(levels, 6)) & (mass_before < np.asarray(levels))
    return held


def touch(model: tp.ObjectModel, seed: int, arguments: argparse.Namespace, has_prior: bool) -> Touch:
    """Touches the object."""
    noise = {"sigma_position": 0.0009 * arguments.noise, "sigma_normal": np.radians(5.0) * arguments.noise}
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    prior = tp.PosePrior(X_PO)
    prior = tp.PosePrior(retract(X_PO, generator.normal(size=6) * prior.sigmas)) if has_prior else None
    # Equal random numbers give the contacts with and without noise.
    state = generator.bit_generator.state
    contacts = touch_surface(model, X_PO, arguments.contacts, generator, spread=arguments.spread, **noise)
    generator.bit_generator.state = state
    exact = touch_surface(
        model, X_PO, arguments.contacts, generator, spread=arguments.spread, sigma_position=0.0, sigma_normal=0.0
    )
    exact = tp.Contacts(exact.p_PC, exact.n_PC, **noise)
    if arguments.without_normals:
        contacts, exact = (tp.Contacts(c.p_PC, sigma_position=noise["sigma_position"]) for c in (contacts, exact))
    return Touch(model=model, X_PO=X_PO, contacts=contacts, exact=exact, prior=prior, generator=generator)


def judge(touched: Touch, estimate: tp.PoseEstimate) -> Trial:
    """Compares an estimate with the truth."""
    model, X_PO, best = touched.model, touched.X_PO, estimate.best
    information = np.linalg.inv(best.covariance)
    error = nearest_increments(model, best.X_PO.GetAsMatrix34(), information, X_PO[None])[0]
    bound = cramer_rao_bound(model, touched.exact, X_PO, touched.prior)
    unique = best.probability > UNIQUE and not len(best.free_directions) and not len(bound.free_directions)
    metres = np.repeat([model.size / 2.0, 1.0], 3)  # Motion of the surface per unit of each increment.
    widest = np.sqrt(np.linalg.eigvalsh(best.covariance * np.outer(metres, metres))[-1])
    return Trial(
        name=model.name,
        held=region_holds(model, estimate, X_PO[None], LEVELS)[0],
        promised=float(region_holds(model, estimate, draw(model, estimate, touched.generator), [LEVEL]).mean()),
        probability=best.probability,
        cost=best.cost,
        unique=unique,
        well_known=unique and widest < WELL_KNOWN * model.size,
        mahalanobis=float(error @ information @ error),
        translation=float(np.linalg.norm(error[3:])),
        rotation=float(np.linalg.norm(error[:3])),
        said_translation=float(np.sqrt(np.trace(best.covariance[3:, 3:]))),
        said_rotation=float(np.sqrt(np.trace(best.covariance[:3, :3]))),
        least_translation=bound.rms_translation,
        least_rotation=bound.rms_rotation,
    )


def run_trials(models: Sequence[tp.ObjectModel], title: str, arguments: argparse.Namespace) -> list[Trial]:
    """Touches the objects in turn, estimates their poses on all cores, and compares."""
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.trials)
    touches = [touch(models[seed % len(models)], seed, arguments, title == WITH_PRIOR) for seed in seeds]
    with Progress() as progress:
        task = progress.add_task(title, total=len(touches))
        estimates = tp.estimate_poses(
            [touched.model for touched in touches],
            [touched.contacts for touched in touches],
            priors=[touched.prior for touched in touches],
            seed=seeds,
            on_progress=lambda done, total: progress.update(task, completed=done),
        )
    return [judge(touched, estimate) for touched, estimate in zip(touches, estimates, strict=True)]


def draw(model: tp.ObjectModel, estimate: tp.PoseEstimate, generator: np.random.Generator) -> Array:
    """Draws poses (DRAWS, 3, 4) from the belief, without rotations about an axis of symmetry."""
    weights = np.array([hypothesis.probability for hypothesis in estimate.hypotheses])
    chosen = generator.choice(len(weights), DRAWS, p=weights / weights.sum())
    poses = []
    for hypothesis in (estimate.hypotheses[i] for i in chosen):
        X_PO = hypothesis.X_PO.GetAsMatrix34()
        u = np.linalg.cholesky(hypothesis.covariance) @ generator.normal(size=6)
        for symmetry in (symmetry for symmetry in model.symmetries if symmetry.is_continuous):
            turn = np.concatenate([symmetry.axis, -X_PO[:, :3] @ np.cross(symmetry.axis, symmetry.point)])
            u = u - (symmetry.axis @ u[:3]) * turn
        poses.append(retract(X_PO, u))
    return np.array(poses)


def main() -> None:
    """Prints the figures with a prior and without one, and draws them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--scans", type=Path, help="a folder of further meshes")
    parser.add_argument("--contacts", type=int, default=5)
    parser.add_argument("--without-normals", action="store_true", help="the estimate is told the points alone")
    parser.add_argument("--noise", type=float, default=1.0, help="in units of 0.9 mm and 5 degrees")
    parser.add_argument("--spread", action="store_true", help="contacts far apart, rather than anywhere")
    parser.add_argument("--out", type=Path, default=Path("out/calibration"))
    arguments = parser.parse_args()
    meshes = [model_path("objects", f"{name}.obj") for name in arguments.objects]
    if arguments.scans is not None:
        meshes += sorted(arguments.scans.glob("*.obj"))
    models = [tp.ObjectModel.from_mesh(mesh) for mesh in meshes]

    started = time.perf_counter()
    runs: dict[str, list[Trial]] = {}
    for title in (WITH_PRIOR, WITHOUT):
        runs[title] = run_trials(models, title, arguments)
    text = "\n".join(summary(title, trials) for title, trials in runs.items())
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "calibration.txt").write_text(text + "\n", encoding="utf-8")
    save_figure(runs, arguments.out / "calibration.png")
    print(text)
    print(f"Written to {arguments.out} after {time.perf_counter() - started:.0f} s.")


if __name__ == "__main__":
    main()
