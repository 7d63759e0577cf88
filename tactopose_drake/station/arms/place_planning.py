"""Plans how an arm meets a rod that is handed over, sets it on a table, and puts it into an upward hole."""

import dataclasses

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.held_axis import HeldAxis, find_held_axis
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.station.arms.carried_hand import ArmSpeeds, CarriedHand, PlacedHand, StraightDescent
from tactopose_drake.station.arms.motion import AxisGoal
from tactopose_drake.station.arms.table_leans import LEAST_LEAN_DEG, Lean, choose_lean, lean_ways

# Safety margin of the rod's end, in standard deviations.
_SIGMAS = 3.0
# Horizontal margin around the box within which hand and rod must stay above it, m.
_BESIDE = 0.03


@dataclasses.dataclass(kw_only=True, slots=True)
class PlaceParams:
    """Places of the hole and the table, and limits of the arm's motions."""

    p_WHole: list[float] = dataclasses.field(default_factory=lambda: [0.5, -0.4, 0.1])  # middle of its rim, m
    box_width: float = 0.12  # of the box with the hole, m
    # Where the rod touches the table, m: far enough from the box for the arm's wrist, behind the hand, to clear it.
    p_WTable: list[float] = dataclasses.field(default_factory=lambda: [0.55, 0.3, 0.0])
    table_give: float = 0.0  # how far the rod has sunk into the table when the touch is detected, m
    down_P: list[float] = dataclasses.field(default_factory=lambda: [-1.0, 0.0, 0.0])  # of the rod, towards its end
    end_clearance: float = 0.02  # of the rod's end above the box, m
    table_clearance: float = 0.008  # of the rod's end above the table, before it is lowered onto it, m
    hand_clearance: float = 0.008  # of the hand above the box and the table, m
    most_lean_deg: float = 60.0  # largest lean of the rod on the table, deg
    most_turn: float = 1.2  # largest angle between the fingers and the direction from the arm to the hole, rad
    meet_turn: float = 0.3  # largest rotation of the hand about the rod while it meets it, rad
    speed_share: float = 0.8  # share of the joints' speed limits
    insert_speed_share: float = 0.12  # likewise, for the insertion
    touch_speed: float = 0.02  # speed of lowering the rod onto the table, m/s
    most_acceleration: float = 3.0  # of any joint of the arm, rad/s^2
    seed: int = 0  # of the guesses of the inverse kinematics

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        finite_array("PlaceParams.p_WHole", self.p_WHole, (3,))
        finite_array("PlaceParams.p_WTable", self.p_WTable, (3,))
        if not np.linalg.norm(finite_array("PlaceParams.down_P", self.down_P, (3,))) > 0.0:
            raise InvalidInputError("PlaceParams.down_P must be a direction, not zero.")
        for name in ("table_give", "end_clearance", "table_clearance", "hand_clearance", "most_turn", "meet_turn"):
            positive_number(f"PlaceParams.{name}", getattr(self, name), allow_zero=True)
        for name in ("speed_share", "insert_speed_share"):
            positive_number(f"PlaceParams.{name}", getattr(self, name), most=1.0)
        for name in ("box_width", "touch_speed", "most_acceleration"):
            positive_number(f"PlaceParams.{name}", getattr(self, name))
        positive_number("PlaceParams.most_lean_deg", self.most_lean_deg, least=LEAST_LEAN_DEG, most=90.0, unit="deg")
        whole_number("PlaceParams.seed", self.seed, least=0)


