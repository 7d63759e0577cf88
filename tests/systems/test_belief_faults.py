"""What the belief says while senses, vision, object and clock fail: through the systems, in a diagram.

Never may a pose be called an estimate that is none: `Run.assert_never_a_silent_guess` looks at every instant.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_spheres import HandSpheres
from tactopose_drake.core.evidence.prior import PosePrior
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.shape.objects import ObjectModel
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.hand import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems.pose_belief import PoseBeliefEstimator, PoseBeliefParams
from tactopose_drake.systems.pose_tracking import MakePoseTracking
from tactopose_drake.systems.tracker_input import TrackerInput
from tests import held_cube
from tests.core.tracking.boxes import make_box, touch

PERIOD = 0.01
X_PO = RigidTransform(RollPitchYaw(0.4, -0.2, 1.0), [0.02, -0.03, 0.1])
COVARIANCE = np.diag(np.repeat([math.radians(10.0) ** 2, 0.02**2], 3))
FINGERS = tuple("abcdef")
METRES_OFF = RigidTransform([2.0, 0.0, 0.0]) @ X_PO
ANYWHERE = HandSpheres(np.array([[1.0, 0.0, 0.0]]), np.array([0.01]))

Signal = Callable[[float], Any]


class Script(LeafSystem):
    """Gives values by the time."""

    def __init__(self, **signals: Signal) -> None:
        super().__init__()
        for name, signal in signals.items():
            self._declare(name, signal)

    def _declare(self, name: str, signal: Signal) -> None:
        first = signal(0.0)
        when = {self.time_ticket()}
        if isinstance(first, np.ndarray):

            def calc(context: Context, output: BasicVector) -> None:
                output.SetFromVector(signal(context.get_time()))

            self.DeclareVectorOutputPort(name, len(first), calc, when)
        else:

            def calc_value(context: Context, output: AbstractValue) -> None:
                output.set_value(signal(context.get_time()))

            model = AbstractValue.Make(first if isinstance(first, RigidTransform) else None)
            self.DeclareAbstractOutputPort(name, model.Clone, calc_value, when)


class Instant(NamedTuple):
    time: float
    belief: PoseBelief
    status: str
    pose: RigidTransform

    @property
    def word(self) -> str:
        return self.status.split(":")[0]


class Run:
    """A belief in a diagram with scripted inputs, and what it said at each of its periods."""

    def __init__(self, system: LeafSystem | Diagram, **signals: Signal) -> None:
        builder = DiagramBuilder()
        self.system = builder.AddNamedSystem("belief", system)
        script = builder.AddSystem(Script(**signals))
        for name in signals:
            builder.Connect(script.GetOutputPort(name), self.system.GetInputPort(name))
        self.simulator = Simulator(builder.Build())
        self.context = self.simulator.get_mutable_context()
        self.instants: list[Instant] = []

    def until(self, time: float) -> Instant:
        """Advances to where the belief is of that time, in the middle between two of its periods."""
        for k in range(round(self.context.get_time() / PERIOD - 0.5) + 1, round(time / PERIOD) + 1):
            self.simulator.AdvanceTo((k + 0.5) * PERIOD)
            belief, status, pose = (self.read(name) for name in ("belief", "status", "object_pose"))
            # A pose that is read is the system's own, which changes.
            self.instants.append(Instant(belief.time, belief, status, RigidTransform(pose)))
        return self.instants[-1]

    def set_back(self, time: float) -> None:
        """Lets an earlier time begin once more, with the state as it is."""
        self.context.SetTime(time)
        self.simulator.Initialize()
        self.simulator.AdvanceTo(time + 1e-6)

    def read(self, name: str) -> Any:
        return self.system.GetOutputPort(name).Eval(self.system.GetMyContextFromRoot(self.context))

    def words(self, start: float, end: float) -> set[str]:
        return {instant.word for instant in self.instants if start < instant.time <= end}

    def assert_never_a_silent_guess(self, truth: Callable[[float], RigidTransform], limit: float = 0.01) -> None:
        for time, belief, status, pose in self.instants:
            word = status.split(":")[0]
            if word in ("no_contact", "lost"):
                continue
            one_of_several = word == "ambiguous" or belief.probability[0] < 0.5
            assert word == "ambiguous" or not one_of_several or "several poses" in status, status
            modes = belief.X_PO if one_of_several else belief.X_PO[:1]
            off = [increments_between(X, truth(time).GetAsMatrix34()) for X in modes]
            assert min(float(np.linalg.norm(u[3:])) for u in off) < limit, (time, status)
            assert min(float(np.linalg.norm(u[:3])) for u in off) < math.radians(20.0), (time, status)
            assert pose.IsExactlyEqualTo(RigidTransform(belief.X_PO[0]))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


def generator_at(time: float) -> np.random.Generator:
    return np.random.default_rng(round(1e4 * time))


def touched(
    X: Callable[[float], RigidTransform], when: Callable[[float], bool] = lambda time: True
) -> dict[str, Signal]:
    """The box's contacts at a pose by the time, noise and all, and whose they are."""

    def contacts(time: float) -> Contacts:
        return touch(X(time).GetAsMatrix34(), generator_at(time)) if when(time) else Contacts.empty()

    return {"contacts": contacts, "fingers_in_contact": lambda time: FINGERS if when(time) else ()}


