"""What the belief says while vision fails."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator
from tactopose_drake.systems.tracker_input import TrackerInput
from tests.core.tracking.boxes import make_box
from tests.systems.belief_runs import (
    COVARIANCE,
    METRES_OFF,
    X_PO,
    Run,
    Script,
    Signal,
    begun,
    generator_at,
    seen,
    still,
    touched,
)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


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


@pytest.mark.parametrize("late", [2.0, -2.0])
def test_a_stamp_that_is_wrong_goes_with_the_vision_that_has_it(box: ObjectModel, late: float) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        vision=lambda time: seen(X_PO, time - late, generator_at(time)) if time < 0.105 else None,
        **touched(still),
    )
    assert "vision is of" in run.until(0.1).status
    assert "vision" not in run.until(0.12).status


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
    # The touch is new in the first tenth of a second.
    assert run.words(0.115, 0.6) == {"ok"}
    run.assert_never_a_silent_guess(still)


def test_a_tracker_that_gives_no_numbers_counts_as_no_vision(box: ObjectModel) -> None:
    def pose(time: float) -> RigidTransform:
        return X_PO if time < 0.152 else RigidTransform(X_PO.rotation(), np.full(3, np.nan))

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
    assert run.until(0.14).word == "ok"
    assert run.read("tracker_status") == "ok"
    assert run.until(0.3).word == "ok"
    assert run.read("tracker_status") == "X_PO[0, 3] must be a finite number, not nan."
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
