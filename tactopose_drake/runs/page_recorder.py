"""A run as a page: hand, touch and belief at each moment, to be moved through with a slider."""

from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig, add_hand
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.runs.timeline_recorder import TimelineRecorder, belief_port
from tactopose_drake.visualization.appearance import MOST_ALTERNATIVES
from tactopose_drake.visualization.body_meshes import BodyMeshes
from tactopose_drake.visualization.estimate_page import page_of
from tactopose_drake.visualization.meshcat import upright
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.patch_marks import add_patches, move_patches
from tactopose_drake.visualization.pose_marks import add_hypotheses, add_object, move_hypotheses, place
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, false_contacts, worth_drawing
from tactopose_drake.visualization.touch_marks import add_touch, move_touch

_PATH = "/tactopose"
_PERIOD = 0.04  # s between two moments of the page at the least


class PageRecorder:
    """Draws what it is shown of a run into a recording; `save` writes the page. `show` is an observer of runs."""

    def __init__(self, config: HandConfig, model: ObjectModel) -> None:
        """Makes the hand and the object's parts.

        Args:
            config: of the hand, as the run has it.
            model: the object.
        """
        self._model, self._meshcat = model, Meshcat(MeshcatParams(host="localhost"))
        self._timeline = TimelineRecorder(config, model)
        self._scene_graph = SceneGraph()
        self._plant = MultibodyPlant(time_step=0.001)
        self._plant.RegisterAsSourceForSceneGraph(self._scene_graph)
        self._hand = add_hand(self._plant, config, RigidTransform())
        self._plant.Finalize()
        self._plant_context = self._plant.CreateDefaultContext()
        self._meshes = BodyMeshes.from_inspector(
            self._plant, self._scene_graph.model_inspector(), self._hand.model_instance
        )
        self._contacts = len(config.fingers)
        self._cells = 0
        self._last: tuple[Scene, PoseEstimate] | None = None
        self._next = -np.inf
        self._meshcat.StartRecording(1.0 / _PERIOD)
        self._add_parts()

    def show(self, view: RunView) -> None:
        """Records the present, if it is time."""
        time = view.context.get_time()
        if time < self._next:
            return
        self._next = time + _PERIOD - 1e-9
        self._timeline.show(view)
        ports = view.diagram, view.context
        contacts, prior, estimate = (
            ports[0].GetOutputPort(name).Eval(ports[1])
            for name in ("contacts", "prior", belief_port(view, "hypotheses"))
        )
        patches = ()
        if view.diagram.HasOutputPort("patches"):
            patches = tuple(view.diagram.GetOutputPort("patches").Eval(view.context))
        self._move_hand(view.diagram.GetOutputPort("joint_positions").Eval(view.context), time)
        hypotheses = () if estimate is None else tuple(map(ShownHypothesis.of, estimate.hypotheses))
        shown = worth_drawing(hypotheses)
        move_hypotheses(self._meshcat, _PATH, self._model, shown, MOST_ALTERNATIVES, time)
        X_PO = prior.X_PO if isinstance(prior, PosePrior) else None
        place(self._meshcat, f"{_PATH}/prior", X_PO, time)
        move_touch(
            self._meshcat, f"{_PATH}/touch", contacts, self._contacts, time, false_contacts(shown, len(contacts))
        )
        if patches and not self._cells:
            self._cells = max(len(patch.p_PT) for patch in patches)
            add_patches(self._meshcat, f"{_PATH}/patches", len(patches), self._cells)
        if patches:
            move_patches(self._meshcat, f"{_PATH}/patches", patches, len(patches), self._cells, time)
        if estimate is not None:
            hand = self._meshes.merged(self._body_poses())
            scene = Scene(
                model=self._model, contacts=contacts, patches=patches, hypotheses=hypotheses, prior=X_PO, hand=hand
            )
            self._last = scene, estimate

    def save(self, path: Path, title: str) -> bool:
        """Writes the page, if there has ever been an estimate and time has passed; tells whether it did.

        Raises:
            InvalidFileError: if it cannot be written.
        """
        timeline = self._timeline.timeline()
        if self._last is None or timeline is None:
            return False
        scene, estimate = self._last
        self._meshcat.StopRecording()
        self._meshcat.PublishRecording()
        self._meshcat.SetTransform(_PATH, upright(scene))
        save_html(path, self._meshcat, page_of(scene, estimate, title=title, timeline=timeline))
        return True

    def _add_parts(self) -> None:
        add_object(self._meshcat, f"{_PATH}/prior", self._model, "prior")
        add_hypotheses(self._meshcat, _PATH, self._model, MOST_ALTERNATIVES)
        add_touch(self._meshcat, f"{_PATH}/touch", self._contacts)
        for row, mesh in enumerate(self._meshes.meshes):
            vertices, faces = np.asfortranarray(mesh.vertices.T), np.asfortranarray(mesh.faces.T)
            self._meshcat.SetTriangleMesh(f"{_PATH}/hand/{row}", vertices, faces, Rgba(*mesh.colour.mean(axis=0)))

    def _move_hand(self, q: np.ndarray, time: float) -> None:
        self._plant.SetPositions(self._plant_context, q)
        X_PB = self._body_poses()
        for row, body in enumerate(self._meshes.body):
            self._meshcat.SetTransform(f"{_PATH}/hand/{row}", X_PB[body], time)

    def _body_poses(self) -> list[RigidTransform]:
        """Poses of all bodies in P."""
        X_PW = self._hand.palm_frame.CalcPoseInWorld(self._plant_context).inverse()
        return [X_PW @ X_WB for X_WB in self._plant.get_body_poses_output_port().Eval(self._plant_context)]
