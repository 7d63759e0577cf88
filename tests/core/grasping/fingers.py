"""A finger of three joints, as what reaches with one is tested."""

import numpy as np

from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.serial_chain import SerialChain

RADIUS = 0.009  # of its tip, m


def translation(x: float, y: float, z: float) -> np.ndarray:
    return np.hstack([np.eye(3), [[x], [y], [z]]])


def make_finger() -> FingerGeometry:
    """Abduction and two flexions about x, like a finger's; zero is straight up along z, it closes towards -y."""
    chain = SerialChain(
        np.stack([translation(0, 0, 0), translation(0, 0, 0), translation(0, 0, 0.045)]),
        np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        np.stack([np.eye(3, 4)] * 3),
        np.eye(3),
        translation(0, 0, 0.03),
        np.array([-0.4, -0.3, 0.0]),
        np.array([0.4, 1.6, 1.6]),
        ("knuckle", "proximal", "distal"),
    )
    bones = np.array([[0.0, 0.0, 0.015], [0.0, 0.0, 0.03], [0.0, 0.0, 0.005]])
    return FingerGeometry(chain, np.array([0.0, 0.0, 0.014]), RADIUS, np.array([1, 1, 2]), bones, np.full(3, 0.007))
