"""Slip under load in the simulated station: a hand of 24 joints holds an object that grows heavier until it slides.

python examples/slip_in_station.py --objects bust mug --grasps 5

The belief is updated at 100 Hz from the simulated fingertips' wrenches and the joints; contact is Drake's hydroelastic
one. Printed are the belief's error beside what it says of it, its normalised estimation error squared (6 for an honest
belief), how often it says that the object slips, and where the time goes: processor seconds of the whole station, and
of the belief's updates. A slide of at least 10 mm has begun when the object has moved by its first millimetre; asked is
how much later it is called so, and how often that is said of an object that has not moved by half a millimetre.
"""

import argparse
import itertools
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.multibody.tree import SpatialInertia

from tactopose_drake.core.poses import increments_between
from tactopose_drake.runs import GraspResult, simulate_grasp
from tactopose_drake.station import Scenario
from tactopose_drake.systems import PoseTrackingParams

PERIOD = 0.01
DRAWN = 4  # of the slides, at the most
HEAVIER = 15.0  # times its weight, each second
LOST_GRIP = 0.02  # m that it slides until the end
SLIDE, BEGUN, STILL = 0.01, 0.001, 0.0005  # m: what counts as a slide, from where on it has begun, and before as none


class Row(NamedTuple):
    """One instant: time, s; load, in weights; slide, m; the belief's status; its error and what it says, m; NEES."""

    time: float
    load: float
    slide: float
    status: str
    error: float
    said: float
    square: float


def delay(rows: list[Row]) -> float | None:
    """From the first millimetre of a slide to the first call, s; infinite if it is never called, None if there is none.

    A call that is on when the slide begins is one at once.
    """
    if rows[-1].slide < SLIDE:
        return None
    begun = next(row.time for row in rows if row.slide > BEGUN)
    return next((row.time - begun for row in rows if row.time >= begun and row.status == "slipping"), np.inf)


def false_calls(rows: list[Row]) -> tuple[int, float]:
    """How often an object that is still is said to begin to slip, and for how long it was still, s."""
    still = [row.status == "slipping" for row in rows if row.slide < STILL]
    return sum(now and not before for before, now in zip([False, *still], still, strict=False)), PERIOD * len(still)


def hold(grasp: GraspResult, seconds: float) -> tuple[float, float]:
    """Processor time of the station, s, for so many seconds of its own, and that of the belief's updates."""
    simulator, diagram = grasp.simulator, grasp.station.diagram
    context, updates = simulator.get_mutable_context(), 0.0
    started = time.process_time()
    for _ in range(round(seconds / PERIOD)):
        simulator.AdvanceTo(context.get_time() + PERIOD)
        if grasp.station.scenario.tracking is not None:
            estimate = diagram.GetOutputPort("tracked_hypotheses").Eval(context)
            updates += estimate.duration if estimate is not None else 0.0
    return time.process_time() - started, updates


def load_until_it_slides(grasp: GraspResult, longest: float) -> list[Row]:
    """Adds weight and compares the belief with the simulator's truth."""
    station, simulator = grasp.station, grasp.simulator
    context = simulator.get_mutable_context()
    plant_context = station.plant.GetMyMutableContextFromRoot(context)
    M = station.object_body.CalcSpatialInertiaInBodyFrame(plant_context)
    begun, p_held, rows = context.get_time(), station.object_pose(context).translation(), []
    while context.get_time() < begun + longest:
        load = 1.0 + HEAVIER * (context.get_time() - begun)
        heavy = SpatialInertia(load * M.get_mass(), M.get_com(), M.get_unit_inertia())
        station.object_body.SetSpatialInertiaInBodyFrame(plant_context, heavy)
        simulator.AdvanceTo(context.get_time() + PERIOD)
        belief = station.diagram.GetOutputPort("tracked_belief").Eval(context)
        X_PO = station.object_pose(context)
        slide = float(np.linalg.norm(X_PO.translation() - p_held))
        if belief.has_pose:
            u = increments_between(belief.X_PO[0], X_PO.GetAsMatrix34())
            error, square = float(np.linalg.norm(u[3:])), float(u @ np.linalg.solve(belief.covariance[0], u))
            said = float(np.sqrt(np.trace(belief.covariance[0][3:, 3:])))
        else:
            error, said, square = np.nan, np.nan, np.nan
        rows.append(Row(context.get_time() - begun, load, slide, belief.status, error, said, square))
        if slide > LOST_GRIP:
            break
    return rows


def save_figure(runs: dict[str, list[Row]], path: Path) -> None:
    """Slide, error and what the belief says, as the load grows."""
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


def main() -> None:
    """Prints and draws how each object slides, and what the station costs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=["bust", "mug"])
    parser.add_argument("--grasps", type=int, default=1, help="of each object")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=1.0, help="that the time is measured for")
    parser.add_argument("--out", type=Path, default=Path("out/slip_in_station"))
    arguments = parser.parse_args()
    runs: dict[str, list[Row]] = {}
    lines = []
    for name, seed in itertools.product(arguments.objects, range(arguments.grasps)):
        grasp = simulate_grasp(Scenario(object=name, seed=arguments.first_seed + seed, tracking=PoseTrackingParams()))
        case = f"{name}, seed {arguments.first_seed + seed}"
        total, updates = hold(grasp, arguments.seconds)
        lines.append(
            f"{case}: {arguments.seconds:g} s of the station take {total:.2f} s of one processor, {updates:.2f} s of "
            f"them the belief's updates: real-time factor {arguments.seconds / total:.2f} with all that is simulated, "
            f"{arguments.seconds / updates:.1f} of the belief alone"
        )
        rows = load_until_it_slides(grasp, 2.0 * arguments.seconds)
        runs[case] = rows
        squares = [row.square for row in rows if np.isfinite(row.square)]
        lines.append(
            f"{case}: slid by {1e3 * rows[-1].slide:.1f} mm at {rows[-1].load:.0f} times its weight; error "
            f"{1e3 * rows[0].error:.1f} mm before and {1e3 * rows[-1].error:.1f} mm after, said "
            f"{1e3 * rows[-1].said:.1f} mm; NEES {np.mean(squares):.1f}; called slipping in "
            f"{np.mean([row.status == 'slipping' for row in rows]):.0%} of {len(rows)} instants"
        )
    delays = [seconds for seconds in map(delay, runs.values()) if seconds is not None]
    calls, still = np.sum([false_calls(rows) for rows in runs.values()], axis=0)
    lines.append(
        f"of {len(delays)} slides of 10 mm or more {sum(seconds <= 0.05 for seconds in delays)} are called so within "
        f"50 ms, {sum(np.isfinite(delays)):g} at all; {calls:.0f} false calls in {still:.1f} s"
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "slip_in_station.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(dict(itertools.islice(runs.items(), DRAWN)), arguments.out / "slip_in_station.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
