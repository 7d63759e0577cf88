"""When a belief over time is an answer."""

import copy
import dataclasses
import math
import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking import pose_belief, pose_tracker
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import Explanation, PoseBelief, summarise
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import make_box, touch
from tests.core.tracking.follower import X_PO, Follower


def message(belief: PoseBelief, evidence: Evidence) -> str:
    """What is said of a belief that has contacts."""
    params = PoseTrackerParams()
    explanation = Explanation(make_box(), evidence, params.plausibility)
    return summarise(make_box(), params, belief, explanation, has_contact=True).message


@pytest.fixture(scope="module")
def tracker() -> PoseTracker:
    return PoseTracker(make_box())


def test_two_contacts_are_no_answer_without_what_is_seen_since_then(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    said = [follower.feel(X_PO, fingers=(0, 1)) for _ in range(40)]
    assert "ok" not in {belief.status for belief in said}
    # However sure the best mode is, and for however long.
    sure = dataclasses.replace(said[-1], modes=said[-1].modes.chosen([0]), unsettled_time=0.0)
    evidence = Evidence(touch(X_PO, follower.generator)[:2])
    reason = "ambiguous: 2 contacts; 3 are needed, or vision since then"
    assert message(sure, evidence) == reason
    assert follower.feel(X_PO, 30).status == "ok"
    follower = Follower(tracker)
    for _ in range(30):
        seen = PoseMeasurement(follower.belief.time, X_PO, np.diag(np.repeat([0.02**2, 0.002**2], 3)))
        follower.feel(X_PO, vision=seen, fingers=(0, 1))
    assert follower.belief.status == "ok"


@pytest.mark.parametrize(
    ("test", "sign"),
    [
        ("detect_by_forces", "friction gives way, as the forces show"),
        ("detect_by_motion", "the fingertips move otherwise than on one rigid object"),
        ("detect_by_surface", "the surface moves under the fingertips"),
    ],
)
def test_a_slip_says_by_what_it_was_found(
    tracker: PoseTracker, monkeypatch: pytest.MonkeyPatch, test: str, sign: str
) -> None:
    follower, found = Follower(tracker), getattr(pose_tracker, test)
    assert follower.feel(X_PO, 15).message == "ok"
    with monkeypatch.context() as patch:
        patch.setattr(pose_tracker, test, lambda *given, **more: (found(*given, **more)[0], True))
        assert follower.feel(X_PO).message == f"slipping: {sign}"
    assert follower.feel(X_PO, 5).message == f"slipping: {sign}"
    assert follower.feel(X_PO, 30).message == "ok"
    unexplained = dataclasses.replace(follower.belief, explained_time=follower.belief.time)
    elsewhere = touch(retract(X_PO, np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])), follower.generator)
    assert message(unexplained, Evidence(elsewhere)) == "slipping: the best pose does not explain the touch"


