"""Plans how an arm meets a rod that is handed over, and how it puts it into a hole that looks up."""

import dataclasses

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.held_axis import HeldAxis, find_held_axis
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.station.arms.arm import Arm
from tactopose_drake.station.arms.motion import AxisGoal, reach_axis, smooth_motion

# Positions along the straight way into the hole, and guesses of the inverse kinematics at its beginning.
_INSERT_STEPS, _GUESSES = 5, 8
# How much higher than its end the way to the hole may lead, m, and at how many times it is checked.
_DETOURS, _CHECKED_TIMES = (0.0, 0.15, 0.3), 40


@dataclasses.dataclass(kw_only=True, slots=True)
class PlaceParams:
    """Where the hole is, what is known of the rod's slide, and how fast the arm goes."""

    p_WHole: list[float] = dataclasses.field(default_factory=lambda: [0.5, -0.4, 0.1])  # middle of its rim, m
    box_width: float = 0.12  # of the box that the hole is in, m
    down_P: list[float] = dataclasses.field(default_factory=lambda: [-1.0, 0.0, 0.0])  # where the rod is to point, in P
    # Touch does not tell how far a rod has slid along itself; the hand-over does: its middle is within this distance of
    # the grip, m.
    most_slide: float = 0.02
    end_clearance: float = 0.02  # of the rod's end, were it handed over at its longest, above the box, m
    hand_clearance: float = 0.008  # of the hand above the box, m
    most_turn: float = 1.2  # angle between the fingers and the direction from the arm to the hole, rad
    meet_turn: float = 0.3  # by which the hand may turn about the rod while it meets it, rad
    speed_share: float = 0.8  # of the joints' largest speeds
    insert_speed_share: float = 0.12
    most_acceleration: float = 3.0  # of any joint of the arm, rad/s^2
    seed: int = 0  # of the guesses of the inverse kinematics

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        finite_array("PlaceParams.p_WHole", self.p_WHole, (3,))
        if not np.linalg.norm(finite_array("PlaceParams.down_P", self.down_P, (3,))) > 0.0:
            raise InvalidInputError("PlaceParams.down_P: is zero; allowed is a direction.")
        for field in dataclasses.fields(self):
            if field.name not in ("p_WHole", "down_P", "seed"):
                positive_number(f"PlaceParams.{field.name}", getattr(self, field.name), allow_zero=True)


