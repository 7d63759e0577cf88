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
        ({"p_PC": [[0.0, math.nan, 0.0]]}, r"p_PC\[0, 1\] must be a finite number, not nan"),
        ({"p_PC": [[0.0, math.inf, 0.0]]}, r"p_PC\[0, 1\] must be .*, not inf"),
        ({"p_PC": [0.0, 0.0, 0.0]}, r"p_PC must have the shape \(n, 3\), not \(3,\)"),
        ({"p_PC": [["a", 0, 0]]}, "p_PC.* must (be a number|consist of numbers), not"),
        ({"p_PC": POINTS, "n_PC": NORMALS[:1]}, r"n_PC must have the shape \(2, 3\), not \(1, 3\)"),
        ({"p_PC": POINTS, "n_PC": NORMALS * 1.002}, r"n_PC\[0\] must have the length 1 within 0.001, not 1.002"),
        ({"p_PC": POINTS, "f_PC": NORMALS * math.nan}, r"f_PC\[0, 0\] must be .*, not nan"),
        ({"p_PC": POINTS, "sigma_position": 0.0}, "sigma_position must be a number > 0, not 0"),
        ({"p_PC": POINTS, "sigma_normal": [0.1, -0.1]}, r"sigma_normal\[1\] must be a number > 0, not -0.1"),
        ({"p_PC": POINTS, "sigma_force": 0.0}, "sigma_force must be a number > 0, not 0"),
        ({"p_PC": POINTS, "sigma_normal": [0.1]}, r"sigma_normal must have the shape \(\) or \(2,\), not \(1,\)"),
    ],
)
def test_bad_contacts_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Contacts(**arguments)  # type: ignore[arg-type]


def test_a_scan_s_points_are_too_many() -> None:
    assert len(Contacts(np.zeros((5000, 3)))) == 5000
    with pytest.raises(InvalidInputError, match=r"p_PC must have at most 5000 contacts, not 5001\."):
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
    second = contacts[1]
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


INDEFINITE = np.diag(np.repeat([8e-7, 0.0076], 3))
INDEFINITE[0, 1:3] = INDEFINITE[1:3, 0] = 1e-5


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.zeros((2, 6, 6)), r"covariance\[0\] must have a variance of the point above 0, not 0"),
        (np.eye(6), r"covariance must have the shape"),
        (np.triu(np.ones((2, 6, 6))), "covariance must be symmetric, not asymmetric by"),
        (np.full((2, 6, 6), np.nan), "covariance"),
        (np.tile(-np.eye(6), (2, 1, 1)), r"covariance\[0\] must have a variance of the point above 0, not -1"),
        (
            np.stack([1e-6 * np.eye(6), INDEFINITE]),
            r"covariance\[1\] must be positive semidefinite, but some combination of errors",
        ),
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


def some_contacts() -> Contacts:
    generator = np.random.default_rng(0)
    rows = generator.normal(size=(3, 4, 3))
    n = rows[1] / np.linalg.norm(rows[1], axis=1, keepdims=True)
    covariance = np.tile(np.diag([1e-6] * 3 + [1e-2] * 3), (4, 1, 1)) * np.arange(1.0, 5.0)[:, None, None]
    return Contacts(rows[0], n, rows[2], covariance=covariance)


def test_contacts_are_indexed_and_walked_through() -> None:
    contacts = some_contacts()
    assert contacts[:] == contacts  # to the last bit
    assert contacts[1] == contacts[[1]] == contacts[1:2]
    assert contacts[-1] == contacts[3]
    assert contacts[[2, 0]] == contacts[np.array([2, 0])] != contacts[[0, 2]]
    assert contacts[np.array([True, False, False, True])] == contacts[::3]
    assert [len(contact) for contact in contacts] == [1] * 4
    assert [contact.p_PC.tolist()[0] for contact in contacts] == contacts.p_PC.tolist()
    np.testing.assert_array_equal(contacts[2].covariance, contacts.covariance[2:3])
    assert list(Contacts.empty()) == []
    with pytest.raises(IndexError):
        contacts[4]
    with pytest.raises(ValueError, match="read-only"):
        contacts[1:].p_PC[0, 0] = 1.0


@pytest.mark.parametrize("index", [None, [[0, 1], [1, 0]], True])
def test_what_tells_no_contacts_apart_is_no_index(index: object) -> None:
    with pytest.raises(
        InvalidInputError, match=r"^index must be a number, a slice, numbers or a mask of length \d+, not "
    ):
        some_contacts()[index]  # type: ignore[index]


def test_contacts_are_no_array_of_points() -> None:
    with pytest.raises(InvalidInputError, match="Contacts are not an array; their points are p_PC"):
        Contacts(some_contacts())  # type: ignore[arg-type]


class Table(dict[str, list[object]]):
    """What pandas and Polars have in common."""

    @property
    def columns(self) -> list[str]:
        return list(self)


POINT_COLUMNS = {f"p_{axis}": POINTS[:, i].tolist() for i, axis in enumerate("xyz")}
NORMAL_COLUMNS = {f"n_{axis}": NORMALS[:, i].tolist() for i, axis in enumerate("xyz")}


