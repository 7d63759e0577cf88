"""Records a station's outputs over a run for the timeline of a page."""

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.descriptions import determined_sigmas
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.visualization.appearance import MOST_FREE, MOVING_ALTERNATIVES, Look
from tactopose_drake.visualization.estimate_page import instant_of
from tactopose_drake.visualization.page_tables import Instant
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, touch_of
from tactopose_drake.visualization.timeline import Curve, Plot, Timeline


class _Noted(NamedTuple):
    """A recorded moment: its time, s, the status, the curves' values by name, the page's texts, and what is drawn."""

    time: float
    status: str
    values: dict[str, float]
    said: Instant
    looks: tuple[Look, ...]


class TimelineRecorder:
    """Records status, forces and standard deviations at each moment that it is shown.

    With tracking, they are those of the belief over time. Pass `show` to a run as the observer; if time goes back, the
    recording restarts.
    """

    def __init__(self, config: HandConfig, model: ObjectModel) -> None:
        """Takes the names of fingers and pads from the hand, and keeps the object."""
        self._fingers = config.sensing
        self._pads = [pad.name for pad in config.pads]
        self._model = model
        self._rows: list[_Noted] = []

    def show(self, view: RunView) -> None:
        """Records the current moment."""
        time = view.context.get_time()
        if self._rows and time <= self._rows[-1].time:
            self._rows.clear()
        estimate, status = view.believed("hypotheses"), view.believed("status")
        values = self._forces(view) | self._pressures(view) | self._widths(estimate)
        scene = self._scene(view, estimate)
        self._rows.append(_Noted(time, status, values, instant_of(scene, estimate, status), tuple(scene.looks)))

    def thin(self) -> None:
        """Drops every second moment."""
        self._rows = self._rows[::2]

    def drop_last(self) -> None:
        """Drops the last moment."""
        self._rows.pop()

    def timeline(self) -> Timeline | None:
        """The timeline of all recorded moments; None if there are fewer than two."""
        if len(self._rows) < 2:
            return None
        names = {"force": self._fingers, "pressure": self._pads, "width": ["position", "angle"]}
        curves = {kind: tuple(Curve(name, self._values(f"{kind}_{name}")) for name in names[kind]) for kind in names}
        position, angle = curves["width"]
        plots = [Plot("contact force", "N", curves["force"])] if self._fingers else []
        plots += [Plot("highest pressure", "kPa", curves["pressure"])] if self._pads else []
        plots += [Plot("\u00b1 position", "mm", (position,)), Plot("\u00b1 angle", "deg", (angle,))]
        times, states, said = zip(*((row.time, row.status, row.said) for row in self._rows), strict=True)
        looks = frozenset(look for row in self._rows for look in row.looks)
        return Timeline(np.array(times), states, tuple(plots), said, looks)

    def _values(self, name: str) -> FloatArray:
        return np.array([row.values.get(name, np.nan) for row in self._rows])

    def _scene(self, view: RunView, estimate: PoseEstimate | None) -> Scene:
        """The scene of the current moment, without the hand and the true pose."""
        prior = view.value("prior")
        pads, patches = view.value("pads", ()), view.value("patches", ())
        felt = [name for name, patch in zip(pads, patches, strict=True) if patch.is_felt]
        hypotheses = () if estimate is None else estimate.hypotheses[: 1 + MOVING_ALTERNATIVES]
        shown = tuple(map(ShownHypothesis.of, hypotheses))
        return Scene(
            model=self._model,
            contacts=touch_of(view.value("contacts"), patches),
            patches=patches,
            touched_by=(*view.value("fingers_in_contact"), *felt),
            hypotheses=shown,
            prior=None if prior is None else prior.X_PO,
        )

    def _forces(self, view: RunView) -> dict[str, float]:
        solutions = view.value("contact_solutions")
        return {f"force_{name}": _force(solutions[name]) for name in self._fingers if name in solutions}

    def _pressures(self, view: RunView) -> dict[str, float]:
        return {
            f"pressure_{name}": float(np.nanmax(patch.pressure, initial=0.0)) / 1e3
            for name, patch in zip(view.value("pads", ()), view.value("patches", ()), strict=True)
        }

    def _widths(self, estimate: PoseEstimate | None) -> dict[str, float]:
        if estimate is None or len(estimate.best.free_directions) > MOST_FREE:
            return {}  # Too little of the pose is determined for its standard deviations to be meaningful.
        rotation, translation = determined_sigmas(about_middle(estimate.best, self._model), self._model.size)
        widths = {"width_position": 1e3 * translation, "width_angle": math.degrees(rotation)}
        return {name: width for name, width in widths.items() if not math.isnan(width)}


def _force(solution: ContactSolution) -> float:
    """Force of a contact, N; 0 without a touch; NaN if the wrench gives neither a contact nor the absence of one."""
    return 0.0 if solution.is_untouched else float(np.linalg.norm(solution.normal_force + solution.friction_force))
