"""The hand on an arm as one rigid body: its pose, and straight descents with a held object."""

from collections.abc import Iterator
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

# Positions along a straight descent, and guesses of the inverse kinematics at its start.
_STEPS, _GUESSES = 5, 8
# Inverse kinematics solutions count as different if a joint differs by more than this, rad.
_APART = 0.1
# Largest rotation of the hand while it is raised, rad.
_RAISED_TURN = 0.3
# Heights above a descent's start over which the path to it may lead, m, and the number of times at which it is checked.
_DETOURS, _CHECKED_TIMES = (0.15, 0.3), 40
# Direction of the fingers.
_FORWARD_P = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class PlacedHand:
    """The hand on the flange F with its joints at rest.

    Attributes:
        X_FP: pose of the palm.
        p_PH: centres of the spheres that fill the hand, and of the ball at the arm's wrist, shape (h, 3), m.
        radius: their radii, shape (h,), m.
    """

    X_FP: RigidTransform
    p_PH: FloatArray
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class StraightDescent:
    """A straight descent of a point of the palm, with a direction of the palm pointing down.

    Attributes:
        p_PQ: the point, shape (3,), m.
        p_PE: the lowest point of the held object, shape (3,), m.
        down_P: the direction that points down, a unit vector of shape (3,).
        p_WQ: the target below the descent, shape (3,), m.
        highest: height above `p_WQ` at which the descent starts, m.
        lowest: height above `p_WQ` at which it ends, m.
        clear: height in the world above which hand and lowest point must stay near the target until the descent, m.
        near: horizontal distance from `p_WQ` within which that holds, m.
        floor: height in the world above which they must stay elsewhere, m.
        most_turn: largest angle between the fingers and the direction from the arm to `p_WQ`, rad.
    """

    p_PQ: FloatArray
    p_PE: FloatArray
    down_P: FloatArray
    p_WQ: FloatArray
    highest: float
    lowest: float
    clear: float
    near: float
    floor: float
    most_turn: float


@dataclass(frozen=True, eq=False)
class ArmSpeeds:
    """Limits of an arm's motion: a share of its joints' speed limits, and the joints' acceleration limit, rad/s^2."""

    share: float
    acceleration: float


@dataclass(frozen=True, eq=False)
class WayDown:
    """A planned descent of an arm.

    Attributes:
        move: the motion to the start of the descent.
        down: joint positions along the descent, shape (n, na), rad.
        above: joint positions well above its start, from which the arm can go elsewhere, shape (na,), rad; None if
            there are none.
    """

    move: PiecewisePolynomial
    down: FloatArray
    above: FloatArray | None