def test_a_table_s_rows_are_contacts() -> None:
    more = {"finger": ["thumb", "first"], "sigma_normal": [0.1, 0.2]}
    contacts = Contacts.from_dataframe(Table(**NORMAL_COLUMNS, **POINT_COLUMNS, **more), sigma_position=0.002)
    assert contacts == Contacts(POINTS, NORMALS, sigma_position=0.002, sigma_normal=[0.1, 0.2])
    forces = {f"f_{axis}": [1.0, 2.0] for axis in "xyz"}
    assert Contacts.from_dataframe(Table(**POINT_COLUMNS, **forces)) == Contacts(POINTS, f_PC=[[1.0] * 3, [2.0] * 3])


def test_a_table_without_a_row_is_no_contact() -> None:
    columns: dict[str, list[object]] = {name: [] for name in (*POINT_COLUMNS, *NORMAL_COLUMNS, "sigma_position")}
    contacts = Contacts.from_dataframe(Table(**columns))
    assert len(contacts) == 0
    assert contacts == Contacts(np.zeros((0, 3)), np.zeros((0, 3)), sigma_position=[])


class Twice(Table):
    """A table one of whose columns is there twice, as where two were put together."""

    @property
    def columns(self) -> list[str]:
        return [*self, "p_y"]


class Lazy:
    """What Polars has of a table that is not computed yet."""

    columns = tuple(POINT_COLUMNS)


@pytest.mark.parametrize(
    ("frame", "sigmas", "message"),
    [
        (Twice(**POINT_COLUMNS), {}, "frame must have the column 'p_y' at most once, not 2 times"),
        (Lazy(), {}, "frame must be a table with named columns, such as a DataFrame, not a Lazy"),
        (Table(x=[0.0]), {}, "frame must have the columns p_x, p_y and p_z"),
        (POINT_COLUMNS, {}, "frame must be a table with .*, not a dict"),
        (
            Table(**POINT_COLUMNS, n_x=[1.0, 0.0]),
            {},
            "must have all of the columns n_x, n_y, n_z, or none, but lacks 'n_y'",
        ),
        (Table(**{**POINT_COLUMNS, "p_y": ["a", "b"]}), {}, r"p_PC.* must (be a number|consist of numbers), not"),
        (
            Table(**{**POINT_COLUMNS, "p_y": [0.0]}),
            {},
            r"frame must have as many rows in each of the columns p_x, p_y, p_z, not \[2, 1, 2\]",
        ),
        (
            Table(**POINT_COLUMNS, n_x=[1.0], n_y=[0.0], n_z=[0.0]),
            {},
            r"n_PC must have the shape \(2, 3\), not \(1, 3\)",
        ),
        (
            Table(**POINT_COLUMNS, sigma_position=[0.1, 0.1]),
            {"sigma_position": 0.1},
            "sigma_position must be an argument or a column of the table, not both",
        ),
    ],
)
def test_a_table_without_what_is_needed_is_refused(frame, sigmas: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Contacts.from_dataframe(frame, **sigmas)


@pytest.mark.parametrize("name", ["sigma_position", "sigma_normal", "sigma_force"])
@pytest.mark.parametrize("value", [Contacts(POINTS), None, "1", [[0.1], [0.1]], np.ones(3)])
def test_a_sigma_that_is_no_numbers_of_the_contacts_is_refused(name: str, value: object) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{name} must "):
        Contacts(POINTS, **{name: value})  # type: ignore[arg-type]


def test_a_covariance_that_is_too_small_is_called_so() -> None:
    with pytest.raises(
        InvalidInputError, match=r"^covariance: its sigma_position.* must be a number from .* m, not 3.16228e-08\.$"
    ):
        Contacts(POINTS, NORMALS, covariance=np.tile(np.diag([1e-15] * 3 + [0.01] * 3), (2, 1, 1)))


@pytest.mark.parametrize("index", [1.5, "a", [True], [0.5], None, 10**400, [[0, 1]], Contacts(POINTS), (0, 1)])
def test_what_is_no_index_is_named(index: object) -> None:
    with pytest.raises(InvalidInputError, match=r"^index must be a number, .* or a mask of length 2, not"):
        Contacts(POINTS)[index]  # type: ignore[index]


@pytest.mark.parametrize("index", [2, -3, [0, 2]])
def test_numbers_beyond_the_last_contact_are_those_of_any_sequence(index: object) -> None:
    with pytest.raises(IndexError, match="out of bounds"):
        Contacts(POINTS)[index]  # type: ignore[index]


def test_a_sigma_of_normals_that_is_probably_in_degrees_is_remarked_once(caplog: pytest.LogCaptureFixture) -> None:
    points, normals = np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    for _ in range(2):
        Contacts(points, normals, sigma_normal=[0.1, 7.5])
    assert [record.getMessage() for record in caplog.records] == [
        "Contacts: sigma_normal is 7.5 rad, with which normals say nothing. Multiply by pi / 180 what is in degrees, "
        "or leave out n_PC."
    ]
    caplog.clear()
    Contacts(points, normals, sigma_normal=math.pi)
    Contacts(points, normals, sigma_normal=1e6)
    Contacts(points, None, sigma_normal=7.25)
    Contacts(points[:0], normals[:0], sigma_normal=7.0)
    assert not caplog.records
