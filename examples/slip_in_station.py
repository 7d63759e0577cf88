"""Slip under load in the simulated station: a hand with 24 joints holds an object that gets heavier until it slides.

python examples/slip_in_station.py --objects bust mug --grasps 5

The belief is updated at 100 Hz from the simulated fingertips' wrenches and the joint positions; contact is
hydroelastic. Each grasp is loaded several times from the same instant, with weights that grow at different rates.
Fingers yield under load, so that a motion of the object in the palm is not necessarily a slide. The slide is the true
motion of the object's surface relative to a fingertip that touches it, at the fingertip where it is largest.

Prints the belief's error and its stated standard deviation, its normalized estimation error squared (NEES, 6 for a
consistent belief), how often its status is "slipping", and CPU times of the whole station and of the belief's updates.
A slide of at least 10 mm begins with its first millimetre; the delay is the time from there until the status is
"slipping". A detection is false if nothing slides by a millimetre within a tenth of a second from it, and an early one
among these if that happens within half a second. False detections are also counted while the object is held. A slide is
in progress if the object has slid by a millimetre within the last 50 ms; the statuses at these instants are counted.
With `--relieved`, loads under which nothing slides are also applied and removed.
"""

import argparse
import functools
import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from nearest_images import least_error
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from tactopose_drake.runs import GraspResult, simulate_grasp
from tactopose_drake.station import Scenario, Station
from tactopose_drake.systems import PoseTrackingParams

PERIOD = 0.01
DRAWN = 4  # maximum number of slides that are plotted
RATES = (10.0, 20.0, 40.0)  # growth of the load, in weights of the object per second
# Loads that are applied and removed: shares of the load at which it begins to slide, their growth, in weights per
# second, and the time at the largest load, s.
PARTS, RELIEVED_RATES, STAYS = (0.4, 0.7), (10.0, 30.0), 0.3
SLIPPED, LOST = 0.02, 0.06  # slide, and motion in the palm, at which a run ends, m
SLIDE, BEGUN = 0.01, 0.001  # length of a slide that is counted, and from which it has begun, m
SOON, LATER = 0.1, 0.5  # time within which the slide of a detection begins, and that of an early one, s
LATELY = 0.05  # time in which a slide in progress has advanced by `BEGUN`, s


class Row(NamedTuple):
    """One instant: time since the load began, s; load, in weights; slide, m; the belief's status; its error and stated
    standard deviation, m; NEES.
    """

    time: float
    load: float
    slide: float
    status: str
    error: float
    said: float
    square: float


class Slide:
    """The slide of the object at each fingertip: the true relative motion of both at the estimated contacts."""

    def __init__(self, station: Station, context: Context) -> None:
        """Starts at the context's time."""
        self._station, self._ways = station, dict.fromkeys(station.hand.sensor_frames, np.zeros(3))
        self._X_PO, self._X_PT = self._poses(context)

    def follow(self, context: Context) -> float:
        """The largest slide of a fingertip since the start, m; the context is one period after the last one."""
        diagram, (X_PO, X_PT) = self._station.diagram, self._poses(context)
        fingers, contacts = (diagram.GetOutputPort(name).Eval(context) for name in ("fingers_in_contact", "contacts"))
        for finger, p_PC in zip(fingers, contacts.p_PC, strict=True):
            # The previous positions of the contact point, as a point of the object and of the fingertip.
            p_O, p_T = self._X_PO @ (X_PO.inverse() @ p_PC), self._X_PT[finger] @ (X_PT[finger].inverse() @ p_PC)
            self._ways[finger] = self._ways[finger] + p_T - p_O
        self._X_PO, self._X_PT = X_PO, X_PT
        return float(max(np.linalg.norm(way) for way in self._ways.values()))

    def _poses(self, context: Context) -> tuple[RigidTransform, dict[str, RigidTransform]]:
        """Poses in the palm of the object, and of the fingertips by finger."""
        station, hand = self._station, self._station.hand
        plant_context = station.plant.GetMyContextFromRoot(context)
        tips = {
            finger: station.plant.CalcRelativeTransform(plant_context, hand.palm_frame, frame)
            for finger, frame in hand.sensor_frames.items()
        }
        return station.object_pose(context), tips


def delay(rows: list[Row]) -> float | None:
    """Delay from a slide's first millimetre to its detection, s; infinite if it is not detected, None if none slides.

    If the status is "slipping" already when the slide begins, the delay is 0.
    """
    if max(row.slide for row in rows) < SLIDE:
        return None
    begun = next(row.time for row in rows if row.slide > BEGUN)
    return next((row.time - begun for row in rows if row.time >= begun and row.status == "slipping"), np.inf)


def false_calls(rows: list[Row]) -> tuple[int, int, float]:
    """Numbers of false detections and of early ones among these, and the time before the first millimetre, s."""
    begins = [now for before, now in itertools.pairwise(rows) if now.status == "slipping" != before.status]
    soon, later = (
        [max(row.slide for row in rows if now.time <= row.time <= now.time + wait) >= BEGUN for now in begins]
        for wait in (SOON, LATER)
    )
    early = sum(then and not at_once for at_once, then in zip(soon, later, strict=True))
    return soon.count(False), early, PERIOD * sum(row.slide < BEGUN for row in rows)