class PlacePlanner:
    """Computes how the rod is held, and plans the motions to the rod, the table and the hole."""

    def __init__(self, hand: CarriedHand, model: ObjectModel, grip: HeldAxis, params: PlaceParams) -> None:
        """Keeps references to hand and model.

        Args:
            hand: the hand on its arm.
            model: the rod; its axis is its first axis of symmetry.
            grip: the axis along which the hand holds a rod best; misplacements are measured at its end.
            params: places of table and hole, and limits.

        Raises:
            InvalidInputError: if the object has no axis of symmetry, or a parameter is out of its range.
        """
        params.validate()
        if not model.symmetries:
            raise InvalidInputError("model must be a rod, with an axis of symmetry, but has none.")
        self._hand, self._model, self._params, self._grip = hand, model, params, grip
        self._axis, point = model.symmetries[0].axis, model.symmetries[0].point
        offset = model.vertices - point
        heights = offset @ self._axis
        self._half_length = 0.5 * float(np.ptp(heights))
        self._middle = point + 0.5 * (heights.max() + heights.min()) * self._axis
        self._radius = float(np.linalg.norm(offset - heights[:, None] * self._axis, axis=1).max())
        self._p_WHole, self._p_WTable = np.array(params.p_WHole), np.array(params.p_WTable)
        self._down_P = np.array(params.down_P)
        self._fast = ArmSpeeds(params.speed_share, params.most_acceleration)
        self._slow = ArmSpeeds(params.insert_speed_share, params.most_acceleration)

    @property
    def num_hand_positions(self) -> int:
        """The number of the hand's joint positions."""
        return self._hand.num_hand_positions

    def fingertips(self, q_hand: FloatArray) -> dict[str, RigidTransform]:
        """Poses X_PS of the fingers' sensors, by finger, with the hand's joints at positions (nq,), rad."""
        return self._hand.fingertips(q_hand)

    @property
    def p_WTouch(self) -> FloatArray:
        """A point at the height of the rod's lowest point when a touch of the table is detected, shape (3,), m."""
        return self._p_WTable - np.array([0.0, 0.0, self._params.table_give])

    def held_axis(self, estimate: PoseEstimate, contacts: Contacts) -> HeldAxis:
        """The rod's axis and its end, according to the hypotheses."""
        # If the origin were far away, a mere spin would seem to move the end.
        hypotheses = [about_middle(hypothesis, self._model) for hypothesis in estimate.hypotheses]
        middle = self._middle - self._model.middle if has_far_origin(self._model) else self._middle
        return find_held_axis(
            np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in hypotheses]),
            np.array([hypothesis.covariance for hypothesis in hypotheses]),
            np.array([hypothesis.probability for hypothesis in hypotheses]),
            axis=self._axis,
            middle=middle,
            half_length=self._half_length,
            towards=self._down_P,
            p_PG=contacts.p_PC.mean(axis=0),
        )

    def end_distance(self, held: HeldAxis, before: HeldAxis) -> float:
        """Distance between two axes, across the rod, at the rod's end according to `before`, m."""
        apart = held.point(before.end) - before.point(before.end)
        return float(np.linalg.norm(apart - (apart @ before.direction) * before.direction))

    def misplacement(self, held: HeldAxis) -> float:
        """Distance of a held rod from the best grip, across the rod, at the grip's lower end, m."""
        return self.end_distance(held, self._grip)

    def meet(self, q: FloatArray, q_hand: FloatArray, held: HeldAxis) -> PiecewisePolynomial | None:
        """The motion of the open hand to a pose in which the rod, which does not move, is at the best grip.

        The hand does not move along the rod. None if the arm cannot reach it.

        Args:
            q: current positions of the arm, shape (na,), rad.
            q_hand: positions of the hand's joints, shape (nq,), rad.
            held: the rod's axis in the palm, as felt at `q`.
        """
        X_FP = self._hand.place(q_hand).X_FP
        X_WP = self._hand.flange(q) @ X_FP
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
        found = self._hand.reach(goal, q, [q])
        return None if found is None else self._hand.move(np.array([q, found]), self._slow)

    def touch_table(
        self, q: FloatArray, q_hand: FloatArray, held: HeldAxis, estimate: PoseEstimate
    ) -> tuple[PiecewisePolynomial, PiecewisePolynomial, FloatArray] | None:
        """Plans the motion to above the table, and slowly down until the rod touches it or the hand nearly does.

        The rod's lean is chosen such that the touch distinguishes best which of the rod's ends is down, see
        `choose_lean`.

        Args:
            q: current positions of the arm, shape (na,), rad.
            q_hand: positions of the hand's joints, shape (nq,), rad.
            held: the rod's axis in the palm.
            estimate: the hypotheses of its pose.

        Returns:
            Both motions, and positions of the arm, shape (na,), rad, to which the rod can be lifted after the touch;
            None if the arm cannot reach the table.
        """
        hand = self._hand.place(q_hand)
        farthest = min(held.end + _SIGMAS * held.sigma_end, 2.0 * self._half_length)
        leans = lean_ways(held, hand, self._params.hand_clearance, np.radians(self._params.most_lean_deg))
        for lean in choose_lean(self._model, estimate, leans, held.end - _SIGMAS * held.sigma_end):
            planned = self._lower(q, hand, held, lean, farthest)
            if planned is not None:
                return planned
        return None

    def lift(self, q: FloatArray, above: FloatArray) -> PiecewisePolynomial:
        """The motion up from the table."""
        return self._hand.move(np.array([q, above]), self._fast)

    def _lower(
        self, q: FloatArray, hand: PlacedHand, held: HeldAxis, lean: Lean, farthest: float
    ) -> tuple[PiecewisePolynomial, PiecewisePolynomial, FloatArray] | None:
        """Plans a touch with one lean; `farthest` is the largest distance of the rod's end from the grip, m."""
        params, tilt = self._params, float(-lean.n_P @ held.direction)
        reach = farthest * tilt + self._radius * float(np.sqrt(max(0.0, 1.0 - tilt**2)))
        floor = self._p_WTable[2] + 0.5 * params.table_clearance + self._radius
        descent = StraightDescent(
            p_PQ=held.p_PQ,
            p_PE=held.point(farthest),
            down_P=-lean.n_P,
            p_WQ=self._p_WTable,
            highest=max(reach, lean.least_end * tilt) + params.table_clearance,
            lowest=lean.least_end * tilt,
            clear=floor,
            near=0.0,
            floor=floor,
            most_turn=params.most_turn,
        )
        found = self._hand.descend(q, hand, descent, self._fast, np.random.default_rng(params.seed))
        if found is None or found.above is None:
            return None
        return found.move, self._hand.move(found.down, self._slow, params.touch_speed), found.above

    def plan(
        self, q: FloatArray, q_hand: FloatArray, held: HeldAxis
    ) -> tuple[PiecewisePolynomial, PiecewisePolynomial, PiecewisePolynomial] | None:
        """Plans the motions to above the hole, straight down into it, and straight up again.

        On the way to the hole, hand and rod stay above the box when near it, and off the table. None if the arm cannot.

        Args:
            q: current positions of the arm, shape (na,), rad.
            q_hand: positions of the hand's joints, shape (nq,), rad.
            held: the rod's axis in the palm.
        """
        params, hand = self._params, self._hand.place(q_hand)
        farthest = held.end + _SIGMAS * held.sigma_end
        descent = StraightDescent(
            p_PQ=held.p_PQ,
            p_PE=held.point(farthest),
            down_P=held.direction,
            p_WQ=self._p_WHole,
            highest=farthest + params.end_clearance,
            lowest=self._hand_depth(hand, held) + params.hand_clearance,
            clear=self._p_WHole[2] + params.hand_clearance,
            near=np.sqrt(0.5) * params.box_width + _BESIDE,
            floor=self._p_WTable[2] + params.hand_clearance,
            most_turn=params.most_turn,
        )
        found = self._hand.descend(q, hand, descent, self._fast, np.random.default_rng(params.seed))
        if found is None:
            return None
        insert, retreat = (self._hand.move(way, self._slow) for way in (found.down, found.down[::-1]))
        return found.move, insert, retreat

    def _hand_depth(self, hand: PlacedHand, held: HeldAxis) -> float:
        """How far the part of the hand that may be over the box extends below the grip, m; 0 if there is none."""
        offset = hand.p_PH - held.p_PQ
        along = offset @ held.direction
        across = np.linalg.norm(offset - along[:, None] * held.direction, axis=1)
        over = across < np.sqrt(0.5) * self._params.box_width + hand.radius
        return float((along + hand.radius)[over].max()) if over.any() else 0.0
