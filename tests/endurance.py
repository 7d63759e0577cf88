"""Memory over a long run: `python -m tests.endurance tracking --minutes 60`, or `estimating`.

Tracks at 100 Hz, or estimates twenty times a second, in real time, and prints every minute what is resident, and what
would be if all of the files that are mapped were: a system puts cold pages of libraries and models out, and what comes
back is no growth. Exit status 1 where the latter has grown by more than 5 MB since the fifth minute.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.core.tracking import Frame, PoseTracker
from tactopose_drake.resources import model_path

SETTLED, ALLOWED = 5.0, 5.0  # minutes, MB
OBJECTS = ("mug", "bust", "spray_bottle", "tea_box", "wine_glass")


def resident() -> float:
    """What of this process is in memory, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 2**20


def at_the_most() -> float:
    """What of this process is in memory and of no file, and all of the files that it has mapped, MB."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines())
    own = 1024 * int(status["RssAnon"].split()[0])
    regions = [line.split(maxsplit=5) for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()]
    ends = [region[0].split("-") for region in regions if len(region) > 5 and region[5].startswith("/")]
    return (own + sum(int(end, 16) - int(start, 16) for start, end in ends)) / 2**20


def touches() -> Iterator[tuple[tp.ObjectModel, tp.Contacts, np.ndarray]]:
    """Touches of several objects without end, each with the object's pose."""
    generator = np.random.default_rng(0)
    models = [tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")) for name in OBJECTS]
    while True:
        model = models[generator.integers(len(models))]
        X_PO = make_poses(random_rotations(generator, 1), generator.normal(scale=0.05, size=(1, 3)))[0]
        yield model, touch_surface(model, X_PO, int(generator.integers(3, 8)), generator), X_PO


def tracking() -> tuple[Callable[[], None], float]:
    """A step of a tracker that is given a new grasp every two seconds, and its period, s."""
    source, generator = touches(), np.random.default_rng(1)
    state = {"step": 0}

    def step() -> None:
        if state["step"] % 200 == 0:
            model, state["contacts"], X_PO = next(source)
            state["tracker"] = PoseTracker(model)
            state["belief"] = state["tracker"].start(0.0)
            state["prior"] = tp.PosePrior(retract(X_PO, 0.1 * generator.normal(size=6) * [1, 1, 1, 0.1, 0.1, 0.1]))
        contacts, at = state["contacts"], 0.01 * (1 + state["step"] % 200)
        noisy = tp.Contacts(contacts.p_PC + generator.normal(scale=2e-4, size=contacts.p_PC.shape), contacts.n_PC)
        frame = Frame(at, Evidence(noisy, prior=state["prior"]))
        state["belief"] = state["tracker"].step(state["belief"], frame)
        state["step"] += 1

    return step, 0.01


def estimating() -> tuple[Callable[[], None], float]:
    """An estimate of a new touch, with a prior and without in turn, and its period, s."""
    source = touches()
    state = {"count": 0}

    def step() -> None:
        model, contacts, X_PO = next(source)
        state["count"] += 1
        tp.estimate_pose(model, contacts, prior=tp.PosePrior(X_PO) if state["count"] % 2 else None)

    return step, 0.05


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.endurance", description=__doc__)
    parser.add_argument("what", choices=["tracking", "estimating"])
    parser.add_argument("--minutes", type=float, default=60.0)
    arguments = parser.parse_args()
    step, period = {"tracking": tracking, "estimating": estimating}[arguments.what]()
    if arguments.minutes <= SETTLED:
        parser.error(f"--minutes must be more than {SETTLED:g}, after which memory is compared")
    began, steps, printed, settled = time.monotonic(), 0, -1, 0.0
    for end in (SETTLED, arguments.minutes):
        settled = at_the_most()
        while (minutes := (time.monotonic() - began) / 60.0) < end:
            step()
            steps += 1
            if int(minutes) > printed:
                printed = int(minutes)
                print(f"{printed:3d} min  {steps:7d} steps  {resident():7.1f} MB of {at_the_most():7.1f}", flush=True)
            time.sleep(max(0.0, began + steps * period - time.monotonic()))
    grown = at_the_most() - settled
    print(f"{steps} steps, grown by {grown:.1f} MB since minute {SETTLED:g}")
    return int(grown > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
