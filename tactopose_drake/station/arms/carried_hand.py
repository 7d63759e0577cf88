"""The hand on an arm, as one rigid body: where it is, and straight ways down that it takes with what it holds."""

from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.station.arms.arm import Arm
from tactopose_drake.station.arms.motion import AxisGoal, reach_axis, smooth_motion

# Positions along a straight way down, and guesses of the inverse kinematics at its beginning.
_STEPS, _GUESSES = 5, 8
# How much higher than a straight way down the way to its beginning may lead, m, and at how many times it is checked.
_DETOURS, _CHECKED_TIMES = (0.15, 0.3), 40
# The fingers' direction.
_FORWARD_P = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class PlacedHand:
    """The hand on the flange F with its joints at rest.

    Attributes:
        X_FP: the palm.
        p_PH: spheres that fill the hand, shape (h, 3), m.
        radius: of those, shape (h,), m.
    """

    X_FP: RigidTransform
    p_PH: FloatArray
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class Descent:
    """A straight way down of a point of the palm, with a direction of the palm looking down.

    Attributes:
        p_PQ: the point, shape (3,), m.
        p_PE: the lowest point of what the hand holds, shape (3,), m.
        down_P: the direction, shape (3,), of length 1.
        p_WQ: below where the point goes down, shape (3,), m.
        highest: where it begins, above `p_WQ`, m.
        lowest: where it ends.
        clear: height in the world above which hand and lowest point stay until it begins, m.
        most_turn: angle between the fingers and the direction from the arm to `p_WQ`, rad.
    """

    p_PQ: FloatArray
    p_PE: FloatArray
    down_P: FloatArray
    p_WQ: FloatArray
    highest: float
    lowest: float
    clear: float
    most_turn: float


@dataclass(frozen=True, eq=False)
class ArmSpeeds:
    """How fast an arm goes: the share of its joints' largest speeds, and any joint's largest acceleration, rad/s^2."""

    share: float
    acceleration: float


@dataclass(frozen=True, eq=False)
class WayDown:
    """How an arm goes down.

    Attributes:
        move: the motion to where the descent begins.
        down: positions along it, shape (n, na), rad.
        above: those from which it can be left for elsewhere, well above its beginning, shape (na,); None if there are
            none.
    """

    move: PiecewisePolynomial
    down: FloatArray
    above: FloatArray | None


