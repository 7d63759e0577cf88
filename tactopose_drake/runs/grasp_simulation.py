"""Simulates a scenario's grasp until the hand holds the object, or tells why it does not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.times import has_passed
from tactopose_drake.runs.contact_truth import ContactTruth
from tactopose_drake.runs.grasp_watch import GraspWatch
from tactopose_drake.runs.stepping import Observer, RunView
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.simulated import Station, make_station


@dataclass(frozen=True, eq=False)
class GraspResult:
    """The result of a simulated grasp.

    Attributes:
        stable: whether the object is at rest in the hand, carried by enough fingertips and pads.
        reason: "ok", or why it is not stable.
        station: the station.
        simulator: the simulator at the end of the run; its context holds all ports' values.
        truth: the true contacts at the end.
        X_PO: true pose of the object at the end.
        release_time: when the object was released, s; None if never.
        slip: motion of the object's origin in the palm after its release, m; rotation about it is not included.
        turn: angle by which the object has turned in the palm after its release, rad.
        speed: speed of the object's origin in the palm at the end, m/s.
        failed_attempts: why each grasp that was tried before this one failed.
    """

    stable: bool
    reason: str
    station: Station
    simulator: Simulator
    truth: ContactTruth
    X_PO: RigidTransform
    release_time: float | None
    slip: float
    turn: float
    speed: float
    failed_attempts: tuple[str, ...]

    @property
    def context(self) -> Context:
        """The root context at the end of the run."""
        return self.simulator.get_context()


def simulate_grasp(
    scenario: Scenario,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
    on_progress: Callable[[str], None] | None = None,
    observer: Observer = lambda view: None,
) -> GraspResult:
    """Simulates a scenario's grip; or plans its grasps and simulates them, best first, until one is stable.

    Args:
        scenario: the scenario.
        model: the object's model; None: it is loaded.
        meshcat: shows and records the simulation; None: nothing is shown.
        on_progress: called with the name of each step that starts.
        observer: called with each attempt, after each time step.

    Returns:
        The first stable grasp, or the last one tried; a grip is tried once.

    Raises:
        InvalidInputError: if the scenario cannot be built, or no grasp is found.
    """
    tell = on_progress or (lambda message: None)
    model = scenario.object_model() if model is None else model
    plans: Sequence[GraspPlan | None] = (None,)
    if scenario.grip is None:
        tell("planning a grasp")
        plans = plan_scenario(scenario, model)[: scenario.check.attempts]
    failed: list[str] = []
    for plan in plans:
        tell("simulating a grip" if plan is None else f"simulating a grasp by {len(plan.fingers)} fingers")
        if meshcat is not None:
            meshcat.Delete()
            meshcat.DeleteRecording()
        result = run_grasp(make_station(scenario, plan, model=model, meshcat=meshcat), tuple(failed), meshcat, observer)
        if result.stable:
            break
        failed.append(result.reason)
    return result


def run_grasp(
    station: Station,
    failed_attempts: tuple[str, ...] = (),
    meshcat: Meshcat | None = None,
    observer: Observer = lambda view: None,
) -> GraspResult:
    """Simulates one grasp from the open hand to the end of the hold, and evaluates it.

    Args:
        station: the station, not simulated yet.
        failed_attempts: passed on to the result.
        meshcat: the station's display, if it is to record.
        observer: called with the run after each time step.
    """
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    simulator.Initialize()
    if meshcat is not None:
        meshcat.StartRecording()
    display = None if meshcat is None else station.diagram.GetSubsystemByName("pose_display")
    watch, view, step = GraspWatch(station), RunView(station.diagram, context), 0.02
    while not has_passed(context.get_time(), 0.0, station.scenario.duration) and not watch.is_over(context):
        simulator.AdvanceTo(context.get_time() + step)
        watch.see(context)
        observer(view)
        if display is not None:
            # The last estimate may be newer than the displayed one.
            display.ForcedPublish(display.GetMyContextFromRoot(context))
    if meshcat is not None:
        meshcat.StopRecording()
        meshcat.PublishRecording()
    truth, reason = watch.judge(context)
    return GraspResult(
        reason == "ok",
        reason,
        station,
        simulator,
        truth,
        station.object_pose(context),
        watch.release_time,
        watch.slip(context),
        watch.turn(context),
        watch.motion(context)[0],
        failed_attempts,
    )