def still(time: float) -> RigidTransform:
    return X_PO


def seen(X: RigidTransform, time: float, noise: np.random.Generator | None = None) -> PoseMeasurement:
    """A pose of vision; with errors as its covariance says, or without."""
    u = np.zeros(6) if noise is None else 0.3 * noise.multivariate_normal(np.zeros(6), COVARIANCE)
    return PoseMeasurement(time, X @ RigidTransform(RollPitchYaw(*u[:3]), u[3:]), COVARIANCE)


def begun(vision: Signal, since: float = 0.1) -> Signal:
    """Vision that is good until a time, and then what is given."""
    first = seen(X_PO, 0.0, np.random.default_rng(1))
    return lambda time: first if time < since else vision(time)


# A fault of vision, and what the status says of it.
VISION_FAULTS: dict[str, tuple[Signal, str]] = {
    "metres off": (lambda time: seen(METRES_OFF, time, generator_at(time)), "vision is not believed"),
    "frozen": (lambda time: seen(X_PO, time), "vision is frozen"),
    "of long ago": (lambda time: seen(X_PO, time - 2.0, generator_at(time)), "vision is of 2.0 s ago"),
    "of the future": (lambda time: seen(X_PO, time + 2.0, generator_at(time)), "vision is of the future"),
}


@pytest.mark.parametrize("name", VISION_FAULTS)
def test_vision_that_fails_is_named_and_spoils_nothing(box: ObjectModel, name: str) -> None:
    fault, remark = VISION_FAULTS[name]
    run = Run(PoseBeliefEstimator(box), vision=begun(fault), **touched(still))
    run.until(0.1)
    last = run.until(0.6)
    assert last.word == "ok"
    assert remark in last.status
    run.assert_never_a_silent_guess(still)


def test_vision_whose_clock_stands_still_grows_old(box: ObjectModel) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        vision=lambda time: seen(X_PO, 0.0, generator_at(time)),
        **touched(still, lambda time: time < 0.105),
    )
    assert run.until(0.1).word == "ok"
    assert run.until(1.0).word == "no_contact"
    last = run.until(1.3)
    assert last.word == "lost"
    assert "vision is of 1.3 s ago" in last.status


def test_vision_metres_off_from_the_start_never_makes_an_estimate_of_touch(box: ObjectModel) -> None:
    """The box looks the same to touch after half turns: without vision it is one of four."""
    run = Run(
        PoseBeliefEstimator(box),
        vision=lambda time: seen(METRES_OFF, time, generator_at(time)),
        **touched(still, lambda time: time > 0.105),
    )
    assert run.until(0.1).word == "no_contact"
    assert run.until(0.6).word == "ambiguous"
    assert "vision is not believed: it is out of reach of the touch" in run.instants[-1].status
    run.assert_never_a_silent_guess(still)


def test_late_and_disordered_vision_agrees_with_touch(box: ObjectModel) -> None:
    def shuffled(time: float) -> PoseMeasurement:
        generator = generator_at(time)
        return seen(X_PO, max(0.0, time - generator.uniform(0.0, 0.4)), generator)

    run = Run(PoseBeliefEstimator(box), vision=shuffled, **touched(still))
    run.until(0.6)
    assert run.words(0.0, 0.6) == {"ok"}
    run.assert_never_a_silent_guess(still)