def while_sliding(rows: list[Row]) -> list[str]:
    """The belief's statuses at the instants at which a slide is in progress."""
    before = [0.0] * round(LATELY / PERIOD) + [row.slide for row in rows]
    return [row.status for then, row in zip(before, rows, strict=False) if row.slide - then > BEGUN]


def hold(grasp: GraspResult, seconds: float) -> tuple[float, float, int]:
    """Simulates a held object for `seconds`; returns the CPU times of the station and of the belief's updates, s, and
    the number of (false) detections of slip.
    """
    simulator, diagram = grasp.simulator, grasp.station.diagram
    context, updates = simulator.get_mutable_context(), 0.0
    says: list[bool] = []
    started = time.process_time()
    for _ in range(round(seconds / PERIOD)):
        simulator.AdvanceTo(context.get_time() + PERIOD)
        if grasp.station.scenario.tracking is not None:
            estimate = diagram.GetOutputPort("tracked_hypotheses").Eval(context)
            updates += estimate.duration if estimate is not None else 0.0
            says.append(diagram.GetOutputPort("tracked_status").Eval(context).startswith("slipping"))
    return time.process_time() - started, updates, sum(now > before for before, now in itertools.pairwise(says))


def load_until_it_slides(grasp: GraspResult, load_at: Callable[[float], float], longest: float) -> list[Row]:
    """Makes the held object heavier, and compares the belief with the truth.

    Args:
        grasp: the grasp of the object.
        load_at: load, in weights of the object, by the time since the start, s.
        longest: maximum duration, s.
    """
    station, context = grasp.station, grasp.context.Clone()
    simulator = Simulator(station.diagram, context)
    simulator.set_monitor(station.release_when_held)
    simulator.Initialize()
    plant_context = station.plant.GetMyMutableContextFromRoot(context)
    M = station.object_body.CalcSpatialInertiaInBodyFrame(plant_context)
    begun, p_held, rows = context.get_time(), station.object_pose(context).translation(), list[Row]()
    slide = Slide(station, context)
    while context.get_time() < begun + longest:
        load = load_at(context.get_time() - begun)
        heavy = SpatialInertia(load * M.get_mass(), M.get_com(), M.get_unit_inertia())
        station.object_body.SetSpatialInertiaInBodyFrame(plant_context, heavy)
        simulator.AdvanceTo(context.get_time() + PERIOD)
        belief = station.diagram.GetOutputPort("tracked_belief").Eval(context)
        X_PO = station.object_pose(context)
        error, said, square = np.nan, np.nan, np.nan
        if belief.has_pose:
            u = least_error(station.model, belief.X_PO[0], X_PO.GetAsMatrix34())
            error, square = float(np.linalg.norm(u[3:])), float(u @ np.linalg.solve(belief.covariance[0], u))
            said = float(np.sqrt(np.trace(belief.covariance[0][3:, 3:])))
        rows.append(Row(context.get_time() - begun, load, slide.follow(context), belief.status, error, said, square))
        if rows[-1].slide > SLIPPED or np.linalg.norm(X_PO.translation() - p_held) > LOST:
            break
    return rows


def grows(rate: float, time: float) -> float:
    """A load that grows by `rate` weights per second."""
    return 1.0 + rate * time


def comes_and_goes(rate: float, most: float, time: float) -> float:
    """A load that grows to `most` weights, stays there for a moment, and decreases again."""
    return float(np.clip(1.0 + rate * min(time, 2.0 * (most - 1.0) / rate + STAYS - time), 1.0, most))


def calls_while_it_holds(grasp: GraspResult, rows: list[Row]) -> tuple[int, float]:
    """Number of detections under loads that are applied and removed without a slide of a millimetre, and the time, s.

    Args:
        grasp: the grasp of the object.
        rows: rows of a load that has grown until the object slid.
    """
    calls, seconds = 0, 0.0
    slid = next((row.load for row in rows if row.slide > 0.5 * BEGUN), rows[-1].load)
    for part, rate in itertools.product(PARTS, RELIEVED_RATES):
        most = 1.0 + part * (slid - 1.0)
        load_at = functools.partial(comes_and_goes, rate, most)
        relieved = load_until_it_slides(grasp, load_at, 2.0 * ((most - 1.0) / rate + STAYS))
        if max(row.slide for row in relieved) < BEGUN:
            said = [row.status == "slipping" for row in relieved]
            calls += sum(now > before for before, now in itertools.pairwise([False, *said]))
            seconds += PERIOD * len(relieved)
    return calls, seconds


