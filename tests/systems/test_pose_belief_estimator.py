import gc
import math
import re
import threading
import time

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.live_pose_belief_estimator import LivePoseBeliefEstimator
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator, PoseBeliefParams
from tests.core.tracking.boxes import make_box, touch

X_PO = RigidTransform(RollPitchYaw(0.4, -0.2, 1.0), [0.02, -0.03, 0.1])
SEEN = PosePrior(X_PO @ RigidTransform(RollPitchYaw(0.1, 0.05, -0.1), [0.01, -0.008, 0.006]), 0.02, math.radians(10))
FINGERS = tuple("abcdef")


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


class Bench:
    """A system with fixed inputs, which measures anew before each step of 10 ms."""

    def __init__(self, system: PoseBeliefEstimator) -> None:
        self.system, self.generator = system, np.random.default_rng(0)
        system.set_name("belief")
        self.simulator = Simulator(system)
        self.context: Context = self.simulator.get_mutable_context()
        self.fix(fingers_in_contact=FINGERS)

    def fix(self, **inputs: object) -> None:
        for name, value in inputs.items():
            self.system.GetInputPort(name).FixValue(self.context, AbstractValue.Make(value))

    def feel(self, count: int = 1) -> str:
        for _ in range(count):
            self.fix(contacts=touch(X_PO.GetAsMatrix34(), self.generator))
            self.simulator.AdvanceTo(self.context.get_time() + 0.01)
        return str(self.read("status"))

    def read(self, name: str) -> object:
        return self.system.GetOutputPort(name).Eval(self.context)


def keep_pace(bench: Bench, count: int) -> str:
    """Feels so often, at no higher pace than the thread finishes its beliefs at."""
    for _ in range(count):
        bench.feel()
        begun, exchange = bench.context.get_time() - 0.0101, bench.system._own.Eval(bench.context).exchange
        while exchange.finished.belief.time < begun and exchange.thread.is_alive():
            time.sleep(1e-3)
    return str(bench.read("status"))


def error(pose: RigidTransform) -> tuple[float, float]:
    X = X_PO.inverse() @ pose
    return float(np.linalg.norm(X.translation())), X.rotation().ToAngleAxis().angle()


def test_touch_and_vision_give_the_pose_on_every_port(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    X_WP = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.5, 0.0, 0.3])
    bench.fix(vision=SEEN, palm_pose=X_WP)
    assert bench.feel(10) == "ok"
    pose, estimate = bench.read("object_pose"), bench.read("hypotheses")
    assert error(pose)[0] < 0.003
    assert error(pose)[1] < math.radians(4.0)
    assert pose.IsExactlyEqualTo(estimate.best.X_PO)
    assert estimate.status == "ok"
    assert bench.read("object_pose_in_world").IsNearlyEqualTo(X_WP @ pose, 1e-12)
    covariance = bench.read("covariance").reshape(6, 6)
    np.testing.assert_array_equal(covariance, estimate.best.covariance)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


@pytest.mark.parametrize(("away", "is_in_reach"), [(0.6, True), (0.9, False)])
def test_what_is_in_reach_does_not_hang_on_where_the_object_has_its_origin(
    box: ObjectModel, away: float, is_in_reach: bool
) -> None:
    """A guess that is so far off counts, or is given up, whether or not its turns move the origin by decimetres."""
    counts = []
    for offset in (np.zeros(3), np.array([0.4, 0.1, -0.3])):
        mesh = trimesh.Trimesh(box.vertices + offset, box.faces, process=False)
        bench = Bench(PoseBeliefEstimator(ObjectModel.from_mesh(mesh, cache=False, symmetry="none")))
        guess = RigidTransform([away, 0.0, 0.0]) @ SEEN.X_PO @ RigidTransform(-offset)
        prior = PosePrior(guess, 0.02, math.radians(10))
        bench.fix(contacts=Contacts.empty(), fingers_in_contact=(), vision=prior)
        bench.simulator.AdvanceTo(0.05)
        bench.fix(fingers_in_contact=FINGERS, vision=None)
        bench.feel(3)
        counts.append(bench.read("belief").standing is not None)
    assert counts == [is_in_reach, is_in_reach]