class PlacePlanner:
    """Knows arm, hand, rod and hole; answers how the rod is held, and which motions lead to it and into the hole."""

    def __init__(
        self,
        arm_plant: MultibodyPlant,
        arm: Arm,
        hand: HandConfig,
        X_FBase: RigidTransform,
        model: ObjectModel,
        grip: HeldAxis,
        params: PlaceParams,
    ) -> None:
        """Keeps references to the arm's plant and the model.

        Args:
            arm_plant: finalized plant of the arm alone.
            arm: the arm in it.
            hand: the hand.
            X_FBase: where its base is welded to the flange.
            model: the rod; its axis is its first axis of symmetry.
            grip: the axis along which the hand holds a rod best.
            params: the hole, and how to go there.

        Raises:
            InvalidInputError: if the object has no axis of symmetry, or a parameter is out of its range.
        """
        params.validate()
        if not model.symmetries:
            raise InvalidInputError("model: has no axis of symmetry; allowed are rods.")
        self._arm_plant, self._arm, self._X_FBase, self._params = arm_plant, arm, X_FBase, params
        self._grip = grip
        self._hand_plant, self._hand = make_hand_plant(hand)
        self._spheres = BodySpheres.of_hand(hand)
        self._axis, self._point = model.symmetries[0].axis, model.symmetries[0].point
        heights = (model.vertices - self._point) @ self._axis
        self._half_length = 0.5 * float(np.ptp(heights))
        self._point = self._point + 0.5 * (heights.max() + heights.min()) * self._axis  # the rod's middle
        self._p_WHole, self._down_P = np.array(params.p_WHole), np.array(params.down_P)

    @property
    def num_hand_positions(self) -> int:
        """Of the hand's joints."""
        return int(self._hand_plant.num_positions())

    @property
    def longest_end(self) -> float:
        """Largest distance from the grip to the rod's lower end, m."""
        return self._half_length + self._params.most_slide

    def held_axis(self, estimate: PoseEstimate, contacts: Contacts) -> HeldAxis:
        """The rod's axis as the hypotheses have it, with the standard deviation of its lower end at its farthest."""
        hypotheses = estimate.hypotheses
        return find_held_axis(
            np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in hypotheses]),
            np.array([hypothesis.covariance for hypothesis in hypotheses]),
            np.array([hypothesis.probability for hypothesis in hypotheses]),
            axis=self._axis,
            point=self._point,
            towards=self._down_P,
            p_PG=contacts.p_PC.mean(axis=0),
            distance=self.longest_end,
        )

    def end_distance(self, held: HeldAxis, before: HeldAxis) -> float:
        """How far apart two axes are at the rod's lower end, across the rod, m."""
        apart = held.point(self.longest_end) - before.point(self.longest_end)
        return float(np.linalg.norm(apart - (apart @ before.direction) * before.direction))

    def misplacement(self, held: HeldAxis) -> float:
        """How far a rod is, at its lower end, from where the hand would hold it best, across the rod, m."""
        return self.end_distance(held, self._grip)

    def meet(self, q: FloatArray, q_hand: FloatArray, held: HeldAxis) -> PiecewisePolynomial | None:
        """The motion of the open hand to where a rod that stays where it is lies in it as the grip wants it.

        None if the arm cannot. The hand does not move along the rod.

        Args:
            q: where the arm is, shape (na,), rad.
            q_hand: positions of the hand's joints, shape (nq,), rad.
            held: the rod's axis in the palm, as felt at `q`.
        """
        context = self._arm_plant.CreateDefaultContext()
        self._arm_plant.SetPositions(context, q)
        X_FP, _ = self._place_hand(q_hand)
        X_WP = self._arm.flange.CalcPoseInWorld(context) @ X_FP
        along = (self._grip.p_PQ - held.p_PQ) @ held.direction
        forward_P = np.array([0.0, 0.0, 1.0])
        goal = AxisGoal(
            p_FQ=X_FP.multiply(self._grip.p_PQ),
            direction_F=X_FP.rotation().multiply(self._grip.direction),
            p_WQ=X_WP.multiply(held.point(float(along))),
            direction_W=X_WP.rotation().multiply(held.direction),
            forward_F=X_FP.rotation().multiply(forward_P),
            forward_W=X_WP.rotation().multiply(forward_P),
            most_turn=self._params.meet_turn,
        )
        found = reach_axis(self._arm_plant, self._arm.flange, goal, q, [q])
        if found is None:
            return None
        return smooth_motion(
            self._arm_plant,
            np.array([q, found]),
            speed_share=self._params.insert_speed_share,
            most_acceleration=self._params.most_acceleration,
        )

    def plan(
        self, q: FloatArray, q_hand: FloatArray, held: HeldAxis
    ) -> tuple[PiecewisePolynomial, PiecewisePolynomial, PiecewisePolynomial] | None:
        """The motions to above the hole, straight down into it, and straight up again.

        None if the arm cannot: on its way to the hole, hand and rod stay higher than the box.

        Args:
            q: where the arm is, shape (na,), rad.
            q_hand: positions of the hand's joints, shape (nq,), rad.
            held: the rod's axis in the palm.
        """
        params, generator = self._params, np.random.default_rng(self._params.seed)
        X_FP, p_PH = self._place_hand(q_hand)
        highest = self.longest_end + params.end_clearance
        lowest = self._hand_depth(p_PH, held) + params.hand_clearance
        lowest_points = np.vstack([X_FP.multiply(p_PH.T).T, X_FP.multiply(held.point(self.longest_end))])
        below = np.append(self._spheres.radius, 0.0)
        ways: list[FloatArray] = []
        for height in np.linspace(highest, lowest, _INSERT_STEPS):
            near = ways[-1] if ways else q
            goal = self._goal(X_FP, held, float(height))
            guesses = [near] if ways else [near, *(near + generator.uniform(-0.8, 0.8, (_GUESSES, len(q))))]
            found = reach_axis(self._arm_plant, self._arm.flange, goal, near, guesses)
            if found is None:
                return None
            ways.append(found)
        down = np.array(ways)
        limits = {"most_acceleration": params.most_acceleration}
        for detour in _DETOURS:
            path = [q, ways[0]]
            if detour:
                above = self._goal(X_FP, held, float(highest) + detour)
                found = reach_axis(self._arm_plant, self._arm.flange, above, ways[0], [ways[0]])
                path = path if found is None else [q, found, ways[0]]
            move = smooth_motion(self._arm_plant, np.array(path), speed_share=params.speed_share, **limits)
            if self._is_clear(move, lowest_points, below):
                break
        else:
            return None
        insert = smooth_motion(self._arm_plant, down, speed_share=params.insert_speed_share, **limits)
        retreat = smooth_motion(self._arm_plant, down[::-1], speed_share=params.insert_speed_share, **limits)
        return move, insert, retreat

    def _place_hand(self, q_hand: FloatArray) -> tuple[RigidTransform, FloatArray]:
        """The palm on the flange, and the spheres that fill the hand, in the palm, shape (h, 3), m."""
        context = self._hand_plant.CreateDefaultContext()
        self._hand_plant.SetPositions(context, q_hand)
        X_BaseP = self._hand.palm_frame.CalcPoseInWorld(context)
        p_BaseH = self._spheres.positions(self._hand_plant.get_body_poses_output_port().Eval(context))
        return self._X_FBase @ X_BaseP, X_BaseP.inverse().multiply(p_BaseH.T).T

    def _is_clear(self, motion: PiecewisePolynomial, p_FH: FloatArray, radius: FloatArray) -> bool:
        """Whether spheres that are fixed on the flange stay higher than the box."""
        context, lowest = self._arm_plant.CreateDefaultContext(), np.inf
        for time in np.linspace(0.0, motion.end_time(), _CHECKED_TIMES):
            self._arm_plant.SetPositions(context, motion.value(time)[:, 0])
            X_WF = self._arm.flange.CalcPoseInWorld(context)
            lowest = min(lowest, float((X_WF.multiply(p_FH.T)[2] - radius).min()))
        return bool(lowest > self._p_WHole[2] + self._params.hand_clearance)

    def _hand_depth(self, p_PH: FloatArray, held: HeldAxis) -> float:
        """How far the hand reaches below the grip where it may be over the box, m."""
        offset = p_PH - held.p_PQ
        along = offset @ held.direction
        across = np.linalg.norm(offset - along[:, None] * held.direction, axis=1)
        over = across < np.sqrt(0.5) * self._params.box_width + self._spheres.radius
        return float((along + self._spheres.radius)[over].max())

    def _goal(self, X_FP: RigidTransform, held: HeldAxis, height: float) -> AxisGoal:
        """The rod upright over the hole, its point at the grip at a height above the rim."""
        rotate = X_FP.rotation()
        forward_W = np.array([*self._p_WHole[:2], 0.0])
        return AxisGoal(
            p_FQ=X_FP.multiply(held.p_PQ),
            direction_F=rotate.multiply(held.direction),
            p_WQ=self._p_WHole + np.array([0.0, 0.0, height]),
            direction_W=np.array([0.0, 0.0, -1.0]),
            forward_F=rotate.multiply(np.array([0.0, 0.0, 1.0])),
            forward_W=forward_W / np.linalg.norm(forward_W),
            most_turn=self._params.most_turn,
        )
