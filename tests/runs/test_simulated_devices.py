"""What simulated devices feel, made of the signals of a hand that was simulated before."""

import numpy as np

from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import fixed_pose
from tactopose_drake.runs.simulated_devices import SimulatedRig, simulated_loads
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.can_barrett_hand import PADS
from tactopose_drake.systems.signals import Signal
from tests import held_cube


def test_a_saturated_sensor_is_not_one_that_touches_nothing() -> None:
    F_S = held_cube.WRENCHES["thumb"]
    nothing = np.full(6, np.nan)
    felt = {f"wrench_{finger}": Signal([0.0], [np.zeros(6)]) for finger in held_cube.WRENCHES}
    felt["wrench_thumb"] = Signal([0.0, 0.1, 0.2, 0.3], [nothing, F_S, nothing, F_S])
    loads = simulated_loads(held_cube.scenario(), {"joint_positions": Signal([0.0], [held_cube.Q]), **felt})
    before, touched, beyond, again = (loads["thumb"].at(time) for time in (0.05, 0.15, 0.25, 0.35))
    np.testing.assert_allclose(touched - before, F_S)  # before its first sample it bears its fingertip alone
    assert np.isnan(beyond).all()
    np.testing.assert_array_equal(again, touched)


def test_pressures_go_on_while_the_joints_rest() -> None:
    scenario = load_scenario("barrett_like_can")
    plant, _ = make_hand_plant(load_hand_config(scenario.hand))
    cells = {pad: np.arange(24.0) + 100.0 * k for k, pad in enumerate(PADS)}
    signals = {"joint_positions": Signal([0.0, 0.5], [np.zeros(plant.num_positions())] * 2)}
    for k, (pad, pressures) in enumerate(cells.items()):
        times = [0.0, 0.6 + 0.1 * k, 1.2]
        signals[f"pressures_{pad}"] = Signal(times, [np.full(24, np.nan), pressures, 2.0 * pressures])
    loads = simulated_loads(scenario, signals)["hand"]
    for time in (-0.5, 0.55, 0.75, 1.1, 1.3):
        felt = loads.at(time)[7:103].reshape(4, 24)
        for k, (pad, pressures) in enumerate(cells.items()):
            factor = 2.0 if time > 1.2 else float(time > 0.6 + 0.1 * k)
            np.testing.assert_array_equal(felt[k], factor * pressures, err_msg=f"{pad} at {time} s")


def test_a_board_feels_the_touch_and_the_fingertip_s_weight_and_that_alone_before() -> None:
    scenario = held_cube.scenario()
    finger, touch = next(iter(scenario.senses.fingers)), np.array([0.01, 0.02, -0.01, 0.5, -2.0, 1.0])
    felt = {f"wrench_{name}": Signal([0.0, 0.5], [np.full(6, np.nan), touch]) for name in scenario.senses.fingers}
    loads = simulated_loads(scenario, {"joint_positions": Signal([0.0], [held_cube.Q]), **felt})
    plant, hand = make_hand_plant(scenario.hand_config())
    R_WBase = fixed_pose("Scenario.X_WBase", scenario.X_WBase).rotation()
    weight = FingertipWeights(plant, hand, R_WBase).wrenches(held_cube.Q)[finger]
    assert np.linalg.norm(weight[3:]) > 0.05
    for time, expected in ((-0.5, weight), (0.1, weight), (0.6, touch + weight)):
        np.testing.assert_allclose(loads[finger].at(time), expected, atol=1e-12)
    rig = SimulatedRig(scenario, loads)
    feel = rig._feel(loads[finger])
    np.testing.assert_allclose(feel(1e9), weight, atol=1e-12)  # Nothing begins before the origin is known.
    rig.origin = 1e9
    np.testing.assert_allclose(feel(1e9 + 0.6), touch + weight, atol=1e-12)
    np.testing.assert_allclose(feel(1e9 - 20.0), weight, atol=1e-12)
