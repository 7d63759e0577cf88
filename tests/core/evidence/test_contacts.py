import copy
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import random_rotations
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


def test_a_scan_s_points_are_too_many() -> None:
    assert len(Contacts(np.zeros((5000, 3)))) == 5000
    with pytest.raises(InvalidInputError, match=r"p_PC: are 5001 contacts; allowed are up to 5000\."):
        Contacts(np.zeros((5001, 3)))


@pytest.mark.parametrize("again", [copy.deepcopy, lambda contacts: pickle.loads(pickle.dumps(contacts))])
def test_copies_are_equal_and_read_only(again: Callable[[Contacts], Contacts]) -> None:
    contacts = Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]])
    copied = again(contacts)
    for name in ("p_PC", "n_PC", "sigma_position", "sigma_normal"):
        np.testing.assert_array_equal(getattr(copied, name), getattr(contacts, name))
        assert not getattr(copied, name).flags.writeable


def test_a_covariance_says_how_far_a_contact_is_off_across_the_surface_and_its_normal() -> None:
    n_PC = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    covariance = np.zeros((2, 6, 6))
    covariance[:, range(6), range(6)] = [4e-6, 9e-6, 1e-6, 0.01, 0.03, 0.5]
    covariance[:, 0, 4] = covariance[:, 4, 0] = 1e-5
    contacts = Contacts(np.zeros((2, 3)), n_PC, covariance=covariance)
    along = np.array([1e-6, 0.36 * 4e-6 + 0.64 * 1e-6])
    np.testing.assert_allclose(contacts.sigma_position, np.sqrt(along))
    turned = np.array([0.02, 0.5 * (0.54 - 0.36 * 0.01 - 0.64 * 0.5)])
    np.testing.assert_allclose(contacts.sigma_normal, np.sqrt(turned))
    assert not contacts.covariance.flags.writeable
    second = contacts.chosen(np.array([1]))
    np.testing.assert_array_equal(second.covariance, covariance[1:])
    np.testing.assert_array_equal(second.sigma_normal, contacts.sigma_normal[1:])
    without = Contacts(np.zeros((2, 3)), covariance=covariance)
    np.testing.assert_allclose(without.sigma_position, np.sqrt(14e-6 / 3.0))


def test_a_turn_of_the_palm_changes_nothing_of_a_covariance() -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(4, 6, 6))
    covariance = 1e-6 * root @ np.swapaxes(root, 1, 2)
    n_PC = generator.normal(size=(4, 3))
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    R = random_rotations(generator, 1)[0]
    both = np.kron(np.eye(2), R)
    here = Contacts(np.zeros((4, 3)), n_PC, covariance=covariance)
    there = Contacts(np.zeros((4, 3)), n_PC @ R.T, covariance=both @ covariance @ both.T)
    np.testing.assert_allclose(there.sigma_position, here.sigma_position, rtol=1e-9)
    np.testing.assert_allclose(there.sigma_normal, here.sigma_normal, rtol=1e-9)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.zeros((2, 6, 6)), r"covariance\[0\]: says 0 of the point"),
        (np.eye(6), r"covariance: .*shape"),
        (np.triu(np.ones((2, 6, 6))), "covariance: is not symmetric"),
        (np.full((2, 6, 6), np.nan), "covariance"),
        (np.tile(-np.eye(6), (2, 1, 1)), r"covariance\[0\]: says -1 of the point"),
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Contacts(np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1)), covariance=covariance)


def test_joined_contacts_keep_what_both_have() -> None:
    p, n = np.arange(6.0).reshape(2, 3), np.tile([[0.0, 0.0, 1.0]], (2, 1))
    first = Contacts(p, n, 2.0 * n, sigma_position=[0.001, 0.002])
    second = Contacts(p[:1] + 0.5, -n[:1], sigma_position=0.003, sigma_normal=0.2)
    both = first.joined(second)
    np.testing.assert_allclose(both.p_PC, [*p, p[0] + 0.5])
    assert both.n_PC is not None
    np.testing.assert_allclose(both.n_PC, [*n, -n[0]])
    assert both.f_PC is None, "the second has no forces"
    np.testing.assert_allclose(both.sigma_position, [0.001, 0.002, 0.003])
    np.testing.assert_allclose(both.sigma_normal, [np.radians(5.0), np.radians(5.0), 0.2])
    again = first.joined(first)
    assert again.f_PC is not None
    np.testing.assert_allclose(again.f_PC, 2.0 * np.tile(n, (2, 1)))
    assert first.joined(Contacts(p[:1])).n_PC is None
    known = Contacts(p, n, covariance=np.tile(np.diag([1e-6] * 3 + [0.01] * 3), (2, 1, 1)))
    assert known.joined(first).covariance is None
    assert known.joined(known).covariance is not None