def test_a_mode_that_is_wide_is_an_answer_only_along_what_the_touch_does_not_tell(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    belief, contacts = follower.feel(X_PO, 13), touch(X_PO, follower.generator)
    sides = contacts[np.flatnonzero(np.abs(contacts.n_PC @ X_PO[:, 0]) < 0.3)]
    assert 3 <= len(sides) < len(contacts)
    assert belief.status == "ok"
    for told, wide, said in (
        (sides, [0], "ok"),
        (contacts, [0], "ambiguous: known to 30 mm and 2 degrees"),
        (sides, [0, 1], "ambiguous: 2 directions are left open"),
    ):
        covariance, slides = belief.modes.covariance.copy(), X_PO[:, wide]
        covariance[:, 3:, 3:] += 0.03**2 * slides @ slides.T
        modes = dataclasses.replace(belief.modes, covariance=covariance)
        opened = dataclasses.replace(belief, modes=modes, explained_time=belief.time)
        assert message(opened, Evidence(told)) == said


def test_what_is_known_to_nine_degrees_or_nine_millimetres_is_no_answer(tracker: PoseTracker) -> None:
    """Of such poses one in forty is off by 20 degrees or millimetres."""
    follower = Follower(tracker)
    belief, contacts = follower.feel(X_PO, 13), touch(X_PO, follower.generator)
    for coordinate, sigma, said in (
        (2, math.radians(6.0), "ok"),
        (2, math.radians(9.0), "ambiguous: known to 1 mm and 9 degrees"),
        (5, 0.006, "ok"),
        (5, 0.009, "ambiguous: known to 9 mm and 2 degrees"),
    ):
        covariance = belief.modes.covariance.copy()
        covariance[:, coordinate, coordinate] += sigma**2
        modes = dataclasses.replace(belief.modes, covariance=covariance)
        wider = dataclasses.replace(belief, modes=modes, explained_time=belief.time)
        assert message(wider, Evidence(contacts)) == said


def test_a_ball_on_a_stick_that_is_held_by_the_ball_may_point_anywhere() -> None:
    angles = np.linspace(-0.5 * np.pi, math.acos(1.0 / 3.0), 40)
    ball = 0.03 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    mesh = trimesh.creation.revolve([*ball, (0.01, 0.1), (0.0, 0.1)], sections=48)
    # Its origin is the stick's other end, so that the poses it may have lie on a sphere.
    model = ObjectModel.from_mesh(mesh.apply_translation([0.0, 0.0, -0.1]), cache=False)
    tracker, generator = PoseTracker(model), np.random.default_rng(0)
    belief, n_OC = tracker.start(0.0), np.array([[1.0, 0, -0.5], [-0.6, 0.8, -0.3], [-0.5, -0.9, -0.2]])
    n_OC /= np.linalg.norm(n_OC, axis=1, keepdims=True)
    turns = []
    for k in range(100):
        n_PC = n_OC + 0.03 * generator.normal(size=(3, 3))
        n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
        p_PC = 0.03 * n_OC + 0.0005 * generator.normal(size=(3, 3))
        evidence = Evidence(Contacts(p_PC, n_PC, sigma_position=0.0009, sigma_normal=0.09))
        belief = tracker.step(belief, Frame(0.01 * (k + 1), evidence, ("a", "b", "c")))
        assert belief.status != "ok", belief
        turns.append(math.sqrt(np.linalg.eigvalsh(belief.covariance[0][:3, :3])[0]))
    assert min(turns[20:]) > math.radians(6.0)


def test_what_is_less_sure_than_an_answer_is_ambiguous(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    belief, evidence = follower.feel(X_PO, 12), Evidence(touch(X_PO, follower.generator))
    reason = "ambiguous: the likeliest of several poses carries less than 98%"
    for share, said in ((0.99, "ok"), (0.97, reason)):
        modes = dataclasses.replace(belief.modes.chosen([0, 0]), log_weight=np.log([share, 1.0 - share]))
        doubted = dataclasses.replace(belief, modes=modes)
        assert message(doubted, evidence) == said


def test_whether_poses_explain_a_touch_is_asked_once(tracker: PoseTracker, monkeypatch: pytest.MonkeyPatch) -> None:
    generator, asked = np.random.default_rng(0), []
    explanation = Explanation(make_box(), Evidence(touch(X_PO, generator)), PoseTrackerParams().plausibility)
    explain = pose_belief.explain_touch

    def count(*arguments: Any) -> Any:
        asked.append(1)
        return explain(*arguments)

    monkeypatch.setattr(pose_belief, "explain_touch", count)
    off = retract(X_PO[None], np.array([[0.0, 0, 0, 0.02, 0, 0]]))
    both = np.concatenate([X_PO[None], off])
    assert explanation.of(both).tolist() == explanation.of(both.copy()).tolist() == [True, False]
    assert len(asked) == 1
    assert explanation.of(off).tolist() == [False]


def arrays_in(value: object, place: str = "belief") -> Iterator[tuple[str, np.ndarray]]:
    """All arrays that are to be had from a value, with where they are."""
    if isinstance(value, np.ndarray):
        yield place, value
    elif isinstance(value, tuple):
        for i, part in enumerate(value):
            yield from arrays_in(part, f"{place}[{i}]")
    elif dataclasses.is_dataclass(value):
        for name, part in vars(value).items():
            yield from arrays_in(part, f"{place}.{name}")


def test_a_belief_cannot_be_written_for_its_copies_are_itself(tracker: PoseTracker) -> None:
    follower, seen = Follower(tracker), PoseMeasurement(0.0, X_PO, np.diag(np.repeat([0.02**2, 0.002**2], 3)))
    beliefs = [follower.belief, follower.feel(X_PO, vision=seen), follower.feel(X_PO, 12), follower.feel(None)]
    for belief in beliefs:
        assert copy.deepcopy(belief) is belief
        for each in (belief, pickle.loads(pickle.dumps(belief))):
            assert [place for place, array in arrays_in(each) if array.flags.writeable] == []
    with pytest.raises(ValueError, match="read-only"):
        beliefs[2].X_PO[0, :, 3] += 1.0
    assert len(beliefs[2].keyframes) > 0
