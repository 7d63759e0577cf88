"""How a simulated run's grasp went, and how far its estimate is from the truth."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.posterior.hypotheses import determined_part
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.runs.contact_truth import contact_truth
from tactopose_drake.runs.grasp_simulation import judge_grasp
from tactopose_drake.station.simulated import Station


class GraspWatch:
    """Watches a simulated run, and says at its end what came of it."""

    def __init__(self, station: Station) -> None:
        """Keeps the station."""
        self._station = station
        self._release: tuple[float, RigidTransform] | None = None

    def see(self, context: Context) -> None:
        """Notes when the object is let go, and where."""
        locked = self._station.object_joint.is_locked(self._station.plant.GetMyContextFromRoot(context))
        if self._release is None and not locked:
            self._release = context.get_time(), self._station.object_pose(context)

    def outcome(self, context: Context) -> str:
        """Whether the object is held, and how far the estimate is off, in a sentence."""
        station = self._station
        plant_context = station.plant.GetMyContextFromRoot(context)
        X_PO = station.object_pose(context)
        truth = contact_truth(station.plant, plant_context, station.hand, station.object_body)
        slip = 0.0
        if self._release is not None:
            slip = float(np.linalg.norm(X_PO.translation() - self._release[1].translation()))
        reason = judge_grasp(station, plant_context, self._release[0] if self._release else None, truth, slip)
        held = "the grasp is stable" if reason == "ok" else f"the grasp is not stable: {reason}"
        estimate: PoseEstimate | None = station.diagram.GetOutputPort("hypotheses").Eval(context)
        return held if estimate is None else f"{held}; {error_text(estimate, X_PO, station.model.size)}"


def error_text(estimate: PoseEstimate, X_PO_true: RigidTransform, size: float) -> str:
    """How far the best hypothesis is from the truth, in all and along what the touch determines."""
    increment = increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO_true.GetAsMatrix34())
    determined = determined_part(increment, estimate.best.free_directions, size)
    in_all, where_told = (
        f"{1e3 * np.linalg.norm(part[3:]):.1f} mm and {np.degrees(np.linalg.norm(part[:3])):.1f} deg"
        for part in (increment, determined)
    )
    return f"the estimate is off the truth by {in_all}, where the touch determines it by {where_told}"
