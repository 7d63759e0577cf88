"""Errors of a pose: how well it explains the touch, and how far it is from the true pose.

Source: [B16] J. Bimbo, thesis, 2016, section 3.3.1.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, number_array


class TouchErrors(NamedTuple):
    """How far poses are from explaining a touch; this needs no ground truth.

    Attributes:
        MDTS: mean distance of the contacts to the surface, shape (B,), m.
        MATN: mean angle between the measured normals and the surface's, shape (B,), rad; NaN without normals.
    """

    MDTS: FloatArray
    MATN: FloatArray


class TruthErrors(NamedTuple):
    """How far poses displace the touched points of the object from their true places.

    Attributes:
        RME: real mean error: mean distance of the touched points from their true places, shape (B,), m.
        MAE: mean angle error of the normals there, shape (B,), rad.
    """

    RME: FloatArray
    MAE: FloatArray


def touch_errors(model: ObjectModel, contacts: Contacts, X_PO: FloatArray) -> TouchErrors:
    """Compares a touch with the object's surface at poses (B, 3, 4).

    Raises:
        InvalidInputError: if the poses are of another shape, or do not consist of numbers.
    """
    X_PO = pose_batch(X_PO)
    R_PO = X_PO[:, :, :3]
    distance, n_O = model.grid.distance_and_normal((contacts.p_PC - X_PO[:, None, :, 3]) @ R_PO)
    MDTS = np.abs(distance).mean(axis=1)
    if contacts.n_PC is None:
        return TouchErrors(MDTS, np.full(len(X_PO), np.nan))
    return TouchErrors(MDTS, angles_between(contacts.n_PC @ R_PO, n_O).mean(axis=1))


def truth_errors(p_OC: FloatArray, n_OC: FloatArray, X_PO_true: FloatArray, X_PO: FloatArray) -> TruthErrors:
    """Compares where the true pose (3, 4) and poses (B, 3, 4) put points p_OC (k, 3) and normals n_OC (k, 3) of O.

    Raises:
        InvalidInputError: if an array is of another shape, or does not consist of numbers.
    """
    p_OC = number_array("p_OC", p_OC, (None, 3))
    n_OC = number_array("n_OC", n_OC, p_OC.shape)
    X_PO_true, X_PO = number_array("X_PO_true", X_PO_true, (3, 4)), pose_batch(X_PO)
    true_points = p_OC @ X_PO_true[:, :3].T + X_PO_true[:, 3]
    points = p_OC @ np.swapaxes(X_PO[:, :, :3], 1, 2) + X_PO[:, None, :, 3]
    angles = angles_between(n_OC @ np.swapaxes(X_PO[:, :, :3], 1, 2), n_OC @ X_PO_true[:, :3].T)
    return TruthErrors(np.linalg.norm(points - true_points, axis=-1).mean(axis=1), angles.mean(axis=1))


def angles_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between unit vectors (..., 3), rad, exact near zero too."""
    angles: FloatArray = 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angles