def test_a_tracker_that_gives_no_numbers_counts_as_no_vision(box: ObjectModel) -> None:
    def pose(time: float) -> RigidTransform:
        return X_PO if time < 0.052 else RigidTransform(X_PO.rotation(), np.full(3, np.nan))

    builder = DiagramBuilder()
    tracker = builder.AddSystem(TrackerInput())
    script = builder.AddSystem(
        Script(pose=pose, picture_time=lambda time: np.array([time]), covariance=lambda time: COVARIANCE.ravel())
    )
    for name in ("pose", "picture_time", "covariance"):
        builder.Connect(script.GetOutputPort(name), tracker.GetInputPort(name))
    belief = builder.AddSystem(PoseBeliefEstimator(box))
    builder.Connect(tracker.GetOutputPort("vision"), belief.GetInputPort("vision"))
    for name in ("contacts", "fingers_in_contact", "patches", "contact_status"):
        if belief.HasInputPort(name):
            builder.ExportInput(belief.GetInputPort(name), name)
    for name in ("belief", "status", "object_pose"):
        builder.ExportOutput(belief.GetOutputPort(name), name)
    builder.ExportOutput(tracker.GetOutputPort("status"), "tracker_status")
    run = Run(builder.Build(), **touched(still))
    assert run.until(0.04).word == "ok"
    assert run.read("tracker_status") == "ok"
    assert run.until(0.3).word == "ok"
    assert run.read("tracker_status") == "X_PO[0, 3]: is nan; allowed are finite numbers."
    run.assert_never_a_silent_guess(still)


@pytest.mark.parametrize("numbers", [np.zeros(36), np.arange(36.0), np.full(36, np.nan)])
def test_a_covariance_that_is_none_is_named(numbers: np.ndarray) -> None:
    system = TrackerInput()
    context = system.CreateDefaultContext()
    system.GetInputPort("pose").FixValue(context, AbstractValue.Make(X_PO))
    system.GetInputPort("picture_time").FixValue(context, [0.0])
    system.GetInputPort("covariance").FixValue(context, numbers)
    assert system.GetOutputPort("vision").Eval(context) is None
    assert system.GetOutputPort("status").Eval(context).startswith("covariance")
    system.GetInputPort("covariance").FixValue(context, COVARIANCE.ravel())
    assert system.GetOutputPort("status").Eval(context) == "ok"
    np.testing.assert_array_equal(system.GetOutputPort("vision").Eval(context).covariance, COVARIANCE)


def test_an_object_that_is_taken_away_is_said_to_be_gone(box: ObjectModel) -> None:
    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), **touched(still, lambda time: time < 0.205))
    assert run.until(0.2).word == "ok"
    spread = [np.trace(run.until(time).belief.covariance[0]) for time in (0.22, 0.5, 1.1)]
    assert spread == sorted(spread)
    assert run.words(0.21, 1.1) == {"no_contact"}
    assert run.until(1.5).status.startswith("lost: nothing was touched or seen for 1.")
    assert run.words(1.3, 1.5) == {"lost"}
    assert run.read("hypotheses").status == "no_solution"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("with_vision", [False, True])
def test_an_object_that_comes_back_elsewhere_is_found_anew(box: ObjectModel, seed: int, with_vision: bool) -> None:
    """Turned by a right angle or two: the pose from before says nothing, and is not what tells half turns apart."""
    generator = np.random.default_rng(seed)
    turn = RollPitchYaw(*generator.uniform(-math.pi, math.pi, 3))
    elsewhere = X_PO @ RigidTransform(turn, generator.uniform(-0.05, 0.05, 3))

    def truth(time: float) -> RigidTransform:
        return X_PO if time < 1.0 else elsewhere

    def vision(time: float) -> PoseMeasurement | None:
        return seen(elsewhere, time, generator_at(time)) if with_vision and time > 1.5 else None

    run = Run(PoseBeliefEstimator(box), vision=begun(vision), **touched(truth, lambda time: not 0.205 < time < 1.505))
    assert run.until(0.2).word == "ok"
    assert run.until(1.5).word == "lost"
    assert run.until(2.0).word == ("ok" if with_vision else "ambiguous")
    run.assert_never_a_silent_guess(truth)


def test_a_touch_that_never_changes_is_remarked(box: ObjectModel) -> None:
    frozen = touch(X_PO.GetAsMatrix34(), np.random.default_rng(0))
    run = Run(
        PoseBeliefEstimator(box),
        contacts=lambda time: frozen,
        fingers_in_contact=lambda time: FINGERS,
        vision=begun(lambda time: None),
    )
    assert run.until(0.4).status == "ok"
    assert "the touch has been the same for 0.8 s" in run.until(0.85).status
    assert np.trace(run.instants[-1].belief.covariance[0]) > np.trace(run.instants[5].belief.covariance[0])


