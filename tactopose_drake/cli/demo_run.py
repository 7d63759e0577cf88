"""The demonstration: a simulated hand closes on an object, feels it, and corrects vision's estimate of its pose."""

import contextlib
import dataclasses
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from tactopose_drake.cli.demo_reports import (
    FingerReport,
    PadReport,
    PoseReport,
    report_finger,
    report_pad,
    report_pose,
)
from tactopose_drake.cli.titles import grasp_title
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidFileError, TactoposeError
from tactopose_drake.estimation.files import save_result
from tactopose_drake.estimation.output_files import check_outputs, written_beside
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.runs.disturbed_sensors import disturbed_sensors
from tactopose_drake.runs.grasp_simulation import GraspResult, simulate_grasp
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.runs.timeline_recorder import TimelineRecorder
from tactopose_drake.station.grasp_planning import grip_advice
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.pose_display import PoseDisplayParams
from tactopose_drake.visualization.body_meshes import BodyMeshes
from tactopose_drake.visualization.estimate_page import page_of
from tactopose_drake.visualization.frame_marks import add_frames
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.page_tables import PageTable, Row
from tactopose_drake.visualization.picture import save_picture
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, touch_of
from tactopose_drake.visualization.timeline import Timeline

_FILES = ("result.json", "picture.png", "scene.html")


class GraspFailedError(TactoposeError, RuntimeError):
    """No simulated grasp held the object."""


@dataclasses.dataclass(frozen=True, eq=False)
class DemoResult:
    """The result of the demonstration.

    Attributes:
        grasp: the simulation at its end.
        fingers: one report for each fingertip in contact that has a force-torque sensor.
        disturbed: a sentence for each of their sensors whose reading is not due to the object alone.
        pads: one report for each tactile pad.
        vision, touch: reports on the pose before and after the touch.
        tracked: report on the pose of the belief over time, if there is one.
        hidden_share: share of the object's camera side that the hand hides, 0 to 1.
        estimate: the estimate by touch.
        scene: the scene of the pictures.
        timeline: timeline of the grasp.
    """

    grasp: GraspResult
    fingers: tuple[FingerReport, ...]
    disturbed: tuple[str, ...]
    pads: tuple[PadReport, ...]
    vision: PoseReport
    touch: PoseReport
    tracked: PoseReport | None
    hidden_share: float
    estimate: PoseEstimate
    scene: Scene
    timeline: Timeline | None