def test_what_is_free_does_not_hang_on_where_the_object_has_its_origin(box: ObjectModel) -> None:
    offset = np.array([2.0, -0.5, 1.0])
    mesh = trimesh.Trimesh(box.vertices + offset, box.faces, process=False)
    bench = Bench(PoseBeliefEstimator(ObjectModel.from_mesh(mesh, cache=False, symmetry="none")))
    bench.fix(prior=PosePrior(SEEN.X_PO @ RigidTransform(-offset), 0.02, math.radians(10)))
    bench.feel(3)
    best = bench.read("hypotheses").best
    # Two metres away, turns by a few degrees move the origin by more than a tenth of the object's size.
    assert np.sqrt(np.trace(best.covariance[3:, 3:])) > 0.03
    assert best.free_directions.shape == (0, 6)


def test_a_table_says_how_far_the_object_has_slid_in_the_hand(box: ObjectModel) -> None:
    slid = X_PO @ RigidTransform([0.0, 0.0, 0.015])
    table = PlaneContact(X_PO.multiply([0.0, 0.0, -0.07]), X_PO.rotation().multiply([0.0, 0.0, 1.0]))
    along, spread = {}, {}
    for planes in ((), (table,)):
        bench = Bench(PoseBeliefEstimator(box))
        bench.fix(prior=PosePrior(slid, 0.02, 0.15), planes=planes, fingers_in_contact=FINGERS[:4])
        for _ in range(10):
            felt = touch(X_PO.GetAsMatrix34(), bench.generator)
            bench.fix(contacts=felt[:4])
            bench.simulator.AdvanceTo(bench.context.get_time() + 0.01)
        along[planes] = abs((X_PO.inverse() @ bench.read("object_pose")).translation()[2])
        z_P = X_PO.rotation().matrix()[:, 2]
        spread[planes] = math.sqrt(z_P @ bench.read("covariance").reshape(6, 6)[3:, 3:] @ z_P)
    assert along[()] > 0.01
    assert along[table,] < 0.004
    assert spread[table,] < 0.5 * spread[()]


