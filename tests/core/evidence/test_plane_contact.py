import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.errors import InvalidInputError

UP = [0.0, 0.0, 1.0]


def test_a_plane_is_kept_as_it_was_given() -> None:
    normal = np.array([0.0, 0.0, 1.0005])
    plane = PlaneContact(np.array([0.1, 0.0, -0.2]), normal, sigma=0.002)
    normal[:] = 0.0
    np.testing.assert_allclose(plane.n_P, UP)
    assert plane == PlaneContact.from_dict(plane.to_dict())
    with pytest.raises(ValueError, match="read-only"):
        plane.p_PQ[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"p_PQ": [0.0, 0.0, 150.0]}, "p_PQ"),
        ({"p_PQ": [0.0, 0.0, np.nan]}, "p_PQ"),
        ({"n_P": [0.0, 0.0, 2.0]}, "n_P"),
        ({"sigma": 0.0}, "sigma"),
    ],
)
def test_bad_planes_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        PlaneContact(**({"p_PQ": [0.0, 0.0, 0.0], "n_P": UP} | arguments))  # type: ignore[arg-type]


def test_evidence_takes_planes_and_nothing_else() -> None:
    contacts, plane = Contacts(np.zeros((1, 3))), PlaneContact([0.0, 0.0, 0.0], UP)  # type: ignore[arg-type]
    assert Evidence(contacts, planes=[plane]).planes == (plane,)
    with pytest.raises(InvalidInputError, match=r"planes\[0\] must be a PlaneContact, not a Contacts"):
        Evidence(contacts, planes=[contacts])  # type: ignore[list-item]
    with pytest.raises(InvalidInputError, match="planes must be a sequence of PlaneContact, not a PlaneContact"):
        Evidence(contacts, planes=plane)  # type: ignore[arg-type]