class CarriedHand:
    """Knows arm and hand; finds the ways of the arm."""

    def __init__(
        self, arm_plant: MultibodyPlant, arm: Arm, hand: HandConfig, X_FBase: RigidTransform, q_home: FloatArray
    ) -> None:
        """Keeps a reference to the arm's plant.

        Args:
            arm_plant: finalized plant of the arm alone.
            arm: the arm in it.
            hand: the hand.
            X_FBase: where its base is welded to the flange.
            q_home: positions of the arm that it stays near to where it has a choice, shape (na,), rad.
        """
        self._arm_plant, self._arm, self._X_FBase, self._q_home = arm_plant, arm, X_FBase, q_home
        self._hand_plant, self._hand = make_hand_plant(hand)
        self._spheres = BodySpheres.of_hand(hand)

    @property
    def num_hand_positions(self) -> int:
        """Of the hand's joints."""
        return int(self._hand_plant.num_positions())

    def place(self, q_hand: FloatArray) -> PlacedHand:
        """The hand with its joints at positions of shape (nq,), rad."""
        context = self._hand_plant.CreateDefaultContext()
        self._hand_plant.SetPositions(context, q_hand)
        X_BaseP = self._hand.palm_frame.CalcPoseInWorld(context)
        p_BaseH = self._spheres.positions(self._hand_plant.get_body_poses_output_port().Eval(context))
        p_PH = X_BaseP.inverse().multiply(p_BaseH.T).T
        return PlacedHand(self._X_FBase @ X_BaseP, p_PH, self._spheres.radius)

    def fingertips(self, q_hand: FloatArray) -> dict[str, RigidTransform]:
        """Poses X_PS of the fingers' sensors, by finger."""
        context = self._hand_plant.CreateDefaultContext()
        self._hand_plant.SetPositions(context, q_hand)
        palm = self._hand.palm_frame
        return {name: frame.CalcPose(context, palm) for name, frame in self._hand.sensor_frames.items()}

    def flange(self, q: FloatArray) -> RigidTransform:
        """X_WF with the arm at positions of shape (na,), rad."""
        context = self._arm_plant.CreateDefaultContext()
        self._arm_plant.SetPositions(context, q)
        return self._arm.flange.CalcPoseInWorld(context)

    def reach(self, goal: AxisGoal, q_near: FloatArray, guesses: list[FloatArray]) -> FloatArray | None:
        """As `reach_axis`."""
        return reach_axis(self._arm_plant, self._arm.flange, goal, q_near, guesses)

    def move(self, q: FloatArray, speeds: ArmSpeeds, most_speed: float | None = None) -> PiecewisePolynomial:
        """The motion through positions of shape (n, na), rad; its flange is no faster than `most_speed`, m/s."""
        flange = None if most_speed is None else (self._arm.flange, most_speed)
        return smooth_motion(
            self._arm_plant, q, speed_share=speeds.share, most_acceleration=speeds.acceleration, most_speed=flange
        )

    def descend(
        self, q: FloatArray, hand: PlacedHand, descent: Descent, speeds: ArmSpeeds, generator: np.random.Generator
    ) -> WayDown | None:
        """How the arm goes; None if it cannot, or not without coming too low before the descent begins.

        Args:
            q: where the arm is, shape (na,), rad.
            hand: as it is on the flange.
            descent: the straight way down.
            speeds: on the way to it.
            generator: of the guesses of the inverse kinematics.
        """
        ways: list[FloatArray] = []
        for height in np.linspace(descent.highest, descent.lowest, _STEPS):
            near = ways[-1] if ways else self._q_home
            guesses = [near] if ways else [near, q, *(near + generator.uniform(-0.8, 0.8, (_GUESSES, len(q))))]
            found = self.reach(_goal(hand, descent, float(height)), near, guesses)
            if found is None:
                return None
            ways.append(found)
        above = [self.reach(_goal(hand, descent, descent.highest + rise), ways[0], [ways[0]]) for rise in _DETOURS]
        for path in ([q, ways[0]], *([q, detour, ways[0]] for detour in above if detour is not None)):
            move = self.move(np.array(path), speeds)
            if self._is_clear(move, hand, descent):
                return WayDown(move, np.array(ways), above[0])
        return None

    def _is_clear(self, motion: PiecewisePolynomial, hand: PlacedHand, descent: Descent) -> bool:
        """Whether the hand and what it holds stay high enough."""
        p_FH = hand.X_FP.multiply(np.vstack([hand.p_PH, descent.p_PE]).T)
        radius, lowest = np.append(hand.radius, 0.0), np.inf
        for time in np.linspace(0.0, motion.end_time(), _CHECKED_TIMES):
            heights = self.flange(motion.value(time)[:, 0]).multiply(p_FH)[2] - radius
            lowest = min(lowest, float(heights.min()))
        return lowest > descent.clear


def _goal(hand: PlacedHand, descent: Descent, height: float) -> AxisGoal:
    """The point at a height above where it goes down, the fingers level but for what the direction asks."""
    rotate = hand.X_FP.rotation()
    forward_P = _FORWARD_P - (_FORWARD_P @ descent.down_P) * descent.down_P
    forward_W = np.array([*descent.p_WQ[:2], 0.0])
    return AxisGoal(
        p_FQ=hand.X_FP.multiply(descent.p_PQ),
        direction_F=rotate.multiply(descent.down_P),
        p_WQ=descent.p_WQ + np.array([0.0, 0.0, height]),
        direction_W=np.array([0.0, 0.0, -1.0]),
        forward_F=rotate.multiply(forward_P / np.linalg.norm(forward_P)),
        forward_W=forward_W / np.linalg.norm(forward_W),
        most_turn=descent.most_turn,
    )