class CarriedHand:
    """Kinematics and motion planning of an arm that carries a hand."""

    def __init__(
        self, arm_plant: MultibodyPlant, arm: Arm, hand: HandConfig, X_FBase: RigidTransform, q_home: FloatArray
    ) -> None:
        """Keeps a reference to the arm's plant.

        Args:
            arm_plant: finalized plant of the arm alone.
            arm: the arm in it.
            hand: the hand.
            X_FBase: where its base is welded to the flange.
            q_home: preferred positions of the arm, shape (na,), rad.
        """
        self._arm_plant, self._arm, self._X_FBase, self._q_home = arm_plant, arm, X_FBase, q_home
        self._hand_plant, self._hand = make_hand_plant(hand)
        self._spheres = BodySpheres.of_hand(hand)

    @property
    def num_hand_positions(self) -> int:
        """The number of the hand's joint positions."""
        return int(self._hand_plant.num_positions())

    def place(self, q_hand: FloatArray) -> PlacedHand:
        """The hand on the flange with its joints at positions of shape (nq,), rad."""
        context = self._hand_plant.CreateDefaultContext()
        self._hand_plant.SetPositions(context, q_hand)
        base = self._hand_plant.GetFrameByName(self._hand.config.base_link, self._hand.model_instance)
        X_BaseP = self._hand_plant.CalcRelativeTransform(context, base, self._hand.palm_frame)
        p_WH = self._spheres.positions(self._hand_plant.get_body_poses_output_port().Eval(context))
        p_PH = self._hand.palm_frame.CalcPoseInWorld(context).inverse().multiply(p_WH.T).T
        X_FP, wrist = self._X_FBase @ X_BaseP, self._arm.config
        p_PWrist = X_FP.inverse().multiply(np.array(wrist.p_FWrist))
        return PlacedHand(X_FP, np.vstack([p_PH, p_PWrist]), np.append(self._spheres.radius, wrist.wrist_radius))

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
        """Calls `reach_axis` for this arm."""
        return reach_axis(self._arm_plant, self._arm.flange, goal, q_near, guesses)

    def move(self, q: FloatArray, speeds: ArmSpeeds, most_speed: float | None = None) -> PiecewisePolynomial:
        """The motion through positions of shape (n, na), rad; the flange's speed is limited to `most_speed`, m/s."""
        flange = None if most_speed is None else (self._arm.flange, most_speed)
        return smooth_motion(
            self._arm_plant, q, speed_share=speeds.share, most_acceleration=speeds.acceleration, most_speed=flange
        )

    def descend(
        self,
        q: FloatArray,
        hand: PlacedHand,
        descent: StraightDescent,
        speeds: ArmSpeeds,
        generator: np.random.Generator,
    ) -> WayDown | None:
        """Plans a descent; None if the arm cannot, or only by coming too low before the descent starts.

        Args:
            q: current positions of the arm, shape (na,), rad.
            hand: the hand on the flange.
            descent: the straight descent.
            speeds: limits of the motion to its start.
            generator: draws the guesses of the inverse kinematics.
        """
        raised = self._raised(q, hand, descent)
        for begin in self._begins(q, hand, descent, generator):
            down = self._way_down(begin, hand, descent)
            if down is None:
                continue
            detours = [self.reach(_goal(hand, descent, descent.highest + rise), begin, [begin]) for rise in _DETOURS]
            over = [detour for detour in detours if detour is not None]
            for path in _paths(q, raised, over, begin):
                move = self.move(np.array(path), speeds)
                if self._is_clear(move, hand, descent):
                    return WayDown(move, down, over[0] if over else None)
        return None

    def _begins(
        self, q: FloatArray, hand: PlacedHand, descent: StraightDescent, generator: np.random.Generator
    ) -> list[FloatArray]:
        """Joint positions at which the descent may start, shape (na,) each, rad, by distance from the current ones.

        An arm reaches a pose in several ways, such as with its wrist turned over. Moving from one to another would
        swing the held object through half of the arm's reach.
        """
        goal, home = _goal(hand, descent, descent.highest), self._q_home
        guesses = [home, *(home + generator.uniform(-0.8, 0.8, (_GUESSES, len(q))))]
        found = [self.reach(goal, near, [guess]) for near, guess in ((q, q), *((home, guess) for guess in guesses))]
        begins: list[FloatArray] = []
        for begin in sorted((way for way in found if way is not None), key=lambda way: float(np.linalg.norm(way - q))):
            if all(np.abs(begin - other).max() > _APART for other in begins):
                begins.append(begin)
        return begins

    def _way_down(self, begin: FloatArray, hand: PlacedHand, descent: StraightDescent) -> FloatArray | None:
        """Joint positions along the straight descent, shape (n, na), rad; None if the arm cannot reach them."""
        ways = [begin]
        for height in np.linspace(descent.highest, descent.lowest, _STEPS)[1:]:
            found = self.reach(_goal(hand, descent, float(height)), ways[-1], [ways[-1]])
            if found is None:
                return None
            ways.append(found)
        return np.array(ways)

    def _raised(self, q: FloatArray, hand: PlacedHand, descent: StraightDescent) -> FloatArray | None:
        """Joint positions with the hand raised at about its current orientation, shape (na,), rad, or None."""
        X_WF, rotate = self.flange(q), hand.X_FP.rotation()
        p_FQ, down_F = hand.X_FP.multiply(descent.p_PQ), rotate.multiply(descent.down_P)
        forward_F = rotate.multiply(_FORWARD_P)
        goal = AxisGoal(
            p_FQ=p_FQ,
            direction_F=down_F,
            p_WQ=X_WF.multiply(p_FQ) + np.array([0.0, 0.0, _DETOURS[0]]),
            direction_W=X_WF.rotation().multiply(down_F),
            forward_F=forward_F,
            forward_W=X_WF.rotation().multiply(forward_F),
            most_turn=_RAISED_TURN,
        )
        return self.reach(goal, q, [q])

    def _is_clear(self, motion: PiecewisePolynomial, hand: PlacedHand, descent: StraightDescent) -> bool:
        """Whether the hand and the held object stay high enough during a motion."""
        p_FH = hand.X_FP.multiply(np.vstack([hand.p_PH, descent.p_PE]).T)
        radius = np.append(hand.radius, 0.0)
        context = self._arm_plant.CreateDefaultContext()
        for time in np.linspace(0.0, motion.end_time(), _CHECKED_TIMES):
            self._arm_plant.SetPositions(context, motion.value(time)[:, 0])
            p_WH = self._arm.flange.CalcPoseInWorld(context).multiply(p_FH).T
            near = np.linalg.norm((p_WH - descent.p_WQ)[:, :2], axis=1) < descent.near + radius
            if np.any(p_WH[:, 2] - radius <= np.where(near, descent.clear, descent.floor)):
                return False
        return True


def _goal(hand: PlacedHand, descent: StraightDescent, height: float) -> AxisGoal:
    """The goal at a height above the target, with the fingers as horizontal as the downward direction allows."""
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


def _paths(
    q: FloatArray, raised: FloatArray | None, over: list[FloatArray], begin: FloatArray
) -> Iterator[list[FloatArray]]:
    """Paths from the current positions to a descent's start: direct, via points above it, and first up."""
    yield [q, begin]
    yield from ([q, detour, begin] for detour in over)
    if raised is not None:
        yield from ([q, raised, detour, begin] for detour in over)
