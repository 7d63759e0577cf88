"""What the belief says while the sensors of a hand drop out: from wrenches and joints, the whole diagram."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems.pose_tracking import MakePoseTracking, PoseTrackingParams
from tests import held_cube
from tests.systems.belief_runs import Run, Signal


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


class HeldCube:
    """The belief from wrenches and joints of a hand that holds the cube; some fingers fail for a time."""

    def __init__(self, cube: ObjectModel, failing: tuple[str, ...], value: float = np.nan) -> None:
        names = tuple(held_cube.WRENCHES)
        signals: dict[str, Signal] = {}
        for i, finger in enumerate(names):
            signals[f"wrench_{finger}"] = self._wrench(finger, i, finger in failing, value)
        joints = np.full(24, value) if "joints" in failing else held_cube.Q
        signals["joint_positions"] = lambda time: joints.copy() if self.fails(time) else held_cube.Q.copy()
        signals["joint_velocities"] = lambda time: np.zeros(24)
        signals["vision"] = lambda time: held_cube.prior()
        self.run = Run(MakePoseTracking(load_hand_config("shadow_like"), cube), **signals)

    @staticmethod
    def fails(time: float) -> bool:
        return 0.205 < time < 1.505

    def _wrench(self, finger: str, seed: int, failing: bool, value: float) -> Signal:
        def signal(time: float) -> np.ndarray:
            noise = np.random.default_rng([seed, round(1e4 * time)]).normal(size=6) * np.repeat([2e-5, 4e-3], 3)
            fails = failing and self.fails(time)
            return np.full(6, value) if fails else held_cube.WRENCHES[finger] + noise

        return signal

    def off(self) -> float:
        """How far the cube's middle is from where it is held, m: what its symmetries leave."""
        middle = np.array([0.0, 0.0, 0.03])
        return float(np.linalg.norm(self.run.instants[-1].pose @ middle - RigidTransform(held_cube.X_PO) @ middle))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_sensor_that_drops_out_is_named_and_the_others_go_on(cube: ObjectModel, value: float) -> None:
    held = HeldCube(cube, ("thumb",), value)
    assert held.run.until(0.2).word in ("ok", "ambiguous")
    last = held.run.until(0.5)
    assert last.word in ("ok", "ambiguous", "slipping")
    assert "thumb: the wrench is not finite" in last.status
    assert last.belief.touch_time == last.belief.time
    assert held.off() < 0.006
    held.run.until(1.7)
    assert "thumb" not in held.run.instants[-1].status
    assert held.off() < 0.006


def test_slow_sensors_are_neither_frozen_nor_lost_between_their_samples(cube: ObjectModel) -> None:
    """Five samples a second, and a belief each 10 ms."""
    every = {
        finger: lambda time, finger=finger, i=i: (
            held_cube.WRENCHES[finger]
            + np.random.default_rng([i, int(5.0 * time + 1e-6)]).normal(size=6) * np.repeat([2e-5, 4e-3], 3)
        )
        for i, finger in enumerate(held_cube.WRENCHES)
    }
    run = Run(
        MakePoseTracking(load_hand_config("shadow_like"), cube),
        **{f"wrench_{finger}": signal for finger, signal in every.items()},
        joint_positions=lambda time: held_cube.Q.copy(),
        joint_velocities=lambda time: np.zeros(24),
        vision=lambda time: held_cube.prior(),
    )
    run.until(1.5)
    assert {instant.status for instant in run.instants if instant.time > 0.2} == {"ok"}


@pytest.mark.parametrize("freezing", [("thumb",), tuple(held_cube.WRENCHES)])
def test_a_board_that_hangs_is_named_although_the_joints_are_read_on(cube: ObjectModel, freezing: tuple[str]) -> None:
    def wrench(finger: str, seed: int, time: float) -> np.ndarray:
        noise = np.random.default_rng([seed, round(1e4 * time)]).normal(size=6) * np.repeat([2e-5, 4e-3], 3)
        return held_cube.WRENCHES[finger] + noise * (finger not in freezing or time < 0.205)

    run = Run(
        MakePoseTracking(load_hand_config("shadow_like"), cube, PoseTrackingParams(use_joint_velocities=False)),
        **{
            f"wrench_{finger}": lambda time, finger=finger, i=i: wrench(finger, i, time)
            for i, finger in enumerate(held_cube.WRENCHES)
        },
        joint_positions=lambda time: held_cube.Q + 1e-5 * np.random.default_rng(round(1e4 * time)).normal(size=24),
        vision=lambda time: held_cube.prior(),
    )
    assert "the same" not in run.until(0.7).status
    of = " of thumb" if len(freezing) == 1 else ""
    assert f"the touch{of} has been the same for 0.6 s" in run.until(0.81).status


@pytest.mark.parametrize(
    ("failing", "why"),
    [(tuple(held_cube.WRENCHES), "the wrench is not finite"), (("joints",), "a joint position is not known")],
)
def test_when_all_drop_out_the_pose_is_predicted_only_and_then_lost(
    cube: ObjectModel, failing: tuple[str, ...], why: str
) -> None:
    held = HeldCube(cube, failing)
    assert held.run.until(0.2).word in ("ok", "ambiguous")
    last = held.run.until(0.5)
    assert last.status == "no_contact: " + "; ".join(
        ["the fingertips' velocities are not known"] * ("joints" in failing)
        + [f"{finger.name}: {why}" for finger in load_hand_config("shadow_like").fingers]
    )
    assert held.run.read("hypotheses").status == "no_solution"
    assert held.run.until(1.45).word == "lost"
    assert held.run.until(1.9).word in ("ok", "ambiguous")
    assert held.off() < 0.006
