"""The belief from messages, with an inbox that is filled by hand and a clock that is set."""

from types import SimpleNamespace

import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.lcm_messages import HandSensesMessage
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.runs import message_run
from tactopose_drake.systems.object_tracker import ObjectTracker
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests import held_cube


class _Inbox:
    """Gives the senses that it is told to."""

    received = lost = passed_over = 0

    def __init__(self) -> None:
        self.senses: HandSensesMessage | None = None

    def wait(self, timeout: float) -> None:
        pass

    def take(self) -> HandSensesMessage | None:
        senses, self.senses = self.senses, None
        return senses

    def take_vision(self, utime: int) -> None:
        return None

    def take_remarks(self) -> tuple[str, ...]:
        return ()


def test_senses_whose_time_stands_still_are_not_fresh_however_many_messages_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(message_run, "time", SimpleNamespace(monotonic=lambda: clock.now))
    hand = load_hand_config("shadow_like")
    cube = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    tracker = ObjectTracker(hand, cube, PoseTrackingParams(use_joint_velocities=False))
    inbox = _Inbox()
    run = message_run._MessageRun(0.22, hand, tracker, inbox, None)

    def hear(step: int, utime: int) -> str:
        clock.now = 100.0 + 0.05 * step
        inbox.senses = HandSensesMessage(utime=utime, sequence=step, wrenches=dict(held_cube.WRENCHES))
        run.step(0.0)
        return run.status

    moving = [hear(step, 50_000 * step) for step in range(10)]
    assert not any("stood still" in status or "no senses" in status for status in moving)
    standing = [hear(step, 450_000) for step in range(10, 20)]  # The last new time was at step 9.
    assert [status.startswith("lost: the senses' time has stood still for") for status in standing] == (
        4 * [False] + 6 * [True]
    )
    assert "the senses are back after" in hear(20, 500_000)
    assert "the senses" not in hear(21, 550_000)
