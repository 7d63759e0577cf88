import copy
import dataclasses
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence, GaussianPrior
from tactopose_drake.errors import InvalidInputError

X_PO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.01, 0.02, 0.03])


@pytest.mark.parametrize("given", [X_PO, X_PO.GetAsMatrix34(), X_PO.GetAsMatrix4(), X_PO.GetAsMatrix34().tolist()])
def test_a_prior_takes_a_rigid_transform_or_an_array(given: RigidTransform | ArrayLike) -> None:
    prior = tp.PosePrior(given, sigma_translation=0.02, sigma_rotation=0.1)
    assert isinstance(prior.X_PO, RigidTransform)
    np.testing.assert_array_equal(prior.X_PO.GetAsMatrix34(), X_PO.GetAsMatrix34())
    np.testing.assert_array_equal(prior.mean, X_PO.GetAsMatrix34())
    np.testing.assert_array_equal(prior.sigmas, [0.1, 0.1, 0.1, 0.02, 0.02, 0.02])


def test_a_prior_and_contacts_are_as_sure_as_is_promised_where_nothing_is_told() -> None:
    prior, contacts = tp.PosePrior(X_PO), tp.Contacts([[0.0, 0.0, 0.03]], [[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(prior.sigmas, np.repeat([math.radians(16.0), 0.033], 3), rtol=1e-12)
    np.testing.assert_allclose([contacts.sigma_position, contacts.sigma_normal], [[0.0009], [math.radians(5.0)]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"X_PO": np.ones((3, 4))}, "X_PO must have a rotation matrix as its left 3x3 block, not"),
        ({"X_PO": np.diag([1.0, 1.0, -1.0, 1.0])}, "X_PO must have a rotation matrix as its left 3x3 block, not"),
        ({"X_PO": np.eye(3)}, "X_PO must have the shape .*"),
        (
            {"X_PO": RigidTransform([11.0, 0.0, 0.0])},
            r"^X_PO.translation must have .*10 m, not \[11.0, 0.0, 0.0\] m. Multiply by 0.001",
        ),
        ({"X_PO": np.eye(4), "sigma_translation": -1.0}, "sigma_translation must be a number > 0, not -1"),
        ({"X_PO": np.eye(4), "sigma_rotation": math.nan}, "sigma_rotation must be .*, not nan"),
    ],
)
def test_bad_priors_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        tp.PosePrior(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "again",
    [
        copy.deepcopy,
        lambda prior: pickle.loads(pickle.dumps(prior)),
        lambda prior: AbstractValue.Make(prior).Clone().get_value(),
        dataclasses.replace,
    ],
)
def test_copies_are_equal_and_their_arrays_contiguous(again: Callable[[tp.PosePrior], tp.PosePrior]) -> None:
    prior = tp.PosePrior(X_PO, 0.02, 0.1)
    copied = again(prior)
    assert isinstance(copied, tp.PosePrior)
    assert copied.X_PO.IsExactlyEqualTo(X_PO)
    np.testing.assert_array_equal(copied.mean, prior.mean)
    np.testing.assert_array_equal(copied.sigmas, prior.sigmas)
    assert copied.mean.flags.c_contiguous


def test_one_number_of_a_prior_can_be_replaced() -> None:
    prior = dataclasses.replace(tp.PosePrior(X_PO, 0.02, 0.1), sigma_rotation=0.3)
    assert (prior.sigma_translation, prior.sigma_rotation) == (0.02, 0.3)
    assert dataclasses.replace(prior, X_PO=np.eye(4)).X_PO.IsExactlyEqualTo(RigidTransform())


def test_core_takes_the_prior_as_it_is_and_gives_it_back() -> None:
    prior = tp.PosePrior(X_PO, 0.02, 0.1)
    assert Evidence(tp.Contacts.empty(), prior).prior is prior
    again = tp.PosePrior.of(GaussianPrior(prior.mean, prior.sigma_translation, prior.sigma_rotation))
    assert again.X_PO.IsExactlyEqualTo(X_PO)
    np.testing.assert_array_equal(again.sigmas, prior.sigmas)


def test_a_pose_that_was_handed_out_is_not_the_priors_own() -> None:
    prior = tp.PosePrior(X_PO, 0.02, 0.1)
    prior.X_PO.set_translation([9.0, 9.0, 9.0])
    assert prior.X_PO.IsExactlyEqualTo(X_PO)
    np.testing.assert_array_equal(prior.mean, X_PO.GetAsMatrix34())
    assert prior == tp.PosePrior(X_PO, 0.02, 0.1)


def test_a_sigma_that_is_probably_in_another_unit_is_remarked_once(caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        tp.PosePrior(X_PO, sigma_translation=33.0, sigma_rotation=16.0)
    assert [record.getMessage() for record in caplog.records] == [
        "PosePrior: sigma_translation is 33 m, with which the prior says nothing. Multiply by 0.001 what is in "
        "millimetres.",
        "PosePrior: sigma_rotation is 16 rad, with which the prior says nothing. Multiply by pi / 180 what is in "
        "degrees.",
    ]
    caplog.clear()
    tp.PosePrior(X_PO, sigma_translation=1.0, sigma_rotation=math.pi)
    tp.PosePrior(X_PO, sigma_translation=1000.0, sigma_rotation=1000.0)  # Nothing is known.
    assert not caplog.records
