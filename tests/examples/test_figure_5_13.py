"""Global poses by tactile arrays: which hypotheses are right, and what is said of the thesis' claim."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, identity_poses, make_poses
from tactopose_drake.resources import model_path


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "examples" / "thesis"))
        return importlib.import_module("figure_5_13")


def test_images_of_the_truth_and_what_is_free_are_right(script: ModuleType) -> None:
    can = tp.ObjectModel.from_mesh(model_path("objects", "soda_can.obj"))
    truth, nothing = identity_poses(1)[0], np.zeros((0, 6))
    spun = make_poses(exp_so3(np.array([0.0, 0.0, 2.0])), np.zeros(3))
    slid = make_poses(np.eye(3), np.array([0.0, 0.0, 0.02]))
    tilted = make_poses(exp_so3(np.array([0.5, 0.0, 0.0])), np.zeros(3))
    assert script.is_right(can, spun, nothing, truth)
    assert not script.is_right(can, slid, nothing, truth)
    assert script.is_right(can, slid, np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]), truth)
    assert not script.is_right(can, tilted, nothing, truth)


def test_the_verdict_counts_right_poses_and_what_tells_them_apart(script: ModuleType) -> None:
    told = {script.DISTANCE: (2.0, 1.0), script.PCA: (1.0, 2.0)}
    found = {
        "first": script.Found("ambiguous", (0.6, 0.4), (True, False), told),
        "second": script.Found("ambiguous", (0.7, 0.3), (False, True), told),
        "wrong": script.Found("ok", (0.99,), (False,), dict.fromkeys(script.COSTS, (np.nan, 1.0))),
    }
    text = script.markdown(found)
    assert "Right first in 1 of 3 grips, among the hypotheses in 2; of 1 first ones with more than 95 % 1 are" in text
    assert "Of 2 grips with a wrong pose beside the right one" in text
    assert "the covariances cost less at the right one in 2, the distances in 0" in text
    assert "what the latter do not, holds here" in text
