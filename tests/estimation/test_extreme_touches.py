"""Touches at the ends of what is allowed, and arguments beyond it: an answer, or one clear error before any work."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tests.fuzz.estimation import check_estimate

OBJECTS = Path(__file__).parents[2] / "models" / "objects"


@pytest.fixture(scope="module")
def cube() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(OBJECTS / "cube.obj", mass=0.2)


def touch(model: tp.ObjectModel, count: int, **sigmas: float) -> tp.Contacts:
    rows = np.random.default_rng(count).integers(len(model.samples), size=count)
    return tp.Contacts(model.samples.points[rows] + [0.02, 0.0, 0.1], **sigmas)


@pytest.mark.parametrize(
    ("count", "sigma"), [(100, 0.1), (100, 1e-5), (100, 1e-7), (5, 0.1), (5, 1e-7), (2, 0.1), (30, 0.1)]
)
def test_any_number_of_contacts_of_any_noise_has_finite_answers(cube: tp.ObjectModel, count: int, sigma: float) -> None:
    for seed in range(3):
        check_estimate(tp.estimate_pose(cube, touch(cube, count, sigma_position=sigma), seed=seed))
    prior = tp.PosePrior(np.eye(3, 4), sigma_translation=1e3, sigma_rotation=1e3)
    check_estimate(tp.estimate_pose(cube, touch(cube, count, sigma_position=sigma), prior=prior))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": None}, "seed must be an integer >= 0, not None"),
        ({"seed": 1.5}, "seed must be .*, not 1.5"),
        ({"seed": True}, "seed must be .*, not True"),
        ({"seed": "a"}, "seed must be .*, not 'a'"),
        ({"method": []}, r"method must be one of pair_search.*, not \[\]"),
        ({"method": None}, "method must be one of .*, not None"),
        ({"max_hypotheses": "a"}, "max_hypotheses must be an integer >= 1, not 'a'"),
        ({"max_hypotheses": 1.5}, "max_hypotheses must be .*, not 1.5"),
        ({"max_hypotheses": math.nan}, "max_hypotheses must be .*, not nan"),
        ({"time_limit": "1"}, "time_limit must be a number, not"),
        ({"time_limit": True}, "time_limit must be a number, not"),
        ({"friction": "0.5"}, "friction must be a number, not"),
        ({"friction": 1e9}, r"friction must be a number from 0 to 1000, not 1e\+09"),
        ({"patches": 3}, "patches must be a sequence of Patch, not an int"),
        ({"prior": "here"}, "prior must be a PosePrior, not a str"),
        ({"balance": 9.81}, "balance must be a ForceBalance, not a float"),
    ],
)
def test_options_of_the_wrong_kind_are_named(cube: tp.ObjectModel, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(tp.TactoposeError, match=message):
        tp.estimate_pose(cube, touch(cube, 5), **arguments)


def test_contacts_in_millimetres_are_refused(cube: tp.ObjectModel) -> None:
    """Near the palm, where their coordinates alone do not say so."""
    near = tp.Contacts([[3.0, 0.0, 4.0], [-3.0, 1.0, 5.0], [0.0, 5.0, 6.0]])
    for call in (lambda: tp.estimate_pose(cube, near), lambda: tp.identify([cube], near)):
        with pytest.raises(
            tp.TactoposeError, match=r"contacts must be at most .* m apart on an object of 0\.\d+ m, not .* m.*0\.001"
        ):
            call()
    small, large = cube, tp.ObjectModel.from_mesh(OBJECTS / "mug.obj")
    assert len(tp.identify([small, large], touch(large, 5))) == 2


@pytest.mark.parametrize(
    "arguments", [{"seed": 1.5}, {"candidates": True}, {"max_hypotheses": None}, {"likelihood": []}, {"executor": 3}]
)
def test_identification_names_its_options_too(cube: tp.ObjectModel, arguments: dict[str, Any]) -> None:
    with pytest.raises(tp.TactoposeError, match=next(iter(arguments))):
        tp.identify([cube], touch(cube, 5), **arguments)


def test_balance_needs_a_contact(cube: tp.ObjectModel) -> None:
    with pytest.raises(tp.TactoposeError, match="contacts must be at least 1 for the balance, not 0"):
        tp.estimate_pose(
            cube, tp.Contacts(np.zeros((0, 3)), f_PC=np.zeros((0, 3))), balance=tp.ForceBalance([0, 0, -9.81])
        )


def test_balance_is_weighed_however_little_the_rest_of_its_noise_is() -> None:
    """One contact leaves the moment about its force's line to the torque's noise alone."""
    box = tp.ObjectModel.from_mesh(OBJECTS / "mug.obj", mass=0.3, symmetry="none")
    contacts = tp.Contacts(box.samples.points[:1], None, [[1e6, 1e5, 1e4]], sigma_position=0.1)
    check_estimate(
        tp.estimate_pose(box, contacts, prior=tp.PosePrior(np.eye(3, 4)), balance=tp.ForceBalance([0, 0, -9], 1e-12))
    )
