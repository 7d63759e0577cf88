"""The Cramer-Rao bound of a hand's errors, given its grasps.

Each contact's distance from the surface and its normal give information on the object's pose in that grasp and on the
hand. The unknown poses are eliminated from the information (by the Schur complement), and that of the errors' prior is
added: the inverse is the least covariance that an estimate can have on average over such hands [VT68].

Source: [VT68] H. Van Trees, Detection, Estimation, and Modulation Theory, part I, 1968, section 2.4.3.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.calibration import ContactNoise, surface_rows
from tactopose_drake.hand import ClosedGrasp, FeltGrasps, Hand, HandErrors


def least_covariance(
    plant: MultibodyPlant,
    hand: Hand,
    errors: HandErrors,
    truth: np.ndarray,
    grasps: Sequence[ClosedGrasp],
    noise: tuple[float, float],
    *,
    poses_known: bool = False,
) -> np.ndarray:
    """The bound for all errors, shape (d, d), SI units; zero for those that are not estimated.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        errors: the errors that it may have.
        truth: their true values, shape (d,), SI units.
        grasps: the grasps of the calibration, with the true poses of the object.
        noise: noise of contacts in addition to the sensors': along the normal, m, and of the normal about each axis,
            rad.
        poses_known: whether the object's poses are known.
    """
    recorded = [grasp.recorded for grasp in grasps]
    felt, free = FeltGrasps(plant, hand, errors, recorded), errors.free
    touches = felt.touches(truth[free] / errors.sigma[free])
    grids, X_PO = [grasp.model.grid for grasp in recorded], np.array([grasp.X_PO for grasp in grasps])
    rows = surface_rows(grids, X_PO, touches, ContactNoise(felt.wrench_noise(), *noise).total)
    readings, _ = felt.readings(recorded)
    information = np.eye(len(free)) + readings.T @ readings
    for g in range(len(grasps)):
        own = touches.valid & (touches.grasp == g)
        by_hand, by_pose = rows.by_shared[own].reshape(-1, len(free)), rows.by_pose[own].reshape(-1, 6)
        if not poses_known:
            by_hand = by_hand - by_pose @ np.linalg.lstsq(by_pose, by_hand, rcond=None)[0]
        information += by_hand.T @ by_hand
    covariance = np.zeros((len(errors.sigma), len(errors.sigma)))
    covariance[np.ix_(free, free)] = np.linalg.inv(information) * np.outer(errors.sigma[free], errors.sigma[free])
    return covariance
