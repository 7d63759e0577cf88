"""The demonstration: a simulated hand closes on an object, feels it, and corrects what vision says about its pose."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.hypotheses import determined_part
from tactopose_drake.core.metrics import touch_errors, truth_errors
from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.display.body_meshes import BodyMeshes, Triangles
from tactopose_drake.display.picture import save_picture
from tactopose_drake.display.scene import Scene
from tactopose_drake.errors import TactoposeError
from tactopose_drake.estimates import PoseEstimate
from tactopose_drake.files import save_result
from tactopose_drake.grasping.contact_truth import PartContact
from tactopose_drake.grasping.grasp_simulation import GraspResult, simulate_grasp
from tactopose_drake.scenario import Scenario
from tactopose_drake.visualization import aim_camera, save_html


class GraspFailedError(TactoposeError, RuntimeError):
    """No simulated grasp held the object."""


@dataclasses.dataclass(frozen=True)
class FingerReport:
    """How well one fingertip's contact was found.

    Attributes:
        finger: its name.
        force: magnitude of the measured contact force, N.
        position_error: distance of the solved contact from the simulator's centre of pressure, m; None if the simulator
            has no contact there.
        normal_error: angle between the solved normal and the simulator's, rad; None likewise.
    """

    finger: str
    force: float
    position_error: float | None
    normal_error: float | None


@dataclasses.dataclass(frozen=True)
class PoseReport:
    """How good one pose of the object is; the last four are those of section 3.3.1 of [B16].

    [B16] J. Bimbo, thesis, 2016.

    Attributes:
        name: of the source of the pose.
        translation: distance of the origin from the truth, m.
        rotation: angle from the truth, rad.
        determined_translation, determined_rotation: of these, the part along the directions that the touch determines.
        MDTS: mean distance of the contacts to the surface, m.
        MATN: mean angle between measured normals and the surface's, rad.
        RME: mean distance of the touched points from where they are in truth, m.
        MAE: mean angle of the normals at the touched points, rad.
    """

    name: str
    translation: float
    rotation: float
    determined_translation: float
    determined_rotation: float
    MDTS: float
    MATN: float
    RME: float
    MAE: float


@dataclasses.dataclass(frozen=True, eq=False)
class DemoResult:
    """What the demonstration found.

    Attributes:
        grasp: the simulation at its end.
        fingers: one report for each finger in contact.
        vision, touch: reports on the pose before and after the touch.
        hidden_share: how much of the object's camera side the hand hides, 0 to 1.
        estimate: the hypotheses.
        scene: what the pictures show.
    """

    grasp: GraspResult
    fingers: tuple[FingerReport, ...]
    vision: PoseReport
    touch: PoseReport
    hidden_share: float
    estimate: PoseEstimate
    scene: Scene


def run_demo(
    scenario: Scenario,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> DemoResult:
    """Simulates the scenario's grasp and compares vision's pose and the estimate with the truth.

    Args:
        scenario: what to simulate.
        model: of the scenario's object, if it is at hand already.
        meshcat: records the motion, if given.
        on_progress: is told what begins.

    Raises:
        InvalidInputError: if the scenario cannot be built.
        GraspFailedError: if no grasp that was tried holds the object.
    """
    grasp = simulate_grasp(scenario, model=model, meshcat=meshcat, on_progress=on_progress)
    if not grasp.stable:
        reasons = "; ".join((*grasp.failed_attempts, grasp.reason))
        raise GraspFailedError(f"no grasp of the {scenario.object} with seed {scenario.seed} held it: {reasons}.")
    diagram, context = grasp.station.diagram, grasp.context
    contacts: Contacts = diagram.GetOutputPort("contacts").Eval(context)
    names: list[str] = diagram.GetOutputPort("fingers_in_contact").Eval(context)
    prior: PosePrior = diagram.GetOutputPort("prior").Eval(context)
    estimate: PoseEstimate = diagram.GetOutputPort("hypotheses").Eval(context)
    scene = Scene(
        model=grasp.station.model,
        contacts=contacts,
        prior=RigidTransform(prior.X_PO),
        estimate=estimate.best.X_PO,
        truth=grasp.X_PO,
        hand=_hand_surface(grasp),
        up_P=_palm_pose(grasp).rotation().inverse() @ np.array([0.0, 0.0, 1.0]),
    )
    return DemoResult(
        grasp=grasp,
        fingers=tuple(_report_finger(name, i, contacts, grasp.truth.tips.get(name)) for i, name in enumerate(names)),
        vision=_report_pose("vision", prior.X_PO, grasp, contacts, estimate),
        touch=_report_pose("touch", estimate.best.X_PO.GetAsMatrix34(), grasp, contacts, estimate),
        hidden_share=float(diagram.GetOutputPort("hidden_share").Eval(context)[0]),
        estimate=estimate,
        scene=scene,
    )


def save_demo(result: DemoResult, folder: Path, meshcat: Meshcat | None = None) -> tuple[Path, ...]:
    """Writes result.json and picture.png, and with Meshcat's recording scene.html; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / "result.json", folder / "picture.png"]
    save_result(paths[0], result.estimate)
    save_picture(paths[1], result.scene)
    if meshcat is not None:
        aim_camera(meshcat, result.scene, _palm_pose(result.grasp))
        paths.append(folder / "scene.html")
        save_html(paths[2], meshcat)
    return tuple(paths)


def _report_finger(name: str, i: int, contacts: Contacts, truth: PartContact | None) -> FingerReport:
    assert contacts.n_PC is not None
    assert contacts.f_PC is not None
    force = float(np.linalg.norm(contacts.f_PC[i]))
    if truth is None:
        return FingerReport(name, force, None, None)
    position_error = float(np.linalg.norm(contacts.p_PC[i] - truth.p_PC))
    cosine = float(np.clip(contacts.n_PC[i] @ truth.n_PC, -1.0, 1.0))
    return FingerReport(name, force, position_error, float(np.arccos(cosine)))


def _report_pose(
    name: str, X_PO: FloatArray, grasp: GraspResult, contacts: Contacts, estimate: PoseEstimate
) -> PoseReport:
    model, X_PO_true = grasp.station.model, grasp.X_PO.GetAsMatrix34()
    increment = increments_between(X_PO, X_PO_true)
    determined = determined_part(increment, estimate.best.free_directions, model.size)
    assert contacts.n_PC is not None
    p_OC = (contacts.p_PC - X_PO_true[:, 3]) @ X_PO_true[:, :3]
    n_OC = contacts.n_PC @ X_PO_true[:, :3]
    (MDTS,), (MATN,) = touch_errors(model, contacts, X_PO[None])
    (RME,), (MAE,) = truth_errors(p_OC, n_OC, X_PO_true, X_PO[None])
    return PoseReport(
        name,
        float(np.linalg.norm(increment[3:])),
        float(np.linalg.norm(increment[:3])),
        float(np.linalg.norm(determined[3:])),
        float(np.linalg.norm(determined[:3])),
        float(MDTS),
        float(MATN),
        float(RME),
        float(MAE),
    )


def _hand_surface(grasp: GraspResult) -> Triangles:
    station = grasp.station
    context = station.plant.GetMyContextFromRoot(grasp.context)
    return BodyMeshes.in_palm(station.plant, context, station.hand.palm_frame)


def _palm_pose(grasp: GraspResult) -> RigidTransform:
    station = grasp.station
    return station.hand.palm_frame.CalcPoseInWorld(station.plant.GetMyContextFromRoot(grasp.context))
