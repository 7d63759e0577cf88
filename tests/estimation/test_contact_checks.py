"""What is refused of contacts before any pose is looked for, and what is not."""

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.contact_checks import check_contacts

NORMALS = np.tile([0.0, 0.0, 1.0], (4, 1))


def pressing(*forces: float) -> Evidence:
    points = np.diag([0.01, 0.02, 0.03, 0.04])[:, :3]
    f_PC = np.array(forces)[:, None] * NORMALS
    return Evidence(Contacts(points, NORMALS, f_PC, sigma_force=0.1))


def test_forces_are_of_the_wrong_sign_where_more_than_half_of_those_that_are_felt_pull() -> None:
    check_contacts(pressing(-1.0, -1.0, 1.0, 1.0), 0.1)
    with pytest.raises(
        InvalidInputError, match=r"^contacts must have forces f_PC .*, not against them as in 0, 1, 3, counted from 0"
    ):
        check_contacts(pressing(-1.0, -1.0, 1.0, -1.0), 0.1)


def test_a_force_within_three_sigmas_of_none_is_of_no_sign() -> None:
    check_contacts(pressing(-0.29, -0.29, -0.29, 1.0), 0.1)
    with pytest.raises(InvalidInputError, match="not against them as in 0, 1, 2"):
        check_contacts(pressing(-0.31, -0.31, -0.31, 1.0), 0.1)


@pytest.mark.parametrize(("size", "most"), [(0.02, 1.0), (0.1, 3.0)])
def test_contacts_are_as_far_apart_as_a_hand_reaches_or_thirty_objects(size: float, most: float) -> None:
    def apart(distance: float) -> Evidence:
        return Evidence(Contacts([[0.0, 0.0, 0.0], [0.6 * distance, 0.0, 0.8 * distance]]))

    check_contacts(apart(0.999 * most), size)
    with pytest.raises(InvalidInputError, match=rf"m apart on an object of {size:g} m"):
        check_contacts(apart(1.001 * most), size)
