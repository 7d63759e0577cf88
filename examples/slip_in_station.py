"""Slip under load in the simulated station: a hand of 24 joints holds an object that grows heavier until it slides.

python examples/slip_in_station.py --objects bust mug

The belief is updated at 100 Hz from the simulated fingertips' wrenches and the joints; contact is Drake's hydroelastic
one. Printed are the belief's error beside what it says of it, its normalised estimation error squared (6 for an honest
belief), how often it says that the object slips, and where the time goes: processor seconds of the whole station, and
of the belief's updates.
"""

import argparse
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
HEAVIER = 15.0  # times its weight, each second
LOST_GRIP = 0.02  # m that it slides until the end


class Row(NamedTuple):
    """One instant: time, s; load, in weights; slide, m; the belief's status; its error and what it says, m; NEES."""

    time: float
    load: float
    slide: float
    status: str
    error: float
    said: float
    square: float


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
    parser.add_argument("--seconds", type=float, default=1.0, help="that the time is measured for")
    parser.add_argument("--out", type=Path, default=Path("out/slip_in_station"))
    arguments = parser.parse_args()
    runs, lines = {}, []
    for name in arguments.objects:
        grasp = simulate_grasp(Scenario(object=name, tracking=PoseTrackingParams()))
        total, updates = hold(grasp, arguments.seconds)
        lines.append(
            f"{name}: {arguments.seconds:g} s of the station take {total:.2f} s of one processor, {updates:.2f} s of "
            f"them the belief's updates: real-time factor {arguments.seconds / total:.2f} with all that is simulated, "
            f"{arguments.seconds / updates:.1f} of the belief alone"
        )
        rows = load_until_it_slides(grasp, 2.0 * arguments.seconds)
        runs[name] = rows
        squares = [row.square for row in rows if np.isfinite(row.square)]
        lines.append(
            f"{name}: slid by {1e3 * rows[-1].slide:.1f} mm at {rows[-1].load:.0f} times its weight; error "
            f"{1e3 * rows[0].error:.1f} mm before and {1e3 * rows[-1].error:.1f} mm after, said "
            f"{1e3 * rows[-1].said:.1f} mm; NEES {np.mean(squares):.1f}; called slipping in "
            f"{np.mean([row.status == 'slipping' for row in rows]):.0%} of {len(rows)} instants"
        )
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "slip_in_station.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(runs, arguments.out / "slip_in_station.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
