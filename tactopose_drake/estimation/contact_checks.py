"""Plausibility checks of contacts before a pose is searched for."""

import math

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.errors import InvalidInputError

# Contacts farther apart than a hand reaches, m, and than this multiple of the object's size, are not in metres.
_WIDEST_HAND, _WIDEST_TOUCH = 1.0, 30.0


def check_contacts(evidence: Evidence, size: float) -> None:
    """Checks the units and signs of a touch on an object of this size, m.

    Raises:
        InvalidInputError: if the contacts are farther apart than both 1 m and 30 times the size, or if most contacts
            with a force pull at the object, according to their normals.
    """
    _check_signs(evidence.contacts)
    p_PC = evidence.touch.p_PC
    apart = math.dist(p_PC.max(axis=0), p_PC.min(axis=0))
    widest = max(_WIDEST_HAND, _WIDEST_TOUCH * size)
    if apart > widest:
        raise InvalidInputError(
            f"contacts must be at most {widest:.3g} m apart on an object of {size:.3g} m, not {apart:.4g} m. Multiply "
            "by 0.001 what is in millimetres."
        )


def _check_signs(contacts: Contacts) -> None:
    if contacts.f_PC is None or contacts.n_PC is None:
        return
    has_force = np.linalg.norm(contacts.f_PC, axis=1) > 3.0 * contacts.sigma_force
    pulls = has_force & (np.einsum("ij,ij->i", contacts.f_PC, contacts.n_PC) < 0.0)
    if 2 * np.count_nonzero(pulls) > np.count_nonzero(has_force):
        which = ", ".join(map(str, np.flatnonzero(pulls)))
        raise InvalidInputError(
            "contacts must have forces f_PC on the fingertips along normals n_PC out of the object, not against them "
            f"as in {which}, counted from 0, which would pull at the object."
        )
