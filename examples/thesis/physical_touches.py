"""Ambiguous grasps by three fingers in the simulator, and exploration by the two other fingers.

Everything is simulated: the closing hand, the object that the fingers hold, the motion of the exploring finger, its
contact, and the motion of the object that it causes. The pose is estimated from the simulated wrenches and joints, and
from one view of a camera that the hand mostly occludes. The diagram itself chooses the touches (`AddTouchExploration`),
and stops when 95 % of the belief is within 10 mm and 15 degrees of one pose.
"""

import dataclasses
import time

import numpy as np
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.exploration import Tolerance, merged_modes, nearest_twins, resolved_share
from tactopose_drake.station import Scenario, Station
from tactopose_drake.systems import TouchExplorationParams

# Neighbouring fingers, so that each of the others has room to one side.
HOLDING = (("thumb", "first", "middle"), ("thumb", "middle", "ring"), ("thumb", "ring", "little"))
AMBIGUOUS, UNIQUE = 0.8, 0.95
MOST_TOUCHES = 12
LONGEST_GRASP, LONGEST = 3.5, 45.0  # maximum times until the hand holds, and until the exploration ends, s
SLIPPED = 0.004  # m in the palm since the exploration began, beyond which the object counts as having slipped
RESTING = 0.002  # maximum velocity in the palm, m/s, at which the object counts as at rest when the exploration begins
TOLERANCE = Tolerance()


OUTCOMES = ("no grasp", "not ambiguous", "unique", "not unique", "the object slipped")


@dataclasses.dataclass(frozen=True)
class PhysicalExploration:
    """The result of one exploration in the simulator, as numbers for a journal.

    Attributes:
        outcome: index in `OUTCOMES`.
        touches: number of motions.
        right: 1 if the final pose is the true one, else 0.
        share_before: share of the belief about one pose before the first touch.
        share_after: the same at the end.
        moved: how far the object has moved in the palm meanwhile, m.
        simulated: simulated time, s.
        processor: CPU time, s.
    """

    outcome: float
    touches: float = 0
    right: float = 0
    share_before: float = 0.0
    share_after: float = 0.0
    moved: float = 0.0
    simulated: float = 0.0
    processor: float = 0.0


def scenario_of(name: str, seed: int, rule: str) -> Scenario:
    """The scenario of a hand without errors that explores."""
    scenario = Scenario(object=name, seed=seed, duration=LONGEST).without_errors()
    scenario.planner.least_fingers = 3
    scenario.planner.fingers = list(HOLDING[np.random.default_rng((seed, 11)).integers(len(HOLDING))])
    scenario.planner.grasps = 2
    scenario.vision.period = LONGEST + 1.0  # one view, of the open hand
    scenario.estimation.contacts.sigma_position, scenario.estimation.contacts.sigma_normal_deg = 0.0006, 4.0
    scenario.estimation.estimator.period = LONGEST  # the exploration has an estimate of its own
    scenario.exploration = TouchExplorationParams()
    scenario.exploration.chooser.rule = rule
    scenario.exploration.chooser.seed = seed
    scenario.exploration.explorer.most_touches = MOST_TOUCHES
    return scenario


def explore_in_physics(station: Station) -> PhysicalExploration:
    """Closes the hand, and explores until one pose is left, or the time or the touches are used up."""
    started = time.process_time()
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    port, speed = station.diagram.GetOutputPort, np.inf
    while context.get_time() < LONGEST_GRASP and port("explored_phase").Eval(context) in ("wait", "settle"):
        p_before = station.object_pose(context).translation()
        simulator.AdvanceTo(context.get_time() + 0.05)
        speed = float(np.linalg.norm(station.object_pose(context).translation() - p_before)) / 0.05
    estimate = port("explored_hypotheses").Eval(context)
    if (
        speed > RESTING
        or port("explored_phase").Eval(context) in ("wait", "settle")
        or estimate is None
        or estimate.status == "no_solution"
    ):
        return PhysicalExploration(OUTCOMES.index("no grasp"))
    first = resolved_share(station.model, estimate.modes, TOLERANCE)
    p_begin = station.object_pose(context).translation()
    if first >= AMBIGUOUS:
        return PhysicalExploration(OUTCOMES.index("not ambiguous"), share_before=first, share_after=first)
    moved, status = 0.0, "chosen"
    while context.get_time() < LONGEST and status != "resolved" and moved < SLIPPED:
        simulator.AdvanceTo(context.get_time() + 0.05)
        status = port("explored_touch_status").Eval(context)
        moved = float(np.linalg.norm(station.object_pose(context).translation() - p_begin))
        if port("explored_phase").Eval(context) == "done":
            break
    belief = port("explored_hypotheses").Eval(context).modes
    best = merged_modes(station.model, belief, TOLERANCE).X_PO[:1]
    truth = station.object_pose(context).GetAsMatrix34()
    outcome = "unique" if status == "resolved" else "the object slipped" if moved >= SLIPPED else "not unique"
    return PhysicalExploration(
        OUTCOMES.index(outcome),
        float(port("explored_count").Eval(context)[0]),
        float(nearest_twins(station.model, best, truth, TOLERANCE).same[0]),
        first,
        float(port("explored_resolved").Eval(context)[0]),
        moved,
        context.get_time(),
        time.process_time() - started,
    )
