"""Records a station's outputs over a run for the timeline of a page."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.descriptions import determined_sigmas
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.visualization.appearance import MOST_FREE, MOVING_ALTERNATIVES
from tactopose_drake.visualization.estimate_page import instant_of
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, touch_of
from tactopose_drake.visualization.timeline import Curve, Plot, Timeline


class Moment(NamedTuple):
    """The outputs of a station at one time, with the estimate and status of the tracking if there is one.

    The estimate is of the touch one period before.
    """

    time: float  # s
    status: str
    estimate: PoseEstimate | None
    prior: PosePrior | None
    contacts: Contacts
    touched_by: tuple[str, ...]
    solutions: dict[str, ContactSolution]
    pads: tuple[str, ...]
    patches: tuple[Patch, ...]
    q: FloatArray
    true_pose: RigidTransform | None

    @property
    def touch(self) -> Contacts:
        """The contacts, followed by those of the pads."""
        return touch_of(self.contacts, self.patches)

    @property
    def guess(self) -> RigidTransform | None:
        """The pose of the prior if there is one."""
        return None if self.prior is None else self.prior.X_PO


class TimelineRecorder:
    """Records status, forces and standard deviations at each moment that it is shown.

    With tracking, they are those of the belief over time. Pass `show` to a run as the observer; if time goes back, the
    recording restarts.

    Attributes:
        moments: what was recorded, in order of time.
    """

    def __init__(self, config: HandConfig, model: ObjectModel) -> None:
        """Takes the names of fingers and pads from the hand, and keeps the object."""
        self._fingers = config.sensing
        self._pads = [pad.name for pad in config.pads]
        self._model = model
        self.moments: list[Moment] = []

    def show(self, view: RunView) -> None:
        """Records the current moment; its texts are made later, as they take milliseconds."""
        time = view.context.get_time()
        if self.moments and time <= self.moments[-1].time:
            self.moments.clear()
        self.moments.append(
            Moment(
                time,
                view.believed("status"),
                view.believed("hypotheses"),
                view.value("prior"),
                view.value("contacts"),
                tuple(view.value("fingers_in_contact")),
                view.value("contact_solutions"),
                tuple(view.value("pads", ())),
                tuple(view.value("patches", ())),
                view.value("joint_positions"),
                view.true_pose,
            )
        )

    def timeline(self) -> Timeline | None:
        """The timeline of all recorded moments; None if there are fewer than two."""
        if len(self.moments) < 2:
            return None
        times, states = zip(*((moment.time, moment.status) for moment in self.moments), strict=True)
        scenes = [self._scene(moment) for moment in self.moments]
        said = (
            instant_of(scene, moment.estimate, moment.status)
            for scene, moment in zip(scenes, self.moments, strict=True)
        )
        looks = frozenset(look for scene in scenes for look in scene.looks)
        return Timeline(np.array(times), states, self._plots(), tuple(said), looks)

    def _plots(self) -> tuple[Plot, ...]:
        values = [_forces(moment) | _pressures(moment) | self._widths(moment.estimate) for moment in self.moments]

        def curve(kind: str, name: str) -> Curve:
            return Curve(name, np.array([each.get(f"{kind}_{name}", np.nan) for each in values]))

        plots = [Plot("contact force", "N", tuple(curve("force", name) for name in self._fingers))]
        plots += [Plot("highest pressure", "kPa", tuple(curve("pressure", name) for name in self._pads))]
        return (
            *(plot for plot in plots if plot.curves),
            Plot("\u00b1 position", "mm", (curve("width", "position"),)),
            Plot("\u00b1 angle", "deg", (curve("width", "angle"),)),
        )

    def _scene(self, moment: Moment) -> Scene:
        """The scene of a moment, without the hand and the true pose."""
        felt = [name for name, patch in zip(moment.pads, moment.patches, strict=True) if patch.is_felt]
        hypotheses = () if moment.estimate is None else moment.estimate.hypotheses[: 1 + MOVING_ALTERNATIVES]
        return Scene(
            model=self._model,
            contacts=moment.touch,
            patches=moment.patches,
            touched_by=(*moment.touched_by, *felt),
            hypotheses=tuple(map(ShownHypothesis.of, hypotheses)),
            prior=moment.guess,
        )

    def _widths(self, estimate: PoseEstimate | None) -> dict[str, float]:
        if estimate is None or len(estimate.best.free_directions) > MOST_FREE:
            return {}  # Too little of the pose is determined for its standard deviations to be meaningful.
        rotation, translation = determined_sigmas(about_middle(estimate.best, self._model), self._model.size)
        widths = {"width_position": 1e3 * translation, "width_angle": math.degrees(rotation)}
        return {name: width for name, width in widths.items() if not math.isnan(width)}


def _forces(moment: Moment) -> dict[str, float]:
    return {f"force_{name}": _force(solution) for name, solution in moment.solutions.items()}


def _pressures(moment: Moment) -> dict[str, float]:
    return {
        f"pressure_{name}": float(np.nanmax(patch.pressure, initial=0.0)) / 1e3
        for name, patch in zip(moment.pads, moment.patches, strict=True)
    }


def _force(solution: ContactSolution) -> float:
    """Force of a contact, N; 0 without a touch; NaN if the wrench gives neither a contact nor the absence of one."""
    return 0.0 if solution.is_untouched else float(np.linalg.norm(solution.normal_force + solution.friction_force))
