"""The least that grasps leave unknown of a hand's errors, whatever estimates them: the Cramer-Rao bound.

Each contact's distance from the surface and its normal tell of the object's pose in that grasp and of the hand. Of the
information about the hand the part goes that the unknown poses take (the Schur complement), and what was known of the
errors before is added: the inverse is the least covariance that an estimate may have on average over such hands [VT68].

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
    """The bound for all errors, shape (d, d), SI units; zero for those that are not looked for.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        errors: which errors it may have.
        truth: those that it has, shape (d,), SI units.
        grasps: what it is calibrated with, and where the object truly was.
        noise: of contacts beside the sensors', along the normal and of the normal about each axis, m and rad.
        poses_known: whether somebody says where the object is.
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
