"""Converts patches to contacts with normals, from which a search proposes poses that the cells then refine."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import skew
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import FloatArray, positive_number

# Standard deviation of the normal of a contact without one, rad, and the one from which on a normal carries nothing.
_ANY_NORMAL, _LEAST_ANY = 1e3, math.pi
# Least standard deviations of a pad's position and orientation, m and rad.
_LEAST_PLACE, _LEAST_TURN = 1e-5, 1e-4


def patch_contacts(
    patches: Sequence[Patch],
    *,
    sigma_depth: float = 0.0005,
    sigma_position: float = 0.0009,
    sigma_rotation: float = math.radians(5.0),
    sigma_lean: float = math.radians(30.0),
) -> Contacts:
    """One contact for each pad that feels the object: the patch's centroid and the surface's normal there.

    If the patch is an area, the normal is its third eigenvector. The errors sigma_depth of its m cells rotate it about
    the first axis, across which the patch is narrow, by sigma_depth / sqrt(m lambda_2); the pad itself is rotated by
    sigma_rotation. Otherwise the normal is the pad's, within sigma_lean. For cells that face all directions, point and
    normal are those of the cell that is pressed most. If a patch gives its misplacement, its mean standard deviations
    replace sigma_position and sigma_rotation.

    Args:
        patches: what the pads feel, in P.
        sigma_depth: standard deviation of the depth of the surface in a pad, of each cell, m.
        sigma_position: standard deviation of each coordinate of a pad's position, m.
        sigma_rotation: standard deviation of a small rotation of a pad about each axis, rad.
        sigma_lean: standard deviation of the tilt of a touched surface from the pad about each axis, rad.

    Raises:
        InvalidInputError: a sigma that is not positive.
    """
    positive_number("sigma_depth", sigma_depth)
    positive_number("sigma_rotation", sigma_rotation)
    felt = [patch for patch in patches if patch.is_felt]
    points, normals = np.empty((len(felt), 3)), np.empty((len(felt), 3))
    sigmas = np.full(len(felt), positive_number("sigma_lean", sigma_lean))
    places = np.full(len(felt), positive_number("sigma_position", sigma_position))
    for i, patch in enumerate(felt):
        points[i], turned = patch.centroid, sigma_rotation
        if patch.misplacement is not None:
            places[i], turned = _mean_sigmas(patch, patch.misplacement)
        if patch.status == "area":
            normals[i] = patch.eigenvectors[:, 2]
            bend = sigma_depth / math.sqrt(np.count_nonzero(patch.active) * patch.eigenvalues[1])
            sigmas[i] = min(math.hypot(bend, turned), sigma_lean)
        elif np.isfinite(patch.inward).all():
            normals[i] = patch.inward
        else:
            most = int(np.nanargmax(patch.pressure))
            points[i], normals[i] = patch.points[most], -patch.n_PT[most]
    return Contacts(points, normals, sigma_normal=sigmas).with_arrays(sigma_position=places)


def _mean_sigmas(patch: Patch, misplacement: FloatArray) -> tuple[float, float]:
    """Mean standard deviations of the patch's centroid along each axis, m, and of a rotation about each axis, rad."""
    by_turn = np.hstack([np.eye(3), -skew(patch.centroid - patch.p_PT.mean(axis=0))])
    place, turn = np.trace(by_turn @ misplacement @ by_turn.T), np.trace(misplacement[3:, 3:])
    return max(math.sqrt(place / 3.0), _LEAST_PLACE), max(math.sqrt(turn / 3.0), _LEAST_TURN)


def with_patches(contacts: Contacts, patches: Sequence[Patch]) -> Contacts:
    """The contacts followed by those of the patches: all that is touched, without forces.

    If only some have normals, the others get arbitrary ones with a sigma that gives them no weight.
    """
    if not any(patch.is_felt for patch in patches):
        return contacts
    felt = patch_contacts(patches)
    if len(contacts) == 0:
        return felt
    assert felt.n_PC is not None
    n_PC, sigma_normal = contacts.n_PC, np.asarray(contacts.sigma_normal)
    if n_PC is None:
        n_PC, sigma_normal = np.tile(np.eye(3)[2], (len(contacts), 1)), np.full(len(contacts), _ANY_NORMAL)
    own = contacts.with_arrays(n_PC=n_PC, f_PC=None, sigma_normal=sigma_normal, covariance=None)
    return own.joined(felt)


def tell_normals(touch: Contacts) -> NDArray[np.bool_]:
    """Whether each contact's normal is informative, shape (k,): measured, and not arbitrary as in `with_patches`."""
    if touch.n_PC is None:
        return np.zeros(len(touch), dtype=np.bool_)
    tell: NDArray[np.bool_] = np.broadcast_to(touch.sigma_normal, len(touch)) < _LEAST_ANY
    return tell
