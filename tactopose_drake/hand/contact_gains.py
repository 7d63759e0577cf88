"""Derivatives of a fingertip's contact by its wrench and by the fingertip's radius."""

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, ContactSolutions, solve_contacts
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Ellipsoid, Superquadric, Surface
from tactopose_drake.core.validation import FloatArray

# Steps of the finite differences: of the moment, N m, of the force, N, and of the radius, m.
_STEPS = np.repeat([1e-7, 1e-5], 3)
_RADIUS_STEP = 1e-7


class ContactGains(NamedTuple):
    """Contacts of k wrenches on one fingertip, in S, and their derivatives.

    Attributes:
        solutions: the contacts.
        point: derivative of the point by the wrench (6 columns) and the radius (1 column), shape (k, 3, 7).
        turn: likewise of a small rotation of the normal, shape (k, 3, 7).
    """

    solutions: ContactSolutions
    point: FloatArray
    turn: FloatArray


def contact_gains(F_S: FloatArray, surface: Surface, layer: SoftLayer | None) -> ContactGains:
    """Solves for the contacts of wrenches and their derivatives by finite differences.

    A derivative is zero if a perturbed wrench gives no contact.

    Args:
        F_S: wrenches [m, f], shape (k, 6), N m and N.
        surface: the fingertip's surface.
        layer: its soft layer, if there is one.
    """
    steps = np.concatenate([np.zeros((1, 6)), np.diag(_STEPS), -np.diag(_STEPS)])
    solved = solve_contacts((F_S[:, None] + steps).reshape(-1, 6), surface, layer=layer)
    p, n = (rows.reshape(len(F_S), 13, 3) for rows in (solved.p_SC, solved.n_S))
    by_wrench = [np.swapaxes(rows[:, 1:7] - rows[:, 7:], 1, 2) / (2.0 * _STEPS) for rows in (p, n)]
    sides = [solve_contacts(F_S, thicker(surface, step), layer=layer) for step in (_RADIUS_STEP, -_RADIUS_STEP)]
    by_radius = [
        (getattr(sides[0], name) - getattr(sides[1], name))[..., None] / (2.0 * _RADIUS_STEP)
        for name in ("p_SC", "n_S")
    ]
    point, normal = (np.concatenate(both, axis=2) for both in zip(by_wrench, by_radius, strict=True))
    turn = np.cross(n[:, 0, None], np.swapaxes(normal, 1, 2))
    solutions = ContactSolutions(*(getattr(solved, field.name)[::13] for field in dataclasses.fields(solved)))
    return ContactGains(solutions, np.nan_to_num(point), np.nan_to_num(np.swapaxes(turn, 1, 2)))


def thicker(surface: Surface, by: float) -> Surface:
    """The surface with its radius or semi-axes increased by `by`, m."""
    if isinstance(surface, Ellipsoid | Superquadric):
        a, b, c = surface.semi_axes
        return dataclasses.replace(surface, semi_axes=(a + by, b + by, c + by))
    return dataclasses.replace(surface, radius=surface.radius + by)  # type: ignore[attr-defined,call-arg]


def wrench_of(solution: ContactSolution) -> FloatArray:
    """The wrench [m, f] from which a contact was solved, shape (6,), N m and N."""
    force = solution.normal_force + solution.friction_force
    return np.concatenate([np.cross(solution.p_SC, force) + solution.local_torque, force])
