"""How the pose estimator uses where the hand is: its collisions, and its volume as evidence.

Contacts are believed: four, of which one may be false, have many more explanations.
"""

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.hand.geometry import HandGeometry
from tests.hands import write_hand
from tests.systems.pose_estimator_bench import X_PO, Bench, make_box

BELIEVED = {"outlier_probability": 0.0}


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


@pytest.fixture(scope="module")
def slab(tmp_path_factory: pytest.TempPathFactory, box: ObjectModel) -> HandCollision:
    """A hand that is a wide slab below the box; moved by q along the box's z axis, its top is at z = q."""
    p, rpy = X_PO @ [0, 0, -0.01], X_PO.rotation().ToRollPitchYaw().vector()
    pose = " ".join(f"{number:.12f}" for number in (*p, *rpy))
    folder = tmp_path_factory.mktemp("slab")
    return HandCollision(write_hand(folder, "<box><size>0.5 0.5 0.02</size></box>", pose), box)


def step_over_slab(slab: HandCollision, box: ObjectModel, top: float, **params: object) -> tuple[PoseEstimate, str]:
    bench = Bench(box, slab, **params, **BELIEVED)
    bench.fix(contacts=from_above())
    bench.estimator.GetInputPort("joint_positions").FixValue(bench.context, [top])
    pose, hypotheses, status = bench.step()
    assert pose.IsExactlyEqualTo(hypotheses.best.X_PO)
    return hypotheses, status


def from_above() -> Contacts:
    """Two touches on narrow sides and two on the top: the box stands upright, 0.14 high, or lies, 0.10 high."""
    p = np.array([[0.03, 0.01, 0.04], [-0.03, -0.01, 0.05], [0.01, 0.02, 0.07], [-0.01, -0.02, 0.07]])
    n = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, 1]])
    return Contacts(X_PO.multiply(p.T).T, X_PO.rotation().multiply(n.T).T)


def heights(estimate: PoseEstimate) -> list[float]:
    """How far each hypothesis reaches down from the top."""
    down = -X_PO.rotation().matrix()[:, 2]
    extents = np.array([0.06, 0.10, 0.14])
    return [float(np.abs(h.X_PO.rotation().matrix().T @ down) @ extents) for h in estimate.hypotheses]


def test_hypotheses_that_collide_are_dropped(box: ObjectModel, slab: HandCollision) -> None:
    """Upright the box reaches down to z = -0.07, lying to -0.03."""
    estimate, status = step_over_slab(slab, box, -0.1)
    assert sorted(heights(estimate)) == pytest.approx([0.10, 0.14], abs=2e-3)
    assert status == estimate.status
    estimate, status = step_over_slab(slab, box, -0.05)
    assert heights(estimate) == pytest.approx([0.10], abs=2e-3)
    assert estimate.best.probability == pytest.approx(1.0)
    assert status == estimate.status == "ok"


def test_the_tolerance_says_what_a_collision_is(box: ObjectModel, slab: HandCollision) -> None:
    for tolerance, remaining in ((0.007, 1), (0.003, 2)):
        estimate, status = step_over_slab(slab, box, -0.025, collision_tolerance=tolerance)
        assert len(estimate.hypotheses) == remaining
        assert (status == "ok") == (remaining == 1)


@pytest.mark.parametrize(("sigma", "remaining"), [(0.001, 2), (0.0025, 1)])
def test_a_hand_that_may_be_off_collides_later(
    box: ObjectModel, slab: HandCollision, sigma: float, remaining: int
) -> None:
    """The lying box is 5 mm in the slab: as deep as two sigma of where the hand is, or five."""
    bench = Bench(box, slab, **BELIEVED)
    bench.fix(contacts=from_above(), hand=HandGeometry([[1.0, 1.0, 1.0]], [0.01], sigma))
    bench.estimator.GetInputPort("joint_positions").FixValue(bench.context, [-0.025])
    _, hypotheses, _ = bench.step()
    assert len(hypotheses.hypotheses) == remaining


def test_where_every_hypothesis_collides_all_stay_and_the_status_says_so(box: ObjectModel, slab: HandCollision) -> None:
    estimate, status = step_over_slab(slab, box, -0.01)
    assert sorted(heights(estimate)) == pytest.approx([0.10, 0.14], abs=2e-3)
    assert estimate.status == "ambiguous"
    assert status == "ambiguous: every hypothesis collides with the hand"


@pytest.mark.parametrize("port", ["hand", "untouched"])
def test_the_hands_volume_is_evidence(box: ObjectModel, port: str) -> None:
    bench = Bench(box, **BELIEVED)
    bench.fix(contacts=from_above())
    assert sorted(heights(bench.step()[1])) == pytest.approx([0.10, 0.14], abs=2e-3)
    below = HandGeometry([X_PO @ [0.0, 0.0, -0.05]], [0.01])
    bench.fix(**{port: below})
    estimate = bench.step()[1]
    lying = [h.probability for h, height in zip(estimate.hypotheses, heights(estimate), strict=True) if height < 0.11]
    assert sum(lying) > 0.999


@pytest.mark.parametrize("reading", [np.nan, 6.0, -6.0])
def test_a_reading_that_cannot_be_leaves_collisions_unchecked(
    box: ObjectModel, slab: HandCollision, reading: float
) -> None:
    estimate, status = step_over_slab(slab, box, reading)
    assert len(estimate.hypotheses) == 2
    assert status.endswith("collisions are not checked: a joint position is not known")