def test_a_clock_that_stands_still_or_goes_back_ends_nothing(box: ObjectModel) -> None:
    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), **touched(still))
    assert run.until(0.3).status == "ok"
    run.set_back(0.3)
    assert run.read("belief").time == 0.3
    assert run.read("status") == "ok"
    run.set_back(0.0)
    assert run.read("belief").time == 0.0
    assert run.read("status").endswith("begun anew: the clock went back from 0.3 s")
    run.instants.clear()
    assert run.until(0.2).status == "ok"
    run.assert_never_a_silent_guess(still)


@pytest.mark.parametrize("latency", [0.0, 0.025])
def test_what_was_shown_before_the_clock_went_back_is_not_shown_after(box: ObjectModel, latency: float) -> None:
    system = PoseBeliefEstimator(box, PoseBeliefParams(latency=latency))
    run = Run(system, vision=begun(lambda time: None), **touched(still))
    run.until(0.3)
    run.set_back(0.0)
    for _ in range(5):
        assert run.read("belief").time <= run.context.get_time()
        run.simulator.AdvanceTo(run.context.get_time() + PERIOD)


def test_a_palm_that_is_not_known_leaves_the_pose_in_the_palm(box: ObjectModel) -> None:
    def palm(time: float) -> RigidTransform:
        return RigidTransform([0.5, 0.0, 0.3]) if time < 0.1 or time > 0.3 else RigidTransform(np.full(3, np.nan))

    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), palm_pose=palm, **touched(still))
    assert run.until(0.05).status == "ok"
    last = run.until(0.2)
    assert last.status == "ok: the palm's pose is not finite"
    assert not np.any(np.isfinite(run.read("object_pose_in_world").translation()))
    assert run.until(0.35).status == "ok"
    in_world = run.read("object_pose_in_world")
    assert in_world.IsNearlyEqualTo(RigidTransform([0.5, 0.0, 0.3]) @ run.read("object_pose"), 1e-12)
    run.assert_never_a_silent_guess(still)


def test_velocities_that_are_not_known_are_named(box: ObjectModel) -> None:
    def tips(time: float) -> dict[str, np.ndarray] | None:
        bad = None if time > 0.2 else {finger: np.full(6, np.nan) for finger in FINGERS}
        return bad if time > 0.1 else dict.fromkeys(FINGERS, np.zeros(6))

    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), tip_velocities=tips, **touched(still))
    assert run.until(0.1).status == "ok"
    for time in (0.15, 0.3):
        assert run.until(time).status == "ok: the fingertips' velocities are not known"
    run.assert_never_a_silent_guess(still)


@pytest.mark.parametrize("silent", [True, False])
def test_an_untouched_object_rests_in_the_world_but_not_when_no_sensor_says_so(box: ObjectModel, silent: bool) -> None:
    def palm(time: float) -> RigidTransform:
        return RigidTransform([0.0, 0.0, max(0.0, time - 0.1)])

    run = Run(
        PoseBeliefEstimator(box),
        vision=begun(lambda time: None),
        palm_pose=palm,
        untouched=lambda time: None if silent or time < 0.1 else ANYWHERE,
        **touched(still, lambda time: time < 0.1),
    )
    held = run.until(0.1).pose.translation()
    moved = run.until(0.2).pose.translation() - held
    np.testing.assert_allclose(moved, [0.0, 0.0, 0.0 if silent else -0.09], atol=0.011)
    assert run.instants[-1].word == "no_contact"


class HeldCube:
    """The belief from wrenches and joints of a hand that holds the cube; some fingers fail for a time."""

    def __init__(self, cube: ObjectModel, failing: tuple[str, ...], value: float = np.nan) -> None:
        names = tuple(held_cube.WRENCHES)
        signals: dict[str, Signal] = {}
        for i, finger in enumerate(names):
            signals[f"wrench_{finger}"] = self._wrench(finger, i, finger in failing, value)
        joints = np.full(24, value) if "joints" in failing else held_cube.Q
        signals["joint_positions"] = lambda time: joints.copy() if self.fails(time) else held_cube.Q.copy()
        signals["joint_velocities"] = lambda time: np.zeros(24)
        signals["vision"] = lambda time: held_cube.prior()
        self.run = Run(MakePoseTracking(load_hand_config("shadow_like"), cube), **signals)

    @staticmethod
    def fails(time: float) -> bool:
        return 0.205 < time < 1.505

    def _wrench(self, finger: str, seed: int, failing: bool, value: float) -> Signal:
        def signal(time: float) -> np.ndarray:
            noise = np.random.default_rng([seed, round(1e4 * time)]).normal(size=6) * np.repeat([2e-5, 4e-3], 3)
            fails = failing and self.fails(time)
            return np.full(6, value) if fails else held_cube.WRENCHES[finger] + noise

        return signal

    def off(self) -> float:
        """How far the cube's middle is from where it is held, m: what its symmetries leave."""
        middle = np.array([0.0, 0.0, 0.03])
        return float(np.linalg.norm(self.run.instants[-1].pose @ middle - RigidTransform(held_cube.X_PO) @ middle))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_sensor_that_drops_out_is_named_and_the_others_go_on(cube: ObjectModel, value: float) -> None:
    held = HeldCube(cube, ("thumb",), value)
    assert held.run.until(0.2).word in ("ok", "ambiguous")
    last = held.run.until(0.5)
    assert last.word in ("ok", "ambiguous", "slipping")
    assert "thumb: the wrench is not finite" in last.status
    assert last.belief.touch_time == last.belief.time
    assert held.off() < 0.006
    held.run.until(1.7)
    assert "thumb" not in held.run.instants[-1].status
    assert held.off() < 0.006


