"""Calibration of the estimates from tactile arrays: how often the truth is in the 95 % region of the hypotheses.

    python examples/patch_calibration.py --trials 1000 --out patches
    python examples/patch_calibration.py --trials 200 --false 1 --out patches

Objects in random poses are gripped by four flat pads at random places, or, in half of the grips, by three pads and two
contacts. The pads' poses have errors of 0.9 mm and 5 degrees, as the estimate assumes, and their cells' depths have
errors of 0.1 mm. With `--false N`, N of the pads touch something else, anywhere near the object. As in
`calibration.py`, the study counts how often the truth is in the smallest set of hypotheses with 95 % of the
probability, and how often that is promised. It also counts how often the hypotheses are complete: whether the truth is
in the 99.9 % ellipsoid of any of them, however improbable.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from calibration import OBJECTS, draw, region_holds
from nearest_images import nearest_increments
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations, transform_points
from tactopose_drake.core.sensing import Patch, describe_patch
from tactopose_drake.core.synthetic import touch_surface, touch_with_pads
from tactopose_drake.resources import model_path

LEVEL, COMPLETE = 0.95, 0.999
PADS, PADS_BESIDE, CONTACTS = 4, 3, 2
SURE = 0.95  # a hypothesis with a larger probability is claimed

Array = NDArray[np.float64]


class Trial(NamedTuple):
    """The result of one grip.

    Attributes:
        name: name of the object.
        contacts: number of contacts beside the pads.
        held: whether the 95 % set contains the truth.
        promised: the share of truths drawn from the belief that its set contains.
        complete: whether the 99.9 % ellipsoid of any hypothesis contains the truth.
        claimed: whether the best hypothesis has more than 95 % of the probability.
        right: whether its 99.9 % ellipsoid contains the truth.
        status: status of the estimate.
        doubted: probability of touching something else: the largest of the true pads, and the least of the false ones.
        seconds: wall time of the estimate.
    """

    name: str
    contacts: int
    held: bool
    promised: float
    complete: bool
    claimed: bool
    right: bool
    status: str
    doubted: tuple[float, float]
    seconds: float


def falsified(patch: Patch, p_PO: Array, size: float, generator: np.random.Generator) -> Patch:
    """The patch with a random orientation and a random position near the object, as if on something else."""
    R, middle = random_rotations(generator, 1)[0], patch.p_PT.mean(axis=0)
    p_PT = p_PO + (generator.random(3) - 0.5) * size + (patch.p_PT - middle) @ R.T
    return describe_patch(p_PT, patch.pressure, alpha=patch.alpha, n_PT=patch.n_PT @ R.T)


def grip(model: tp.ObjectModel, seed: int, false: int) -> tuple[Array, tp.Contacts, tuple[Patch, ...]]:
    """The true pose (3, 4), the contacts and the patches; the first ones are false."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    beside = seed // len(OBJECTS) % 2 == 1
    patches = list(touch_with_pads(model, X_PO, PADS_BESIDE if beside else PADS, generator))
    contacts = touch_surface(model, X_PO, CONTACTS, generator) if beside else tp.Contacts.empty()
    middle = transform_points(X_PO, model.middle[None])[0]
    patches[:false] = [falsified(patch, middle, model.size, generator) for patch in patches[:false]]
    return X_PO, contacts, tuple(patches)


def run_trial(model: tp.ObjectModel, seed: int, false: int) -> Trial:
    """Grips the object, estimates its pose, and compares."""
    X_PO, contacts, patches = grip(model, seed, false)
    started = time.perf_counter()
    found = tp.estimate_pose(model, contacts, patches=patches, seed=seed)
    seconds = time.perf_counter() - started
    within = []
    for hypothesis in found:
        information = np.linalg.inv(hypothesis.covariance)
        u = nearest_increments(model, hypothesis.X_PO.GetAsMatrix34(), information, X_PO[None])[0]
        within.append(float(u @ information @ u) < chi2.ppf(COMPLETE, 6))
    doubt = 1.0 - found.best.inlier_probability[len(contacts) :]
    return Trial(
        name=model.name,
        contacts=len(contacts),
        held=bool(region_holds(model, found, X_PO[None], [LEVEL])[0, 0]),
        promised=float(region_holds(model, found, draw(model, found, np.random.default_rng(seed)), [LEVEL]).mean()),
        complete=any(within),
        claimed=found.best.probability > SURE,
        right=within[0],
        status=found.status,
        doubted=(float(doubt[false:].max()), float(doubt[:false].min(initial=1.0))),
        seconds=seconds,
    )


def summary(title: str, trials: Sequence[Trial]) -> str:
    """The results of some trials as text."""
    count = len(trials)
    held, complete = np.mean([trial.held for trial in trials]), np.mean([trial.complete for trial in trials])
    claimed = [trial for trial in trials if trial.claimed and trial.status != "no_solution"]
    promised = np.mean([trial.promised for trial in trials])
    return (
        f"{title}: {count} grips; the set that holds 95 %: {100 * held:.1f}% +- "
        f"{100 * np.sqrt(held * (1 - held) / count):.1f} (promised {100 * promised:.1f}%); "
        f"a right mode among the hypotheses {100 * complete:.1f}%; claimed with more than {SURE:.0%} {len(claimed)}, "
        f"wrong {sum(not trial.right for trial in claimed)}; no solution "
        f"{sum(trial.status == 'no_solution' for trial in trials)}; true pads doubted "
        f"{sum(trial.doubted[0] > 0.5 for trial in trials)}, false ones not {sum(t.doubted[1] < 0.5 for t in trials)}; "
        f"median {1e3 * np.median([trial.seconds for trial in trials]):.0f} ms"
    )


def main() -> None:
    """Prints the figures of all grips, of those with and without contacts, and of each object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--false", type=int, default=0, help="pads of each grip that are pressed on something else")
    parser.add_argument("--out", type=Path, default=Path("out/patch_calibration"))
    arguments = parser.parse_args()
    models = [tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")) for name in arguments.objects]
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.trials)
    trials = [
        run_trial(models[seed % len(models)], seed, arguments.false)
        for seed in track(seeds, "grips", console=Console(stderr=True), transient=True)
    ]
    lines = [summary("all", trials)]
    for count, title in ((0, "pads alone"), (CONTACTS, "with contacts")):
        if chosen := [trial for trial in trials if trial.contacts == count]:
            lines.append(summary(title, chosen))
    for name in dict.fromkeys(trial.name for trial in trials):
        lines.append(summary(name, [trial for trial in trials if trial.name == name]))
    missed = [str(seed) for seed, trial in zip(seeds, trials, strict=True) if not trial.complete]
    lines.append(f"Seeds of grips with no right mode: {', '.join(missed) or 'none'}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "patch_calibration.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
