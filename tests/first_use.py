"""What is compiled first decides nothing: `python -m tests.first_use`, some ten minutes of processor time.

Each of five public calls comes first once, in a process with empty caches of kernels and models. A second process then
makes all of them, beginning with that one: it loads what the first has compiled, and compiles the rest. Prints a digest
of all numbers for each order and call. Exit status 1 where two orders differ in a bit.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.core.tracking import Frame, PoseTracker
from tactopose_drake.resources import model_path

_SEEDS = range(3)


def _touch(seed: int, name: str = "mug") -> tuple[tp.ObjectModel, tp.Contacts, np.ndarray]:
    """An object, contacts with it, and the pose in which it was touched."""
    generator = np.random.default_rng(seed)
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(scale=0.05, size=(1, 3)))[0]
    return model, touch_surface(model, X_PO, 5, generator), X_PO


def _bytes_of(estimate: tp.PoseEstimate) -> bytes:
    """All numbers of an estimate but its duration."""
    parts = [estimate.status.encode(), np.float64(estimate.log_evidence).tobytes()]
    for pose in estimate.hypotheses:
        parts += [np.array([pose.cost, pose.probability]).tobytes(), pose.X_PO.GetAsMatrix34().tobytes()]
        parts += [np.array(pose.covariance).tobytes(), np.array(pose.free_directions).tobytes()]
    return b"".join(parts)


def with_prior(seed: int) -> bytes:
    model, contacts, X_PO = _touch(seed)
    return _bytes_of(tp.estimate_pose(model, contacts, prior=tp.PosePrior(X_PO)))


def without_prior(seed: int) -> bytes:
    model, contacts, _ = _touch(seed)
    return _bytes_of(tp.estimate_pose(model, contacts))


def locally(seed: int) -> bytes:
    model, contacts, X_PO = _touch(seed)
    return _bytes_of(tp.estimate_pose(model, contacts, prior=tp.PosePrior(X_PO), method="levenberg_marquardt"))


def identified(seed: int) -> bytes:
    cube, mug = _touch(seed, "cube"), _touch(seed)
    found = tp.identify([cube[0], mug[0]], mug[1])
    return b"".join(np.float64(identity.log_evidence).tobytes() for identity in found.identities)


def tracked(seed: int) -> bytes:
    model, contacts, X_PO = _touch(seed)
    tracker = PoseTracker(model)
    belief = tracker.start(0.0)
    for step in range(1, 6):
        points = contacts.p_PC + 1e-4 * np.random.default_rng([seed, step]).normal(size=contacts.p_PC.shape)
        evidence = Evidence(tp.Contacts(points, contacts.n_PC), prior=tp.PosePrior(X_PO) if seed % 2 else None)
        belief = tracker.step(belief, Frame(0.01 * step, evidence))
    return b"".join(np.array(part).tobytes() for part in (belief.X_PO, belief.covariance, belief.probability))


def solved(seed: int) -> bytes:
    generator = np.random.default_rng(seed)
    F_S = np.concatenate([0.01 * generator.normal(size=3), generator.normal(size=2), [-3.0]])
    return tp.solve_contact(F_S, tp.Ellipsoid(semi_axes=(0.009, 0.008, 0.012))).p_SC.tobytes()


def described(seed: int) -> bytes:
    generator = np.random.default_rng(seed)
    cells = generator.normal(size=(20, 3)) * [0.01, 0.01, 0.0]
    patch = tp.describe_patch(cells, 1e4 * generator.random(20), alpha=1e-8)
    return patch.centroid.tobytes() + patch.eigenvectors.tobytes() + patch.eigenvalues.tobytes()


CALLS: dict[str, Callable[[int], bytes]] = {
    call.__name__: call for call in (with_prior, without_prior, locally, identified, tracked, solved, described)
}
ORDERS = ("with_prior", "without_prior", "locally", "identified", "tracked")


def digests(names: Sequence[str]) -> dict[str, str]:
    """Of all numbers that come of these calls, made in this process in this order."""
    return {name: hashlib.sha256(b"".join(CALLS[name](seed) for seed in _SEEDS)).hexdigest() for name in names}


def digests_elsewhere(names: Sequence[str], caches: Path) -> dict[str, str]:
    """The same in a process of its own, whose kernels and models are cached in a folder."""
    folders = {"NUMBA_CACHE_DIR": str(caches / "kernels"), "TACTOPOSE_CACHE_DIR": str(caches / "models")}
    command = [sys.executable, "-m", "tests.first_use", "--here", *names]
    answer = subprocess.run(command, env=os.environ | folders, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(answer.stdout)


def digests_of_orders(first: Iterable[str], names: Sequence[str]) -> Iterator[dict[str, str]]:
    """For each call that comes first, alone, the digests of all: that one, then those that follow it in turn."""
    for name in first:
        at = names.index(name)
        with tempfile.TemporaryDirectory() as caches:
            alone = digests_elsewhere([name], Path(caches))
            found = digests_elsewhere([*names[at:], *names[:at]], Path(caches))
        yield found if found[name] == alone[name] else {**found, name: f"{found[name]} or {alone[name]}"}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.first_use", description=__doc__)
    parser.add_argument("--here", nargs="+", choices=CALLS, help="makes these calls in this process and prints JSON")
    arguments = parser.parse_args()
    if arguments.here:
        print(json.dumps(digests(arguments.here)))
        return 0
    found, began = [], time.monotonic()
    for name, order in zip(ORDERS, digests_of_orders(ORDERS, list(CALLS)), strict=True):
        found.append(order)
        print(f"{name} first, {time.monotonic() - began:.0f} s")
        print(*(f"  {call}: {order[call]}" for call in CALLS), sep="\n", flush=True)
    return int(any(order != found[0] for order in found))


if __name__ == "__main__":
    sys.exit(main())
