"""A Barrett-like hand that holds the can, in numbers: the end of a simulated grip.

`rehearse` of the scenario `barrett_like_can`, seed 0. With these numbers a test has pads full of touch without a
simulation.
"""

import numpy as np

from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.station.can_senses import CanBus
from tactopose_drake.station.scenario import Scenario, load_scenario

JOINT_POSITIONS = np.array([1.63849, 1.7677, 1.66046, 0.54615, 0.58922, 0.55347, 0.0007])  # as `barrett_joints.JOINTS`
PRESSURES = 100.0 * np.array([
    [64, 91, 118, 368, 415, 441, 315, 337, 343, 27, 28, 28, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0, 23, 214, 0, 38, 356, 0, 29, 270, 0, 7, 58, 0, 0, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0],
    [2, 4, 5, 49, 68, 88, 354, 397, 420, 288, 306, 311, 22, 24, 25, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [19, 12, 11, 4, 0, 403, 392, 384, 364, 139, 3, 0, 43, 61, 85, 108, 42, 1, 0, 2, 2, 4, 1, 0],
])  # fmt: skip
ROW = np.concatenate([JOINT_POSITIONS, PRESSURES.ravel(), np.zeros(3)])  # of a `HandState`
X_PO = np.array([
    [0.00031, -0.06205, 0.99807, -0.01923],
    [0.00809, 0.99804, 0.06205, 0.00179],
    [-0.99997, 0.00805, 0.00081, 0.10959],
])  # fmt: skip


def prior() -> PosePrior:
    """What a camera might say: the true pose, a little off."""
    U, _, Vt = np.linalg.svd(X_PO[:, :3])
    p_PO = X_PO[:, 3] + np.array([0.008, -0.005, 0.006])
    return PosePrior(np.column_stack([U @ Vt, p_PO]), sigma_translation=0.02, sigma_rotation=0.2)


def scenario() -> Scenario:
    """The hand on a bus, `main`."""
    scenario = load_scenario("barrett_like_can")
    scenario.senses.buses = {"main": CanBus(interface="virtual", channel="held can")}
    scenario.senses.barrett_hand.bus = "main"
    return scenario