def run_demo(
    scenario: Scenario,
    *,
    model: ObjectModel | None = None,
    meshcat: Meshcat | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> DemoResult:
    """Simulates the scenario's grasp and compares vision's pose and the estimate with the truth.

    Args:
        scenario: the scenario.
        model: the object's model; None: it is loaded.
        meshcat: records the motion; None: it is not recorded.
        on_progress: called with the name of each step that starts.

    Raises:
        InvalidInputError: if the scenario cannot be built.
        GraspFailedError: if no grasp that was tried holds the object, or the touch gives no estimate.
    """
    model = scenario.object_model() if model is None else model
    recorder = TimelineRecorder(load_hand_config(scenario.hand), model)
    grasp = simulate_grasp(scenario, model=model, meshcat=meshcat, on_progress=on_progress, observer=recorder.show)
    if not grasp.stable:
        reasons = (*grasp.failed_attempts, grasp.reason)
        raise GraspFailedError(
            f"no grasp of the {model.name.replace('_', ' ')} with seed {scenario.seed} held it, of {len(reasons)} that "
            f"were tried: {'; '.join(reasons)}. Try another seed.{grip_advice(scenario)}"
        )
    view = RunView(grasp.station.diagram, grasp.context)
    contacts, names = view.value("contacts"), view.value("fingers_in_contact")
    pads = _read_pads(grasp, view)
    patches = tuple(patch for patch, _ in pads.values())
    touch = touch_of(contacts, patches)
    touched_by = (*names, *(name for name, (patch, _) in pads.items() if patch.is_felt))
    prior: PosePrior = view.value("prior")
    estimate: PoseEstimate | None = view.value("hypotheses")
    belief: PoseEstimate | None = view.value("tracked_hypotheses")
    if estimate is None:
        name, status = model.name.replace("_", " "), view.value("status")
        raise GraspFailedError(f"the hand holds the {name} but feels too little of it: {status}.")

    def report(name: str, X_PO: FloatArray, best: PoseHypothesis) -> PoseReport:
        return report_pose(name, X_PO, grasp.X_PO, grasp.station.model, touch, best.free_directions)

    truth = grasp.truth
    return DemoResult(
        grasp=grasp,
        fingers=tuple(report_finger(name, row, contacts, truth.tips.get(name)) for row, name in enumerate(names)),
        disturbed=disturbed_sensors(grasp.station, grasp.context),
        pads=tuple(report_pad(name, *pads[name], truth.pads.get(name)) for name in pads),
        vision=report("vision", prior.mean, estimate.best),
        touch=report("touch", estimate.best.X_PO.GetAsMatrix34(), estimate.best),
        tracked=None if belief is None else report("belief", belief.best.X_PO.GetAsMatrix34(), belief.best),
        hidden_share=float(view.value("hidden_share")[0]),
        estimate=estimate,
        scene=_scene(grasp, touch, touched_by, patches, prior, estimate),
        timeline=recorder.timeline(),
    )


def earlier_results(folder: Path) -> list[Path]:
    """The results of an earlier run in a folder."""
    return [folder / name for name in _FILES if (folder / name).exists()]


def prepare_demo(folder: Path, others: Iterable[str] = (), inputs: Iterable[Path] = ()) -> list[Path]:
    """Checks that the results can be written, and returns the files that will be replaced; creates nothing.

    Args:
        folder: folder for the results, which may be new.
        others: names of further files that will be written there.
        inputs: files that are read, which must not be overwritten.

    Raises:
        InvalidFileError: if a file cannot be written there.
    """
    is_new = {path: not path.exists() for path in (folder, *folder.parents)}
    try:
        _make(folder)
        check_outputs((folder / name for name in (*_FILES, *others)), inputs)
        return earlier_results(folder)
    finally:
        for path in (path for path in is_new if is_new[path] and path.name != ".."):
            with contextlib.suppress(OSError):
                path.rmdir()


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        given = "not a file" if folder.is_file() else f"but cannot be made ({error.strerror})"
        raise InvalidFileError(f"{folder} must be a folder, which may be new, {given}.") from None


def save_demo(result: DemoResult, folder: Path, meshcat: Meshcat, others: Iterable[Path]) -> tuple[Path, ...]:
    """Writes result.json, picture.png and, with Meshcat's recording, scene.html, and copies other files.

    Returns:
        The paths of the results, without the copies.
    """
    _make(folder)
    for other in others:
        with written_beside(folder / other.name) as beside:
            shutil.copyfile(other, beside)
    paths = [folder / name for name in _FILES]
    save_result(paths[0], result.estimate)
    save_picture(paths[1], result.scene, captions=("before: vision", "after: touch"))
    # Only hypotheses that the station's display shows.
    hypotheses = result.scene.hypotheses[: 1 + PoseDisplayParams().max_alternatives]
    shown = dataclasses.replace(result.scene, hypotheses=hypotheses)
    add_frames(meshcat, PoseDisplayParams().path)
    page = page_of(
        shown,
        result.estimate,
        title=grasp_title(result.grasp.station.scenario, "simulated"),
        X_WP=_palm_pose(result.grasp),
        tables=(_errors_table(result),),
        timeline=result.timeline,
    )
    save_html(paths[2], meshcat, page)
    return tuple(paths)


def _errors_table(result: DemoResult) -> PageTable:
    """A table of the pose's errors before and after the touch, and by the belief over time."""
    reports = [report for report in (result.vision, result.touch, result.tracked) if report is not None]
    values = [
        ("position, mm", [1e3 * report.determined_translation for report in reports]),
        ("angle, deg", [np.degrees(report.determined_rotation) for report in reports]),
    ]
    rows = tuple(Row((name, *(f"{value:.1f}" for value in row))) for name, row in values)
    headings = ("against the truth", *(report.name for report in reports))
    return PageTable(
        "Error at the end, where determined",
        headings,
        rows,
        "" if result.tracked is None else "Touch: the last estimate by itself; the scene shows the belief over time.",
    )


def _read_pads(grasp: GraspResult, view: RunView) -> dict[str, tuple[Patch, FloatArray]]:
    """The patch of each tactile pad with a reading at the end, and the areas of its cells, m^2."""
    arrays = {pad.name: pad.array for pad in grasp.station.hand.config.pads}
    names, patches = view.value("pads", ()), view.value("patches", ())
    areas = (load_tactile_pad(arrays[name]).layout.areas for name in names)
    return dict(zip(names, zip(patches, areas, strict=True), strict=True))


def _scene(
    grasp: GraspResult,
    touch: Contacts,
    touched_by: tuple[str, ...],
    patches: tuple[Patch, ...],
    prior: PosePrior,
    estimate: PoseEstimate,
) -> Scene:
    station = grasp.station
    context = station.plant.GetMyContextFromRoot(grasp.context)
    return Scene(
        model=station.model,
        contacts=touch,
        touched_by=touched_by,
        patches=patches,
        prior=prior.X_PO,
        hypotheses=tuple(ShownHypothesis.of(hypothesis) for hypothesis in estimate.hypotheses),
        truth=grasp.X_PO,
        hand=BodyMeshes.in_palm(station.plant, context, station.hand.palm_frame),
        up_P=_palm_pose(grasp).rotation().inverse() @ np.array([0.0, 0.0, 1.0]),
    )


def _palm_pose(grasp: GraspResult) -> RigidTransform:
    station = grasp.station
    return station.hand.palm_frame.CalcPoseInWorld(station.plant.GetMyContextFromRoot(grasp.context))