def save_figure(runs: dict[str, list[Row]], path: Path) -> None:
    """Plots the slide, the belief's error and its stated standard deviation over the load."""
    figure = Figure(figsize=(6.5 * len(runs), 4.2), layout="constrained")
    for ax, (name, rows) in zip(figure.subplots(1, len(runs), squeeze=False)[0], runs.items(), strict=True):
        load = [row.load for row in rows]
        ax.plot(load, [1e3 * row.slide for row in rows], color="0.4", label="it has slid by")
        ax.plot(load, [1e3 * row.error for row in rows], label="error of the belief")
        ax.plot(load, [1e3 * row.said for row in rows], "--", label="standard deviation that it states")
        slipping: list[bool] = [row.status == "slipping" for row in rows]
        where: NDArray[np.bool_] = np.array(slipping)
        ax.fill_between(load, 0, 1, where=where, transform=ax.get_xaxis_transform(), alpha=0.2, color="#b9589f")
        ax.plot([], [], color="#b9589f", alpha=0.4, linewidth=6, label="it says slipping")
        ax.set(xlabel="load, in weights of the object", ylabel="mm", title=name)
        ax.legend(fontsize=8)
    FigureCanvasAgg(figure).print_png(path)


def in_words(case: str, rows: list[Row]) -> str:
    """The results of one slide as text."""
    squares = [row.square for row in rows if np.isfinite(row.square)]
    return (
        f"{case}: slid by {1e3 * rows[-1].slide:.1f} mm at {rows[-1].load:.0f} times its weight; error "
        f"{1e3 * rows[0].error:.1f} mm before and {1e3 * rows[-1].error:.1f} mm after, said "
        f"{1e3 * rows[-1].said:.1f} mm; NEES {np.mean(squares):.1f}; called slipping in "
        f"{np.mean([row.status == 'slipping' for row in rows]):.0%} of {len(rows)} instants"
    )


def run(arguments: argparse.Namespace) -> tuple[dict[str, list[Row]], list[str]]:
    """The slides by object, seed and rate, and the lines of the results."""
    runs: dict[str, list[Row]] = {}
    lines, calls, held, held_on = [], 0, 0.0, np.zeros(2)
    for name, seed in itertools.product(arguments.objects, range(arguments.grasps)):
        grasp = simulate_grasp(Scenario(object=name, seed=arguments.first_seed + seed, tracking=PoseTrackingParams()))
        case = f"{name}, seed {arguments.first_seed + seed}"
        total, updates, says = hold(grasp, arguments.seconds)
        calls, held = calls + says, held + arguments.seconds
        lines.append(
            f"{case}: {arguments.seconds:g} s of the station take {total:.2f} s of one processor, {updates:.2f} s of "
            f"them the belief's updates: real-time factor {arguments.seconds / total:.2f} with all that is simulated, "
            f"{arguments.seconds / updates:.1f} of the belief alone"
        )
        for rate in arguments.rates:
            of_rate = f"{case}, {rate:g} weights a second"
            runs[of_rate] = load_until_it_slides(grasp, functools.partial(grows, rate), 2.0 * arguments.seconds)
            lines.append(in_words(of_rate, runs[of_rate]))
        if arguments.relieved:
            held_on += np.array(calls_while_it_holds(grasp, runs[f"{case}, {arguments.rates[0]:g} weights a second"]))
    delays = [seconds for seconds in map(delay, runs.values()) if seconds is not None]
    more, early, still = np.sum([false_calls(rows) for rows in runs.values()], axis=0)
    squares = [row.square for rows in runs.values() for row in rows if row.slide > BEGUN and np.isfinite(row.square)]
    says_then = [status for rows in runs.values() for status in while_sliding(rows)]
    lines.append(
        f"of {len(delays)} slides of 10 mm or more {sum(seconds <= 0.05 + 1e-6 for seconds in delays)} are called so "
        f"within 50 ms of their first millimetre, {np.count_nonzero(np.isfinite(delays))} at all; NEES while they "
        f"slide {np.mean(squares or [np.nan]):.1f}; {calls + more:.0f} false calls in {held + still:.1f} s, of which "
        f"{early:.0f} are early ones of slides; of "
        f"{len(says_then)} instants at which a slide goes on it says slipping at {says_then.count('slipping')}, ok at "
        f"{says_then.count('ok')}"
    )
    if arguments.relieved:
        lines.append(f"loads that come and go, of which nothing slides: {held_on[0]:.0f} calls in {held_on[1]:.1f} s")
    return runs, lines


def main() -> None:
    """Prints and draws how each object slides, and what the station costs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=["bust", "mug"])
    parser.add_argument("--grasps", type=int, default=1, help="of each object")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--rates", type=float, nargs="+", default=RATES, help="weights that are added a second")
    parser.add_argument("--relieved", action="store_true", help="with loads that come and go, too")
    parser.add_argument("--seconds", type=float, default=1.0, help="that the time is measured for")
    parser.add_argument("--out", type=Path, default=Path("out/slip_in_station"))
    arguments = parser.parse_args()
    runs, lines = run(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "slip_in_station.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(dict(itertools.islice(runs.items(), DRAWN)), arguments.out / "slip_in_station.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
