"""A Shadow-like hand that holds the cube, in numbers: the end of a simulated grasp.

`simulate_grasp` of the scenario `shadow_like` with the object `cube`, `planner.grasps` 2, seed 0. With these numbers a
test has a hand full of touch without a simulation.
"""

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.station.can_senses import CanBus, CanSenses, ForceTorqueBoard
from tactopose_drake.station.scenario import Scenario, load_scenario

Q = np.array([
    -0.00335, -0.0, -0.18387, -0.20276, 0.83899, 0.83899, 0.23615, -0.17099, 0.84764, 0.84763, -0.23259, -0.21845,
    1.48133, 1.48133, 0.62215, -0.21607, -0.19152, 0.96811, 0.96811, 0.42633, 1.09017, 0.05193, -0.09923, 1.1281,
])  # fmt: skip
X_PO = np.array([
    [0.01511, 0.00452, 0.99988, -0.00808],
    [-0.75939, -0.65048, 0.01441, -0.04932],
    [0.65046, -0.75951, -0.0064, 0.12423],
])  # fmt: skip
WRENCHES = {
    "first": np.array([-0.03985, 0.00134, 0.003, -0.01085, 2.53864, -1.21149]),
    "middle": np.array([-0.03651, 0.00968, 0.00055, 0.5603, 2.12668, -0.71627]),
    "ring": np.array([-0.0039, -0.00926, 0.00159, -0.54277, 0.24468, 0.07206]),
    "little": np.array([-0.00948, -0.03811, 0.00331, -2.39868, 0.53632, -0.73682]),
    "thumb": np.array([-0.00018, 0.01233, 0.0027, 1.91759, 0.98343, -4.38491]),
}
BASES = {finger: 0x20 + k for k, finger in enumerate(WRENCHES)}


def prior(offset: FloatArray | None = None) -> PosePrior:
    """What a camera might say: the true pose, a little off."""
    U, _, Vt = np.linalg.svd(X_PO[:, :3])
    p_PO = X_PO[:, 3] + (np.array([0.008, -0.005, 0.006]) if offset is None else offset)
    return PosePrior(np.column_stack([U @ Vt, p_PO]), sigma_translation=0.02, sigma_rotation=0.2)


def scenario(**senses) -> Scenario:
    """Five boards on one bus, `main`; the estimate ten times a second."""
    scenario = load_scenario("shadow_like")
    scenario.object = "cube"
    scenario.senses = CanSenses(
        buses={"main": CanBus(interface="virtual", channel="held cube")},
        fingers={finger: ForceTorqueBoard(bus="main", base=base) for finger, base in BASES.items()},
        **senses,
    )
    return scenario
