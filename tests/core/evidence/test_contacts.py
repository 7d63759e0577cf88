import copy
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.errors import InvalidInputError

POINTS = np.array([[0.0, 0.0, 0.1], [0.02, 0.0, 0.1]])
NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def test_sigmas_are_spread_over_the_contacts() -> None:
    contacts = Contacts(POINTS, NORMALS, sigma_position=[0.001, 0.002])
    np.testing.assert_array_equal(contacts.sigma_position, [0.001, 0.002])
    np.testing.assert_array_equal(contacts.sigma_normal, math.radians(5.0))
    assert len(contacts) == 2
    assert len(Contacts.empty()) == 0


def test_a_normal_is_normalised_exactly() -> None:
    contacts = Contacts(POINTS, NORMALS * 1.0005)
    assert contacts.n_PC is not None
    np.testing.assert_allclose(np.linalg.norm(contacts.n_PC, axis=1), 1.0, rtol=1e-15)


def test_contacts_cannot_be_changed_from_outside() -> None:
    points = POINTS.copy()
    contacts = Contacts(points)
    points[:] = 7.0
    np.testing.assert_array_equal(contacts.p_PC, POINTS)
    with pytest.raises(ValueError, match="read-only"):
        contacts.p_PC[0, 0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"p_PC": [[0.0, math.nan, 0.0]]}, r"p_PC\[0, 1\]: is nan; allowed are finite numbers"),
        ({"p_PC": [[0.0, math.inf, 0.0]]}, r"p_PC\[0, 1\]: is inf"),
        ({"p_PC": [0.0, 0.0, 0.0]}, r"p_PC: has shape \(3,\); allowed is \(n, 3\)"),
        ({"p_PC": [["a", 0, 0]]}, "p_PC: not an array of numbers"),
        ({"p_PC": POINTS, "n_PC": NORMALS[:1]}, r"n_PC: has shape \(1, 3\); allowed is \(2, 3\)"),
        ({"p_PC": POINTS, "n_PC": NORMALS * 1.002}, r"n_PC\[0\]: has length 1.002; allowed is 1 within 0.001"),
        ({"p_PC": POINTS, "f_PC": NORMALS * math.nan}, r"f_PC\[0, 0\]: is nan"),
        ({"p_PC": POINTS, "sigma_position": 0.0}, "sigma_position: is 0; allowed are numbers > 0"),
        ({"p_PC": POINTS, "sigma_normal": [0.1, -0.1]}, "sigma_normal: is -0.1; allowed are numbers > 0"),
        ({"p_PC": POINTS, "sigma_force": 0.0}, "sigma_force: is 0; allowed are numbers > 0"),
        ({"p_PC": POINTS, "sigma_normal": [0.1]}, r"sigma_normal: has shape \(1,\); allowed is \(2,\)"),
    ],
)
def test_bad_contacts_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Contacts(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda contacts: pickle.loads(pickle.dumps(contacts))])
def test_copies_are_equal_and_read_only(again: Callable[[Contacts], Contacts]) -> None:
    contacts = Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]])
    copied = again(contacts)
    for name in ("p_PC", "n_PC", "sigma_position", "sigma_normal"):
        np.testing.assert_array_equal(getattr(copied, name), getattr(contacts, name))
        assert not getattr(copied, name).flags.writeable
