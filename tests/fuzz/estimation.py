"""The fuzzer's targets `estimate_pose` and `identify`."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.estimation.search_methods import GLOBAL_METHODS, METHODS
from tests.fuzz import touches
from tests.fuzz.targets import Arguments, Target, build

_QUICK = ("pair_search", "levenberg_marquardt", "gradient_descent")
_LONGEST = 1.0  # s: the thesis' search and its like take as long as they are let.


def estimate_arguments(rng: np.random.Generator) -> Arguments:
    model, X_PO = touches.any_model(rng), touches.pose(rng)
    prior = touches.maybe(rng, 0.5, lambda: touches.prior(rng, X_PO))
    methods = sorted(METHODS) if prior is not None else sorted(GLOBAL_METHODS)
    method = "pair_search" if rng.random() < 0.6 else str(rng.choice(methods))
    is_quick = method in _QUICK
    few = None if is_quick else round(touches.log_uniform(rng, 1, 20))
    contacts = touches.contacts(rng, model, X_PO, few)
    has_forces = contacts["f_PC"] is not None
    return {
        "model": model,
        "contacts": contacts,
        "patches": [touches.pad(rng, model, X_PO) for _ in range(rng.integers(1, 4) if rng.random() < 0.15 else 0)],
        "planes": [touches.plane(rng, model, X_PO) for _ in range(rng.integers(1, 4) if rng.random() < 0.1 else 0)],
        "prior": prior,
        "hand": touches.maybe(rng, 0.3, lambda: touches.hand(rng, model, X_PO)),
        "untouched": touches.maybe(rng, 0.15, lambda: touches.hand(rng, model, X_PO)),
        "balance": touches.maybe(rng, 0.3 * has_forces, lambda: touches.gravity(rng)),
        "friction": touches.maybe(rng, 0.3 * has_forces, lambda: float(rng.uniform(0.0, 1.5))),
        "method": method,
        "seed": int(rng.integers(2**31)),
        "max_hypotheses": int(rng.choice([1, 2, 16, 64])),
        "time_limit": touches.maybe(rng, 0.1 if is_quick else 1.0, lambda: touches.log_uniform(rng, 1e-6, _LONGEST)),
        "outlier_probability": float(rng.choice([0.0, 1e-9, 0.02, 0.02, 0.02, 0.02, 0.3, 0.99])),
    }


def several(make: Callable[..., Any], arguments: Any) -> Any:
    """What `make` makes of each of a list's entries; another value is passed on as it is."""
    return [build(make, entry) for entry in arguments] if isinstance(arguments, list) else arguments


def estimate(arguments: Arguments) -> None:
    given = dict(arguments)
    given["contacts"] = build(tp.Contacts, given["contacts"])
    given["patches"] = several(tp.describe_patch, given["patches"])
    given["planes"] = several(tp.PlaneContact, given["planes"])
    given["prior"] = build(tp.PosePrior, given["prior"])
    for name in ("hand", "untouched"):
        given[name] = build(tp.HandGeometry, given[name])
    given["balance"] = build(ForceBalance, given["balance"])
    method, limit = given["method"], given["time_limit"]
    if isinstance(method, str) and method not in _QUICK and isinstance(limit, float) and limit > _LONGEST:
        given["time_limit"] = _LONGEST  # It was spoilt to minutes, which are then no hang.
    check_estimate(tp.estimate_pose(**given))


def check_estimate(estimate: tp.PoseEstimate) -> None:
    """Asserts that it says what `PoseEstimate` promises: whatever the status, in finite numbers."""
    hypotheses = estimate.hypotheses
    assert hypotheses
    assert estimate.status in ("ok", "ambiguous", "no_solution")
    probability = np.array([hypothesis.probability for hypothesis in hypotheses])
    assert np.isfinite(probability).all()
    assert abs(probability.sum() - 1.0) < 1e-9
    assert (np.diff(probability) <= 0.0).all()
    for hypothesis in hypotheses:
        assert hypothesis.X_PO.IsNearlyEqualTo(hypothesis.X_PO, 0.0)
        assert np.isfinite(hypothesis.X_PO.GetAsMatrix34()).all()
        assert np.isfinite(hypothesis.cost), hypothesis.cost
        covariance = hypothesis.covariance
        assert covariance.shape == (6, 6)
        assert np.isfinite(covariance).all(), covariance
        scale = np.sqrt(np.diag(covariance))
        assert (scale > 0.0).all(), covariance
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-6, covariance
        assert np.isfinite(hypothesis.free_directions).all()
        assert hypothesis.free_directions.shape == (len(hypothesis.free_directions), 6)
    assert math.isfinite(estimate.log_evidence), estimate.log_evidence


def identify_arguments(rng: np.random.Generator) -> Arguments:
    model, X_PO = touches.any_model(rng), touches.pose(rng)
    return {
        "models": [touches.any_model(rng) for _ in range(rng.integers(1, 4))],
        "contacts": touches.contacts(rng, model, X_PO),
        "patches": [touches.pad(rng, model, X_PO)] if rng.random() < 0.1 else [],
        "likelihood": str(rng.choice(["evidence", "inverse_cost"])),
        "candidates": int(rng.integers(1, 4)),
        "max_hypotheses": int(rng.choice([1, 16])),
        "seed": int(rng.integers(2**31)),
    }


def identify(arguments: Arguments) -> None:
    given = dict(arguments)
    given["contacts"] = build(tp.Contacts, given["contacts"])
    given["patches"] = several(tp.describe_patch, given["patches"])
    result = tp.identify(**given)
    assert result.status in ("ok", "ambiguous", "no_solution")
    likelihood = np.array([identity.likelihood for identity in result.identities])
    assert len(likelihood) == len(given["models"])
    assert np.isfinite(likelihood).all()
    assert abs(likelihood.sum() - 1.0) < 1e-9
    for identity in result.identities:
        if identity.estimate is not None:
            check_estimate(identity.estimate)


TARGETS = [Target(estimate_arguments, estimate, 10.0), Target(identify_arguments, identify)]
