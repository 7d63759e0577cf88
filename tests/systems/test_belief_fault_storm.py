"""What the belief says while every kind of fault comes by chance."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator
from tests.core.tracking.boxes import make_box, touch
from tests.systems.belief_runs import ANYWHERE, COVARIANCE, FINGERS, METRES_OFF, X_PO, Run, generator_at, seen


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


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
