"""What the belief says while the motion of the palm or the fingertips is not known, or the object is not touched."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator
from tests.core.tracking.boxes import make_box
from tests.systems.belief_runs import ANYWHERE, FINGERS, Run, begun, still, touched


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def test_a_palm_that_is_not_known_leaves_the_pose_in_the_palm(box: ObjectModel) -> None:
    def palm(time: float) -> RigidTransform:
        return RigidTransform([0.5, 0.0, 0.3]) if time < 0.15 or time > 0.3 else RigidTransform(np.full(3, np.nan))

    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), palm_pose=palm, **touched(still))
    assert run.until(0.13).status == "ok"
    last = run.until(0.2)
    assert last.status == "ok: the palm's pose is not finite"
    assert not np.any(np.isfinite(run.read("object_pose_in_world").translation()))
    assert run.until(0.35).status == "ok"
    in_world = run.read("object_pose_in_world")
    assert in_world.IsNearlyEqualTo(RigidTransform([0.5, 0.0, 0.3]) @ run.read("object_pose"), 1e-12)
    run.assert_never_a_silent_guess(still)


@pytest.mark.parametrize(
    ("there", "jump"),
    [
        (RigidTransform([1.0, 0.0, 0.0]), "1.00 m and 0 degrees"),
        (RigidTransform(RotationMatrix.MakeZRotation(1.0), [0.0, 0.0, 0.0]), "0.00 m and 57 degrees"),
    ],
    ids=["elsewhere", "turned"],
)
def test_a_palm_that_jumps_in_the_world_takes_what_was_in_it_with_it(
    box: ObjectModel, there: RigidTransform, jump: str
) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        vision=begun(lambda time: None),
        palm_pose=lambda time: RigidTransform() if time < 0.195 else there,
        untouched=lambda time: None if time < 0.1 else ANYWHERE,
        **touched(still, lambda time: time < 0.1),
    )
    held = run.until(0.15).pose
    last = run.until(0.2)
    assert last.status.startswith(f"no_contact: the palm's pose has jumped by {jump}")
    assert last.pose.IsNearlyEqualTo(held, 1e-9)
    last = run.until(0.3)
    assert "jumped" not in last.status
    assert last.pose.IsNearlyEqualTo(held, 1e-9)


def test_a_hand_that_is_carried_fast_does_not_jump(box: ObjectModel) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        vision=begun(lambda time: None),
        palm_pose=lambda time: RigidTransform(RotationMatrix.MakeZRotation(8.0 * time), [4.0 * time, 0.0, 0.0]),
        **touched(still),
    )
    run.until(0.2)
    assert not [instant for instant in run.instants if "jumped" in instant.status]


def test_a_palm_that_is_told_less_often_than_beliefs_are_made_does_not_jump(box: ObjectModel) -> None:
    """An untouched object stays behind in the world as the hand is drawn away at 1.2 m/s, told every quarter second."""
    moves = 0.28

    def palm(time: float) -> RigidTransform:
        told = 0.25 * np.floor(time / 0.25 + 1e-6)
        return RigidTransform([0.0, 0.0, 0.001 * min(told, moves) + 1.2 * max(0.0, told - moves)])

    run = Run(
        PoseBeliefEstimator(box),
        vision=begun(lambda time: None),
        palm_pose=palm,
        untouched=lambda time: None if time < 0.4 else ANYWHERE,
        **touched(still, lambda time: time < 0.4),
    )
    held = run.until(0.45).pose.translation()
    moved = run.until(0.55).pose.translation() - held
    assert not [instant for instant in run.instants if "jumped" in instant.status]
    np.testing.assert_allclose(moved, [0.0, 0.0, -1.2 * (0.5 - moves)], atol=0.011)


def test_velocities_that_are_not_known_are_named(box: ObjectModel) -> None:
    def tips(time: float) -> dict[str, np.ndarray] | None:
        bad = None if time > 0.2 else {finger: np.full(6, np.nan) for finger in FINGERS}
        return bad if time > 0.1 else dict.fromkeys(FINGERS, np.zeros(6))

    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), tip_velocities=tips, **touched(still))
    assert run.until(0.1).status == "ok"
    for time in (0.15, 0.3):
        assert run.until(time).status == "ok: the fingertips' velocities are not known"
    run.assert_never_a_silent_guess(still)


def test_one_fingertip_beyond_all_reason_is_named(box: ObjectModel) -> None:
    def tips(time: float) -> dict[str, np.ndarray]:
        return dict.fromkeys(FINGERS, np.zeros(6)) | ({FINGERS[2]: np.full(6, -2e4)} if time > 0.1 else {})

    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), tip_velocities=tips, **touched(still))
    assert run.until(0.1).status == "ok"
    assert run.until(0.15).status == "ok: the fingertips' velocities are beyond all reason"


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
