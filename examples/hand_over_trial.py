"""One trial of handing over and placing a pencil, and its evaluation with the simulator's true state."""

import dataclasses
import math
import time

import numpy as np
from pencil_hand_over import LENGTH, hand_over
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from tactopose_drake.core.grasping import GraspPlan
from tactopose_drake.station import ArmStation, PlaceParams, planned_pose
from tactopose_drake.systems import seed_random_sources

DOWN_P = np.array(PlaceParams().down_P)
HOLE_RADIUS, RIM = 0.015, 0.1  # m; the rim's height above the table
LONGEST, REST = 60.0, 0.6  # maximum simulated time, and time simulated after the hand has opened, s


@dataclasses.dataclass
class Trial:
    """The results of one hand-over; errors are those of the estimate when the arm set off for the hole."""

    seed: int
    success: bool = False
    tries: int = 1  # grips until one was firm
    met: int = 0  # how often the arm moved the hand to the pencil
    outcome: str = ""
    angle_deg: float = math.nan  # angle between the pencil's estimated and true axis
    end_mm: float = math.nan  # error of the pencil's lower end across the pencil
    sigma_mm: float = math.nan  # its stated standard deviation
    along_mm: float = math.nan  # error of the pencil's lower end along the pencil
    sigma_along_mm: float = math.nan  # its stated standard deviation
    upside_down: float = math.nan  # total probability of the hypotheses with the wrong end up
    touches: int = 0  # number of touches of the table
    # True motion in the hand, from the release to the hand until the task failed or the hand was to open: rotation of
    # the pencil, and translation of its lower end.
    turned_deg: float = math.nan
    moved_mm: float = math.nan
    hole_mm: float = math.nan  # distance of the pencil's axis from the hole's in the rim's plane, before the release
    simulated: float = 0.0  # s
    cpu: float = 0.0  # s


def run_trial(closing: GraspPlan, station: ArmStation, seed: int, longest: float = LONGEST) -> Trial:
    """One trial from the hand-over to the end."""
    started, trial = time.process_time(), Trial(seed)
    generator = np.random.default_rng(seed)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    seed_random_sources(station.diagram, context, seed)
    _offer(station, context, hand_over(closing, generator))
    phase, ends_at, let_go = "receive", longest, None
    while context.get_time() < ends_at - 1e-9:
        simulator.AdvanceTo(context.get_time() + 0.02)
        before, phase = phase, station.diagram.GetOutputPort("phase").Eval(context)
        if phase == before:
            continue
        if phase == "receive":
            trial.tries += 1
        if phase == "receive" and before == "again":
            _offer(station, context, hand_over(closing, generator))
        elif phase == "meet":
            trial.met += 1
        elif phase == "feel":
            station.object_joint.Unlock(station.plant.GetMyMutableContextFromRoot(context))
            let_go = _lower_half(station, context)
        elif phase == "lift":
            trial.touches += 1
        elif phase == "move":
            _note_touch(trial, station, context)
        elif phase == "release":
            trial.hole_mm = 1e3 * float(np.linalg.norm(_at_rim(station, context) - hole()))
        if let_go is not None and (phase == "release" or phase.startswith("failed")):
            _note_motion(trial, let_go, _lower_half(station, context))
        if phase == "retreat" or phase.startswith("failed"):
            ends_at = context.get_time() + REST
    trial.success, trial.outcome = _judge(station, context, phase, trial)
    trial.simulated, trial.cpu = context.get_time(), time.process_time() - started
    return trial


def _offer(station: ArmStation, context: Context, plan: GraspPlan) -> None:
    """Holds the pencil into the open hand."""
    plant_context = station.plant.GetMyMutableContextFromRoot(context)
    X_WP = station.hand.palm_frame.CalcPoseInWorld(plant_context)
    station.plant.SetFreeBodyPose(plant_context, station.object_body, X_WP @ planned_pose(plan))


def hole() -> np.ndarray:
    """The hole's centre in the world, x and y, m."""
    return np.array(PlaceParams().p_WHole[:2])


