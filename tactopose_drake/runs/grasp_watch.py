"""Monitors the grasp of a simulated run: release, slip, stability, and the error of the estimate."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.posterior.modes import determined_part
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.runs.contact_truth import ContactTruth, contact_truth
from tactopose_drake.station.simulated import Station

_FALLEN = 0.3  # slip from which the object counts as fallen, m


class GraspWatch:
    """Monitors a simulated run and evaluates its grasp at the end; all contexts are root contexts.

    Attributes:
        release_time: time at which the release of the object was observed, s; None before.
    """

    def __init__(self, station: Station) -> None:
        """Keeps the station."""
        self._station = station
        self.release_time: float | None = None
        self._X_PO = RigidTransform()  # at that time

    def see(self, context: Context) -> None:
        """Records the time and the object's pose at its release."""
        locked = self._station.object_joint.is_locked(self._station.plant.GetMyContextFromRoot(context))
        if self.release_time is None and not locked:
            self.release_time, self._X_PO = context.get_time(), self._station.object_pose(context)

    def slip(self, context: Context) -> float:
        """Motion of the object's origin in the palm since its release, m, without rotation about it."""
        if self.release_time is None:
            return 0.0
        return float(np.linalg.norm(self._station.object_pose(context).translation() - self._X_PO.translation()))

    def turn(self, context: Context) -> float:
        """Angle by which the object has turned in the palm since its release, rad."""
        if self.release_time is None:
            return 0.0
        X_PO = self._station.object_pose(context)
        return float(np.linalg.norm(increments_between(self._X_PO.GetAsMatrix34(), X_PO.GetAsMatrix34())[:3]))

    def motion(self, context: Context) -> tuple[float, float]:
        """Speed, m/s, of the object's origin in the palm, and its angular speed, rad/s."""
        palm, body = self._station.hand.palm_frame, self._station.object_body.body_frame()
        V_PO = body.CalcSpatialVelocity(self._station.plant.GetMyContextFromRoot(context), palm, palm)
        return float(np.linalg.norm(V_PO.translational())), float(np.linalg.norm(V_PO.rotational()))

    def is_over(self, context: Context) -> bool:
        """Whether the simulation can end: the object has fallen, or was held long enough and is at rest."""
        if self.release_time is None:
            return False
        held = context.get_time() >= self.release_time + self._station.scenario.check.hold_time
        return self.slip(context) > _FALLEN or (held and self._is_still(context))

    def judge(self, context: Context) -> tuple[ContactTruth, str]:
        """The contacts at the end, and why the grasp is not stable; "ok" if it is."""
        station = self._station
        plant_context = station.plant.GetMyContextFromRoot(context)
        truth = contact_truth(station.plant, plant_context, station.hand, station.object_body)
        return truth, self._fault(context, truth) or "ok"

    def outcome(self, context: Context) -> str:
        """A sentence on whether the object is held, how far it has moved, and the error of the estimate."""
        _, reason = self.judge(context)
        held = "the grasp is stable" if reason == "ok" else f"the grasp is not stable: {reason}"
        if self.release_time is not None:
            slip, turn = 1e3 * self.slip(context), np.degrees(self.turn(context))
            held = f"{held}; since its release, the object has slipped by {slip:.1f} mm and turned by {turn:.1f} deg"
        estimate: PoseEstimate | None = self._station.diagram.GetOutputPort("hypotheses").Eval(context)
        if estimate is None:
            return held
        return f"{held}; {error_text(estimate, self._station.object_pose(context), self._station.model.size)}"

    def _fault(self, context: Context, truth: ContactTruth) -> str:
        """Why the grasp is not stable; empty if it is."""
        station, check = self._station, self._station.scenario.check
        if self.release_time is None:
            return "the fingers did not close in time"
        if (slip := self.slip(context)) > check.most_slip:
            return f"the object slipped by {1e3 * slip:.1f} mm"
        parts = truth.tips | truth.pads
        carrying = [name for name, part in parts.items() if np.linalg.norm(part.f_PC) >= check.least_force]
        if len(carrying) < min(check.least_fingers, len(station.hand.sensor_frames) + len(station.hand.pad_frames)):
            return f"only {len(carrying)} {'pads' if truth.pads else 'fingertips'} carry the object"
        # A planned grasp may only touch with the fingertips; a grip may touch anywhere.
        if truth.other_contacts and station.plan is not None:
            return f"the object also touches {', '.join(truth.other_contacts)}"
        if not self._is_still(context):
            speed, spin = self.motion(context)
            return f"the object still moves at {1e3 * speed:.2f} mm/s and {spin:.3f} rad/s"
        return ""

    def _is_still(self, context: Context) -> bool:
        speed, spin = self.motion(context)
        check = self._station.scenario.check
        return speed <= check.most_speed and spin <= check.most_angular_speed


def error_text(estimate: PoseEstimate, X_PO_true: RigidTransform, size: float) -> str:
    """Error of the best hypothesis, in total and in the determined directions, as text."""
    increment = increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO_true.GetAsMatrix34())
    determined = determined_part(increment, estimate.best.free_directions, size)
    in_all, where_told = (
        f"{1e3 * np.linalg.norm(part[3:]):.1f} mm and {np.degrees(np.linalg.norm(part[:3])):.1f} deg"
        for part in (increment, determined)
    )
    return f"the estimate is off the truth by {in_all}, where the touch determines it by {where_told}"
