"""The fuzzer's targets `grasp_quality` and `force_closure_probability`."""

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tests.fuzz import touches
from tests.fuzz.targets import Arguments, Target, build


def _grasp(rng: np.random.Generator) -> tuple[Arguments, touches.Array]:
    model, X_PO = touches.any_model(rng), touches.pose(rng)
    arguments = {
        "model": model,
        "contacts": touches.contacts(rng, model, X_PO, round(touches.log_uniform(rng, 1.0, 10.0))),
        "friction": float(rng.uniform(0.0, 1.5)),
        "edges": int(rng.integers(3, 9)),
    }
    return arguments, X_PO


def quality_arguments(rng: np.random.Generator) -> Arguments:
    arguments, X_PO = _grasp(rng)
    return {
        **arguments,
        "X_PO": X_PO,
        # The other norm's space has so many corners that few contacts are enough for a minute.
        "norm": "Linf" if len(arguments["contacts"]["p_PC"]) <= 3 and rng.random() < 0.3 else "L1",
        "length": touches.maybe(rng, 0.3, lambda: touches.log_uniform(rng, 1e-3, 1.0)),
        "task": [None, None, "object", rng.normal(size=(3, 6))][rng.integers(4)],
    }


def quality(arguments: Arguments) -> None:
    given = dict(arguments)
    given["contacts"] = build(tp.Contacts, given["contacts"])
    result = tp.grasp_quality(given.pop("model"), given.pop("contacts"), given.pop("X_PO"), **given)
    assert np.isfinite(result.radius)
    assert result.radius >= 0.0
    assert np.isfinite(result.volume)
    assert np.isfinite(result.p_OC).all()
    assert np.isfinite(result.n_OC).all()
    assert np.isfinite(result.distance).all()
    assert result.task_scale is None or result.task_scale >= 0.0


def closure_arguments(rng: np.random.Generator) -> Arguments:
    arguments, X_PO = _grasp(rng)
    count = int(rng.integers(1, 4))
    root = rng.normal(size=(count, 6, 6)) * np.repeat([0.05, 0.002], 3)[:, None]
    belief = {
        "X_PO": np.repeat(X_PO[None], count, axis=0),
        "weights": rng.random(count) + 1e-3,
        "covariance": root @ np.swapaxes(root, 1, 2),
    }
    return {**arguments, "belief": belief, "samples": int(rng.integers(1, 20)), "seed": int(rng.integers(2**31))}


def closure(arguments: Arguments) -> None:
    given = dict(arguments)
    given["contacts"] = build(tp.Contacts, given["contacts"])
    given["belief"] = build(GaussianMixture, given["belief"])
    result = tp.force_closure_probability(**given)
    assert 0.0 <= result.value <= 1.0
    assert np.isfinite(result.standard_error)


TARGETS = [Target(quality_arguments, quality), Target(closure_arguments, closure, 0.5)]