@pytest.mark.parametrize(
    ("failing", "why"),
    [(tuple(held_cube.WRENCHES), "the wrench is not finite"), (("joints",), "a joint position is not finite")],
)
def test_when_all_drop_out_the_pose_is_predicted_only_and_then_lost(
    cube: ObjectModel, failing: tuple[str, ...], why: str
) -> None:
    held = HeldCube(cube, failing)
    assert held.run.until(0.2).word in ("ok", "ambiguous")
    last = held.run.until(0.5)
    assert last.status == "no_contact: " + "; ".join(
        ["the fingertips' velocities are not known"] * ("joints" in failing)
        + [f"{finger.name}: {why}" for finger in load_hand_config("shadow_like").fingers]
    )
    assert held.run.read("hypotheses").status == "no_solution"
    assert held.run.until(1.45).word == "lost"
    assert held.run.until(1.9).word in ("ok", "ambiguous")
    assert held.off() < 0.006


def test_no_storm_of_faults_ends_the_loop(box: ObjectModel) -> None:
    """Every kind of fault by chance, again and again: no exception, and nothing that is not a number."""

    def chance(time: float, kind: int) -> float:
        return float(np.random.default_rng([kind, round(1e4 * time)]).random())

    def contacts(time: float) -> Contacts:
        whole, generator = touch(X_PO.GetAsMatrix34(), generator_at(time)), generator_at(time)
        i = np.flatnonzero(generator.random(6) < generator.random())
        shift = np.zeros(3) if chance(time, 0) < 0.7 else generator.normal(size=3)
        return Contacts(whole.p_PC[i] + shift, whole.n_PC[i] if chance(time, 1) < 0.8 else None)

    def fingers(time: float) -> tuple[str, ...]:
        return FINGERS[: len(contacts(time))]

    def vision(time: float) -> PoseMeasurement | PosePrior | None:
        generator, choice = generator_at(time), int(8 * chance(time, 2))
        scale = 10.0 ** generator.uniform(-9.0, 9.0)
        good = seen(X_PO, time, generator)
        return (
            None,
            good,
            PosePrior(X_PO, 0.02, 0.2),
            seen(X_PO, time - 0.3, generator),
            seen(X_PO, time + 5.0),
            seen(METRES_OFF, time, generator),
            PoseMeasurement(time, good.X_PO, scale * COVARIANCE),
            seen(X_PO, -50.0),
        )[choice]

    def tips(time: float) -> dict[str, np.ndarray] | None:
        scale = 10.0 ** (6.0 * chance(time, 3) - 5.0)
        speeds = {finger: scale * generator_at(time).normal(size=6) for finger in FINGERS[1:]}
        return None if chance(time, 4) < 0.1 else speeds

    def palm(time: float) -> RigidTransform:
        return RigidTransform(np.full(3, np.nan if chance(time, 5) < 0.2 else 10.0 * chance(time, 6)))

    run = Run(
        PoseBeliefEstimator(box),
        contacts=contacts, fingers_in_contact=fingers, vision=vision, tip_velocities=tips, palm_pose=palm,
        untouched=lambda time: ANYWHERE if chance(time, 7) < 0.5 else None,
    )  # fmt: skip
    run.until(0.8)
    assert len(run.words(0.0, 0.8)) >= 3, "the storm reaches most statuses"
    for instant in run.instants:
        belief = instant.belief
        assert np.all(np.isfinite(belief.X_PO))
        assert np.all(np.isfinite(belief.covariance))
        assert not len(belief.covariance) or np.linalg.eigvalsh(belief.covariance).min() > 0.0
        assert belief.probability.sum() == pytest.approx(1.0 if belief.has_pose else 0.0)
