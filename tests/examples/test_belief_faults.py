"""A few trials of what the whole study counts."""

import pytest

from tactopose_drake.core.tracking import Frame, PoseBelief, PoseTracker
from tests.examples.scripts import load_script


def test_wrong_vision_and_objects_that_were_moved_are_withstood() -> None:
    study = load_script("belief_faults.py")
    assert study.withstands_vision(66)
    assert study.finds_again(1).right


def test_a_belief_without_a_pose_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    study = load_script("belief_faults.py")

    def knows_nothing(tracker: PoseTracker, belief: PoseBelief, frame: Frame) -> PoseBelief:
        return tracker.start(frame.time)

    monkeypatch.setattr(PoseTracker, "step", knows_nothing)
    assert not study.withstands_vision(66)
    assert not study.finds_again(1).right
