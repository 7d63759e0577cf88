"""The fuzzer's target `PoseTracker.step`: some frames of one object in a hand."""

from typing import Any

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.poses import compose
from tactopose_drake.core.tracking import Frame, PoseTracker, PoseTrackerParams
from tests.fuzz import touches
from tests.fuzz.targets import Arguments, Target, build


def arguments(rng: np.random.Generator) -> Arguments:
    model, X_PO = touches.any_model(rng), touches.pose(rng, 0.05)
    count = int(rng.integers(0, 7))
    time, frames = 0.0, []
    for _ in range(rng.integers(1, 5)):
        time += float(rng.choice([0.0, 0.01, 0.1, 2.0]))
        present = count if rng.random() < 0.7 else int(rng.integers(0, 7))
        frames.append(_frame(rng, model, X_PO, time, present))
    return {"model": model, "params": {"lost_time": float(rng.uniform(0.05, 1.0)), "seed": 3}, "frames": frames}


def _frame(rng: np.random.Generator, model: tp.ObjectModel, X_PO: touches.Array, time: float, count: int) -> Arguments:
    contacts = touches.contacts(rng, model, X_PO, count)
    velocity = {str(i): 0.01 * rng.normal(size=6) for i in range(count)}
    covariance = np.diag(np.repeat([0.1, 0.01], 3) ** 2)
    guess = compose(X_PO, touches.pose(rng, 0.0)) if rng.random() < 0.2 else X_PO
    return {
        "time": time,
        "evidence": {
            "contacts": contacts,
            "prior": touches.maybe(rng, 0.3, lambda: touches.prior(rng, X_PO)),
            "hand": touches.maybe(rng, 0.3, lambda: touches.hand(rng, model, X_PO)),
            "balance": touches.maybe(rng, 0.2 * (contacts["f_PC"] is not None), lambda: touches.gravity(rng)),
        },
        "tip_velocity": touches.maybe(rng, 0.5, lambda: velocity),
        "vision": touches.maybe(
            rng, 0.4, lambda: {"time": max(0.0, time - 0.05), "X_PO": guess, "covariance": covariance}
        ),
        "X_WP": touches.maybe(rng, 0.5, lambda: touches.pose(rng)),
    }


def _evidence(given: Arguments) -> Evidence:
    """What the arguments say; of what is missing, nothing is known."""
    return Evidence(
        build(tp.Contacts, given.get("contacts", tp.Contacts.empty())),
        build(tp.PosePrior, given.get("prior")),
        build(tp.HandGeometry, given.get("hand")),
        balance=build(ForceBalance, given.get("balance")),
    )


def _frame_of(given: Any) -> Any:
    if not isinstance(given, dict) or not given:
        return given
    parts = dict(given)
    if isinstance(parts.get("evidence"), dict):
        parts["evidence"] = _evidence(parts["evidence"])
    parts["vision"] = build(tp.PoseMeasurement, parts.get("vision"))
    return build(Frame, parts)


def follow(given: Arguments) -> None:
    tracker = PoseTracker(given["model"], build(PoseTrackerParams, given["params"]))
    belief = tracker.start()
    frames = given["frames"] if isinstance(given["frames"], list) else [given["frames"]]
    for frame in frames:
        belief = tracker.step(belief, _frame_of(frame))
        assert belief.status in ("ok", "ambiguous", "slipping", "no_contact", "lost")
        assert len(belief.X_PO) == len(belief.probability) == len(belief.covariance)
        for array in (belief.X_PO, belief.probability, belief.covariance):
            assert np.isfinite(array).all()
        assert not len(belief.probability) or abs(belief.probability.sum() - 1.0) < 1e-9


TARGETS = [Target(arguments, follow, 1.5)]