def test_before_anything_is_known_it_says_so(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(contacts=Contacts.empty(), fingers_in_contact=())
    bench.simulator.AdvanceTo(0.05)
    assert bench.read("status") == "lost: nothing is touched"
    assert bench.read("hypotheses") is None
    assert np.all(np.isinf(np.diag(bench.read("covariance").reshape(6, 6))))


def test_the_outputs_appear_after_the_latency(box: ObjectModel) -> None:
    for latency in (0.004, 0.013, 0.02):
        bench = Bench(PoseBeliefEstimator(box, PoseBeliefParams(latency=latency)))
        bench.fix(vision=SEEN, contacts=touch(X_PO.GetAsMatrix34(), bench.generator))
        first = None
        for step in range(1, 50):
            bench.simulator.AdvanceTo(0.001 * step)
            if first is None and bench.read("hypotheses") is not None:
                first = 0.001 * step
        assert first == pytest.approx(latency, abs=0.0015)


def test_no_belief_is_late_by_another_period_where_the_clock_stops_at_its_time(box: ObjectModel) -> None:
    """Drake skips an event at 0.07 s + 0.008 s if the clock has stopped at 0.078 s, which differs by rounding."""
    bench = Bench(PoseBeliefEstimator(box, PoseBeliefParams(latency=0.008)))
    bench.fix(vision=SEEN, contacts=Contacts.empty(), fingers_in_contact=())
    for step in range(1, 121):
        bench.simulator.AdvanceTo(0.001 * step)
        if step >= 20 and step % 10 == 9:  # 1 ms after the belief of 9 ms ago is due
            assert bench.read("belief").time == pytest.approx(0.001 * (step - 9))


def test_a_late_belief_is_the_same_one(box: ObjectModel) -> None:
    beliefs = []
    for latency, duration in ((0.0, 0.1), (0.025, 0.12)):
        bench = Bench(PoseBeliefEstimator(box, PoseBeliefParams(latency=latency)))
        bench.fix(vision=SEEN)
        while bench.context.get_time() < duration - 1e-9:
            bench.feel()
        beliefs.append(bench.read("belief"))
    assert beliefs[0].time == pytest.approx(0.09, abs=1e-9)
    assert beliefs[1].time == beliefs[0].time
    np.testing.assert_array_equal(beliefs[1].X_PO, beliefs[0].X_PO)


def test_it_is_deterministic(box: ObjectModel) -> None:
    poses = []
    for _ in range(2):
        bench = Bench(PoseBeliefEstimator(box))
        bench.feel(8)
        poses.append(bench.read("object_pose"))
    assert poses[0].IsExactlyEqualTo(poses[1])


def test_sensors_that_drop_out_and_vision_that_fails_change_the_status_alone(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(vision=SEEN)
    bench.feel(12)
    far = PoseMeasurement.from_prior(PosePrior(RigidTransform([3.0, 0.0, 0.0])), bench.context.get_time())
    bench.fix(vision=far)
    assert bench.feel(5) == "ok: vision is not believed: it is out of reach of the touch"
    beside = retract(X_PO.GetAsMatrix34(), np.array([0, 0, 0, 0.06, 0, 0]))
    bench.fix(vision=PoseMeasurement(bench.context.get_time(), beside, 1e-6 * np.eye(6)))
    assert bench.feel(5) == "ok: vision is not believed"
    bench.fix(vision=PoseMeasurement(bench.context.get_time(), far.X_PO, far.covariance))
    assert bench.feel(5) == "ok: vision is not believed: it is out of reach of the touch"
    bench.fix(contacts=Contacts.empty(), fingers_in_contact=())
    bench.simulator.AdvanceTo(bench.context.get_time() + 0.05)
    assert str(bench.read("status")).startswith("no_contact")
    bench.simulator.AdvanceTo(bench.context.get_time() + 1.2)
    assert str(bench.read("status")).startswith("lost")
    assert bench.read("hypotheses").status == "no_solution"


def test_a_prior_without_a_time_counts_once_and_again_when_it_changes(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(contacts=Contacts.empty(), fingers_in_contact=(), vision=SEEN)
    bench.simulator.AdvanceTo(0.05)
    once = bench.read("belief").covariance[0]
    bench.simulator.AdvanceTo(1.5)
    # It does not age while nothing was felt, nor does it grow surer.
    np.testing.assert_array_equal(bench.read("belief").covariance[0], once)
    assert bench.read("status") == "no_contact"
    other = PosePrior(SEEN.X_PO @ RigidTransform([0.0, 0.02, 0.0]), SEEN.sigma_translation, SEEN.sigma_rotation)
    bench.fix(vision=other)
    bench.simulator.AdvanceTo(1.6)
    moved = bench.read("object_pose").translation() - SEEN.X_PO.translation()
    assert 0.005 < np.linalg.norm(moved) < 0.021
    assert bench.read("status") == "no_contact"


def test_a_prior_counts_again_when_it_is_surer_and_not_when_it_is_less_so(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(contacts=Contacts.empty(), fingers_in_contact=(), vision=SEEN)
    bench.simulator.AdvanceTo(1.0)
    for translation, rotation in ((0.002, 0.01), (0.02, 0.1)):
        bench.fix(vision=PosePrior(SEEN.X_PO, translation, rotation))
        bench.simulator.AdvanceTo(bench.context.get_time() + 0.1)
        assert bench.read("status") == "no_contact"
        sigma = np.sqrt(np.diag(bench.read("belief").covariance[0]))
        np.testing.assert_allclose(sigma, np.repeat([0.01, 0.002], 3), rtol=0.02)


def test_a_missing_or_wrong_input_is_named(box: ObjectModel) -> None:
    system = PoseBeliefEstimator(box)
    system.set_name("belief")
    with pytest.raises(PortTypeError, match="'contacts' of system 'belief'"):
        Simulator(system).AdvanceTo(0.01)
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(vision=("a picture",))
    with pytest.raises(
        PortTypeError, match="'vision' of system 'belief' must hold a PoseMeasurement, a PosePrior or None, not a tuple"
    ):
        bench.feel()
    with pytest.raises(PortTypeError, match="palm_pose"):
        bench.read("object_pose_in_world")
    with pytest.raises(InvalidInputError, match="period"):
        PoseBeliefEstimator(box, PoseBeliefParams(period=0.0))
    with pytest.raises(InvalidInputError, match=r"PoseBeliefParams\.period must be a number from 0 to 1 s, not 10"):
        PoseBeliefEstimator(box, PoseBeliefParams(period=10.0))


@pytest.mark.parametrize("fingers", [(), FINGERS[:5], ("a", "a", "b", "c", "d", "e"), (1, 2, 3, 4, 5, 6)])
def test_names_that_do_not_fit_the_contacts_are_refused(box: ObjectModel, fingers: tuple[object, ...]) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(fingers_in_contact=fingers)
    named = rf"input port 'fingers_in_contact' of system 'belief' must hold as many .*, not {re.escape(repr(fingers))}"
    with pytest.raises(PortTypeError, match=named):
        bench.feel()


def test_names_that_do_not_fit_the_patches_are_refused(box: ObjectModel) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(pads=("palm",))
    with pytest.raises(PortTypeError, match=r"'pads' of system 'belief' must hold .*as there are patches, 0, not"):
        bench.feel()


@pytest.mark.parametrize(
    ("velocity", "message"),
    [(None, "consist of numbers, not None"), (np.zeros(3), r"have the shape \(6,\), not \(3,\)")],
)
def test_a_velocity_that_is_not_six_numbers_is_named(box: ObjectModel, velocity: object, message: str) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.fix(tip_velocities={FINGERS[0]: velocity})
    named = rf"^velocity of '{FINGERS[0]}' in input port 'tip_velocities' of system 'belief' must {message}"
    with pytest.raises(InvalidInputError, match=named):
        bench.feel()


def test_arithmetic_that_fails_begins_anew_and_says_so(box: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(PoseBeliefEstimator(box))
    bench.feel(3)

    def fail(*arguments: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    with monkeypatch.context() as patch:
        patch.setattr(PoseTracker, "step", fail)
        assert bench.feel() == "lost: begun anew: Singular matrix"
    bench.feel(5)
    assert error(bench.read("object_pose"))[0] < 0.005


def test_live_it_finds_the_same_pose_beside_the_loop(box: ObjectModel) -> None:
    with LivePoseBeliefEstimator(box) as system:
        bench = Bench(system)
        bench.fix(vision=SEEN)
        assert keep_pace(bench, 20) == "ok"
        assert error(bench.read("object_pose"))[0] < 0.003
        thread = system._own.Eval(bench.context).exchange.thread
    assert not thread.is_alive()


def test_live_contexts_of_one_system_have_their_own_beliefs(box: ObjectModel) -> None:
    with LivePoseBeliefEstimator(box) as system:
        seeing, blind = Bench(system), Bench(system)
        seeing.fix(vision=SEEN)
        blind.fix(contacts=Contacts.empty(), fingers_in_contact=())
        for _ in range(20):
            keep_pace(seeing, 1)
            blind.simulator.AdvanceTo(blind.context.get_time() + 0.01)
        assert seeing.read("status") == "ok"
        assert error(seeing.read("object_pose"))[0] < 0.003
        assert not blind.read("belief").has_pose
        # A clone goes on from the belief of that time, with a thread of its own.
        clone = Bench(system)
        clone.simulator.reset_context(seeing.context.Clone())
        clone.context = clone.simulator.get_mutable_context()
        clone.fix(vision=None)
        assert keep_pace(clone, 2) == "ok"
        threads = [system._own.Eval(bench.context).exchange.thread for bench in (seeing, blind, clone)]
        assert len(set(threads)) == 3
    assert not any(thread.is_alive() for thread in threads)


def test_live_a_context_that_is_freed_takes_its_thread_with_it(box: ObjectModel) -> None:
    with LivePoseBeliefEstimator(box) as system:
        bench = Bench(system)
        bench.feel()
        thread = system._own.Eval(bench.context).exchange.thread
        del bench
        gc.collect()
        thread.join(10.0)
        assert not thread.is_alive()


def test_live_an_exception_reaches_the_loop(box: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise RuntimeError("no more")

    monkeypatch.setattr(PoseTracker, "step", fail)
    system = LivePoseBeliefEstimator(box)
    bench = Bench(system)
    bench.feel()
    system._own.Eval(bench.context).exchange.thread.join()
    with pytest.raises(RuntimeError, match="no more"):
        bench.feel()
    # A loop that goes on all the same is told why nothing comes any more.
    assert bench.feel().startswith("lost: its thread ended with RuntimeError('no more'); the belief is ")
    system.close()


def hold_up(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Each further step of a tracker waits until the event is set."""
    step, may_go_on = PoseTracker.step, threading.Event()

    def wait(tracker: PoseTracker, belief: PoseBelief, frame: Frame) -> PoseBelief:
        may_go_on.wait(20.0)
        return step(tracker, belief, frame)

    monkeypatch.setattr(PoseTracker, "step", wait)
    return may_go_on


def test_live_a_belief_that_falls_behind_tells_its_age_and_is_lost(
    box: ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    with LivePoseBeliefEstimator(box) as system:
        bench = Bench(system)
        bench.fix(vision=SEEN)

        assert keep_pace(bench, 14) == "ok"
        may_go_on = hold_up(monkeypatch)
        bench.feel(12)
        assert re.match(r"ok: the belief is 0\.1\d s old$", str(bench.read("status")))
        bench.feel(20)
        assert re.match(r"lost: the belief is 0\.3\d s old$", str(bench.read("status")))
        assert bench.read("hypotheses").status == "no_solution"
        assert bench.read("belief").status == "lost"
        may_go_on.set()
        assert keep_pace(bench, 14).split(":")[0] == "ok"


def test_live_a_palm_that_jumps_in_a_skipped_reading_takes_what_was_in_it_with_it(
    box: ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    with LivePoseBeliefEstimator(box) as system:
        bench = Bench(system)
        bench.fix(vision=SEEN, palm_pose=RigidTransform())
        keep_pace(bench, 14)
        may_go_on = hold_up(monkeypatch)
        bench.feel()
        exchange = system._own.Eval(bench.context).exchange
        while exchange.newest is not None:  # until the thread has taken a reading, which occupies it
            time.sleep(1e-3)
        bench.fix(contacts=Contacts.empty(), fingers_in_contact=(), palm_pose=RigidTransform([2.0, 0.0, 0.0]))
        bench.simulator.AdvanceTo(bench.context.get_time() + 0.04)
        now = bench.context.get_time()
        may_go_on.set()
        while exchange.finished.belief.time < now - 0.0101:
            time.sleep(1e-3)
        bench.simulator.AdvanceTo(now + 0.01)
        assert bench.read("belief").status == "no_contact"
        assert error(bench.read("object_pose"))[0] < 0.005


@pytest.mark.parametrize("system", [PoseBeliefEstimator, LivePoseBeliefEstimator])
def test_an_object_or_parameters_of_another_type_are_named(box: ObjectModel, system: type[PoseBeliefEstimator]) -> None:
    with pytest.raises(InvalidInputError, match=r"^model must be an ObjectModel, not an int"):
        system(3)
    with pytest.raises(InvalidInputError, match=r"^params must be a PoseBeliefParams, not an int"):
        system(box, 3)