def _note_touch(trial: Trial, station: ArmStation, context: Context) -> None:
    """Records the errors of the estimate in the palm."""
    task = station.diagram.GetSubsystemByName("place_task")
    held = task.state(task.GetMyContextFromRoot(context)).held
    X_PO = station.object_pose(context)
    axis = X_PO.rotation().col(2) * math.copysign(1.0, X_PO.rotation().col(2) @ held.direction)
    trial.angle_deg = math.degrees(math.acos(min(1.0, float(axis @ held.direction))))
    off = held.point(held.end) - _lower_half(station, context)[1]
    trial.end_mm = 1e3 * float(np.linalg.norm(off - (off @ axis) * axis))
    trial.along_mm = 1e3 * abs(float(off @ axis))
    trial.sigma_mm, trial.sigma_along_mm = 1e3 * held.sigma, 1e3 * held.sigma_end
    estimate = station.diagram.GetOutputPort("hypotheses").Eval(context)
    trial.upside_down = sum(
        hypothesis.probability
        for hypothesis in estimate.hypotheses
        if hypothesis.X_PO.rotation().col(2) @ X_PO.rotation().col(2) < 0.0
    )


def _lower_half(station: ArmStation, context: Context) -> np.ndarray:
    """The pencil's middle and lower end in the palm, shape (2, 3), m."""
    X_PO = station.object_pose(context)
    points = np.array([X_PO.multiply(np.array([0.0, 0.0, z])) for z in (0.5 * LENGTH, 0.0, LENGTH)])
    return points[[0, 1 + int(points[2] @ DOWN_P > points[1] @ DOWN_P)]]


def _note_motion(trial: Trial, before: np.ndarray, after: np.ndarray) -> None:
    """Records how the pencil has moved in the hand."""
    (a, b), lengths = (half[1] - half[0] for half in (before, after)), (0.5 * LENGTH) ** 2
    trial.turned_deg = math.degrees(math.acos(max(-1.0, min(1.0, float(a @ b) / lengths))))
    trial.moved_mm = 1e3 * float(np.linalg.norm(after[1] - before[1]))


def _ends(station: ArmStation, context: Context) -> np.ndarray:
    """The pencil's ends in the world, the lower one first, shape (2, 3), m."""
    X_WO = station.object_body.EvalPoseInWorld(station.plant.GetMyContextFromRoot(context))
    ends = np.array([X_WO.multiply(np.array([0.0, 0.0, z])) for z in (0.0, LENGTH)])
    return ends[np.argsort(ends[:, 2])]


def _at_rim(station: ArmStation, context: Context) -> np.ndarray:
    """Where the pencil's axis crosses the rim's plane, x and y, m."""
    low, high = _ends(station, context)
    share = (RIM - low[2]) / (high[2] - low[2])
    return low[:2] + share * (high - low)[:2]


def _judge(station: ArmStation, context: Context, phase: str, trial: Trial) -> tuple[bool, str]:
    """Whether the pencil stands in the box through the hole, and the right end was identified; and the outcome."""
    low, high = _ends(station, context)
    inside = low[2] < RIM - 0.03 < RIM < high[2] and np.abs(low[:2] - hole()).max() < 0.06
    if inside and np.linalg.norm(_at_rim(station, context) - hole()) < HOLE_RADIUS:
        named = trial.upside_down < 0.5
        return named, "in the hole" if named else "in the hole, with the wrong end named"
    if phase.startswith("failed"):
        return False, phase.removeprefix("failed: ")
    if phase in ("receive", "again", "feel", "approach", "lower", "lift", "move", "insert", "release"):
        return False, f"not finished: {phase}"
    if trial.hole_mm > 1e3 * HOLE_RADIUS:
        return False, f"pose wrong: {trial.hole_mm:.0f} mm beside the hole's axis at the rim"
    held = station.diagram.GetOutputPort("contacts").Eval(context)
    return False, "the pencil stuck to the fingers" if len(held) else "the pencil met the rim or left the hole again"


def explain(trial: Trial) -> str:
    """The task's and the simulator's account of a failure."""
    if math.isnan(trial.turned_deg):
        return f"{trial.outcome}; the pencil was not let go"
    touch = "the arm did not set off for the hole"
    if not math.isnan(trial.end_mm):
        touch = (
            f"touch was {trial.end_mm:.1f} mm off at the lower end when the arm set off for the hole "
            f"({trial.sigma_mm:.1f} stated)"
        )
    return (
        f"{trial.outcome}; {touch}; since the pencil was let go, it turned by {trial.turned_deg:.0f}° in the hand and "
        f"its lower end moved by {trial.moved_mm:.0f} mm"
    )
