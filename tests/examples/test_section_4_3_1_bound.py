"""The bound on section 4.3.1: the answer with the most mass, of beliefs that are made up."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tactopose_drake.core.poses import retract
from tactopose_drake.resources import model_path


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "examples" / "thesis"))
        return importlib.import_module("section_4_3_1_bound")


@pytest.fixture(scope="module")
def model() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))


def test_the_best_answer_has_the_most_of_the_belief_within_the_limits(
    script: ModuleType, model: tp.ObjectModel
) -> None:
    there = np.eye(3, 4)[None]
    away = retract(there, np.array([[0.0, 0.0, 0.0, 0.05, 0.0, 0.0]]))
    turned = retract(there, np.array([[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]]))
    belief = np.concatenate([np.repeat(there, 5, 0), np.repeat(away, 3, 0), np.repeat(turned, 2, 0)])
    near = retract(there, np.array([[0.0, 0.0, 0.0, 0.005, 0.0, 0.0]]))
    answer, share = script.best_answer(model, belief, np.concatenate([away, turned, near]))
    np.testing.assert_allclose(answer, near[0])
    assert share == 0.5


def test_poses_are_drawn_as_the_hypotheses_say(script: ModuleType) -> None:
    covariance = np.diag([0.01, 0.01, 0.01, 1e-6, 4e-6, 9e-6])
    hypotheses = tuple(
        tp.PoseHypothesis(
            X_PO=RigidTransform([x, 0.0, 0.0]),
            cost=0.0,
            probability=p,
            covariance=covariance,
            free_directions=np.empty((0, 6)),
            inlier_probability=np.empty(0),
        )
        for x, p in ((0.0, 0.7), (1.0, 0.3))
    )
    estimate = tp.PoseEstimate(hypotheses=hypotheses, status="ambiguous", duration=0.0)
    X_PO = script.draw(estimate, 4000, np.random.default_rng(0))
    first = X_PO[X_PO[:, 0, 3] < 0.5]
    assert len(first) / 4000 == pytest.approx(0.7, abs=0.03)
    np.testing.assert_allclose(first[:, :, 3].std(axis=0), [0.001, 0.002, 0.003], rtol=0.1)


def test_the_verdict_says_what_touch_allows(script: ModuleType) -> None:
    cells = {cell: script.Outcome(0.6, 0.65, 0.66) for cell in script.CELLS}
    lines = script.verdicts({"correction": cells})
    assert lines[0].startswith("correction, 4 fingers, 1.8 mm, 10°: the thesis says over 80 %")
    assert "the belief allows 66 % to any estimate: at this noise the claim does NOT hold" in lines[0]
