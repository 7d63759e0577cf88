"""Records a run as a page with a time slider that shows hand, touch and belief."""

from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.times import TIME_ROUNDING
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_in_plant import make_hand_plant, make_hand_with_shapes
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.resources import fixed_pose
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.runs.timeline_recorder import Moment, TimelineRecorder
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.visualization.appearance import MOVING_ALTERNATIVES
from tactopose_drake.visualization.body_meshes import BodyMeshes
from tactopose_drake.visualization.estimate_page import page_of
from tactopose_drake.visualization.frame_marks import add_frames
from tactopose_drake.visualization.meshcat import upright
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.patch_marks import add_patches, move_patches
from tactopose_drake.visualization.pose_marks import add_hypotheses, add_object, move_hypotheses, place
from tactopose_drake.visualization.scene import Scene, ShownHypothesis
from tactopose_drake.visualization.touch_marks import add_touch, move_touch

_PATH = "/tactopose"
_PERIOD = 0.04  # least time between two moments, s; doubled as often as a long run needs
_MOST_MOMENTS = 130  # moments of a page, which keep it below 6 MB
_FRAME_RATE = 1000.0  # of Meshcat's recording, Hz; it holds only the frames of moments, so that the page stays small


class PageRecorder:
    """Records as many moments of a run as a page can hold, and writes the page.

    With tracking, it shows the belief over time. Pass `show` to a run as the observer.
    """

    def __init__(self, scenario: Scenario, model: ObjectModel) -> None:
        """Builds the hand.

        Args:
            scenario: the run's scenario.
            model: its object.
        """
        config = scenario.hand_config()
        self._offsets = reading_offsets(*make_hand_plant(config))
        self._model, self._timeline = model, TimelineRecorder(config, model)
        X_WBase = fixed_pose("Scenario.X_WBase", scenario.X_WBase)
        self._plant, inspector, self._hand = make_hand_with_shapes(config, X_WBase)
        self._context = self._plant.CreateDefaultContext()
        self._meshes = BodyMeshes.from_inspector(self._plant, inspector, self._hand.model_instance)
        self._most_contacts = len(config.fingers) + len(config.pads)
        self._period, self._next = _PERIOD, -np.inf
        self._ends_early = False  # whether the last moment was not due

    @property
    def _moments(self) -> list[Moment]:
        return self._timeline.moments

    def show(self, view: RunView) -> None:
        """Records the current moment; one that is not due stays only if it is the last."""
        time = view.context.get_time()
        is_due = time >= self._next
        if not is_due and time <= self._moments[-1].time:
            return
        if self._ends_early:
            self._moments.pop()
        self._ends_early = not is_due
        self._timeline.show(view)
        if not is_due:
            return
        if len(self._moments) > _MOST_MOMENTS:
            del self._moments[1::2]
            self._period *= 2
        self._next = time + self._period - TIME_ROUNDING

    def save(self, path: Path, title: str) -> bool:
        """Writes the page if there was an estimate and there are at least two moments; returns whether it did.

        Raises:
            InvalidFileError: if the file cannot be written.
        """
        timeline = self._timeline.timeline()
        estimated = [moment for moment in self._moments if moment.estimate is not None]
        if timeline is None or not estimated:
            return False
        last = estimated[-1]
        assert last.estimate is not None
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        self._add_parts(meshcat)
        meshcat.StartRecording(_FRAME_RATE)
        for moment in self._moments:
            self._draw(meshcat, moment)
        meshcat.StopRecording()
        meshcat.PublishRecording()
        scene = self._scene(last)
        meshcat.SetTransform(_PATH, upright(scene))
        page = page_of(scene, last.estimate, title=title, timeline=timeline)
        save_html(path, meshcat, page)
        return True

    def save_picture(self, path: Path) -> bool:
        """Writes a picture of the last estimate if there was one; returns whether it did.

        Raises:
            InvalidFileError: if the file cannot be written.
        """
        from tactopose_drake.visualization.picture import save_picture  # Deferred: it loads matplotlib.

        estimated = [moment for moment in self._moments if moment.estimate is not None]
        if estimated:
            save_picture(path, self._scene(estimated[-1]))
        return bool(estimated)

    def _scene(self, moment: Moment) -> Scene:
        X_PB = self._body_poses(moment.q)
        X_WP = self._hand.palm_frame.CalcPoseInWorld(self._context)
        return Scene(
            model=self._model,
            contacts=moment.touch,
            patches=moment.patches,
            hypotheses=_shown(moment)[: 1 + MOVING_ALTERNATIVES],
            prior=moment.guess,
            truth=moment.true_pose,
            hand=self._meshes.merged(X_PB),
            up_P=X_WP.rotation().inverse() @ np.array([0.0, 0.0, 1.0]),
        )

    def _add_parts(self, meshcat: Meshcat) -> None:
        add_object(meshcat, f"{_PATH}/prior", self._model, "prior")
        if self._moments[-1].true_pose is not None:
            add_object(meshcat, f"{_PATH}/truth", self._model, "truth")
        add_hypotheses(meshcat, _PATH, self._model, MOVING_ALTERNATIVES)
        add_touch(meshcat, f"{_PATH}/touch", self._most_contacts)
        pads, cells = self._pads()
        add_patches(meshcat, f"{_PATH}/patches", pads, cells)
        add_frames(meshcat, _PATH)
        for row, mesh in enumerate(self._meshes.meshes):
            colour = Rgba(*mesh.colour.mean(axis=0))
            meshcat.SetTriangleMesh(f"{_PATH}/hand/{row}", mesh.vertices.T, mesh.faces.T, colour)

    def _draw(self, meshcat: Meshcat, moment: Moment) -> None:
        # Meshcat rounds down to a frame; this is the nearest one.
        time, hypotheses = moment.time + 0.5 / _FRAME_RATE, _shown(moment)
        scene = Scene(model=self._model, contacts=moment.touch, patches=moment.patches, hypotheses=hypotheses)
        move_hypotheses(meshcat, _PATH, self._model, hypotheses[:1] + scene.alternatives, MOVING_ALTERNATIVES, time)
        place(meshcat, f"{_PATH}/prior", moment.guess, time)
        if moment.true_pose is not None:
            place(meshcat, f"{_PATH}/truth", moment.true_pose, time)
        move_touch(meshcat, f"{_PATH}/touch", scene.contacts, self._most_contacts, time, scene.is_false)
        move_patches(meshcat, f"{_PATH}/patches", moment.patches, *self._pads(), time)
        X_PB = self._body_poses(moment.q)
        for row, body in enumerate(self._meshes.body):
            meshcat.SetTransform(f"{_PATH}/hand/{row}", X_PB[body], time)

    def _pads(self) -> tuple[int, int]:
        """The largest number of pads at one moment, and of cells of a pad."""
        felt = [moment.patches for moment in self._moments]
        cells = max((len(patch.p_PT) for patches in felt for patch in patches), default=0)
        return max(map(len, felt)), cells

    def _body_poses(self, q: FloatArray) -> list[RigidTransform]:
        """Poses of all bodies in P at the joint readings, of which unknown ones count as 0."""
        self._plant.SetPositions(self._context, np.nan_to_num(q - self._offsets))
        X_PW = self._hand.palm_frame.CalcPoseInWorld(self._context).inverse()
        return [X_PW @ X_WB for X_WB in self._plant.get_body_poses_output_port().Eval(self._context)]


def _shown(moment: Moment) -> tuple[ShownHypothesis, ...]:
    return () if moment.estimate is None else tuple(map(ShownHypothesis.of, moment.estimate.hypotheses))
