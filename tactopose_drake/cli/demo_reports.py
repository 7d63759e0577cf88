"""Errors of contacts, patches and poses relative to the simulator's ground truth."""

import dataclasses

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.posterior.metrics import angles_between, touch_errors, truth_errors
from tactopose_drake.core.posterior.modes import determined_part
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.runs.contact_truth import PartContact


@dataclasses.dataclass(frozen=True)
class FingerReport:
    """Errors of one fingertip's contact.

    Attributes:
        finger: name of the finger.
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
class PadReport:
    """Errors of one tactile pad's patch.

    Attributes:
        pad: name of the pad.
        status: the patch's `Patch.status`.
        active_cells: number of cells that feel the object.
        force: sum of pressure times area over all cells, N.
        true_force: the simulator's normal force on the whole pad, including gaps between cells, N; 0 without contact.
        centroid_error: distance of the patch's centroid from the simulator's centre of pressure, m; None if either is
            missing.
        normal_error: angle between the patch's normal and the simulator's, rad; None unless the patch is an area.
    """

    pad: str
    status: str
    active_cells: int
    force: float
    true_force: float
    centroid_error: float | None
    normal_error: float | None


@dataclasses.dataclass(frozen=True)
class PoseReport:
    """Errors of one pose of the object; the last four are metrics of section 3.3.1 of [B16].

    [B16] J. Bimbo, thesis, 2016.

    Attributes:
        name: name of the source of the pose.
        translation: distance of the origin from the truth, m.
        rotation: angle from the truth, rad.
        determined_translation, determined_rotation: their parts along the directions that the touch determines.
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


def report_finger(finger: str, row: int, contacts: Contacts, truth: PartContact | None) -> FingerReport:
    """Compares a row of the contacts, which have normals and forces, with the true contact of the finger."""
    assert contacts.n_PC is not None
    assert contacts.f_PC is not None
    force = float(np.linalg.norm(contacts.f_PC[row]))
    if truth is None:
        return FingerReport(finger, force, None, None)
    position_error = float(np.linalg.norm(contacts.p_PC[row] - truth.p_PC))
    return FingerReport(finger, force, position_error, float(angles_between(contacts.n_PC[row], truth.n_PC)))


def report_pad(pad: str, patch: Patch, areas: FloatArray, truth: PartContact | None) -> PadReport:
    """Compares the patch of a pad with cells of these areas (n,), m^2, with the pad's true contact."""
    touched = truth is not None and patch.is_felt
    return PadReport(
        pad,
        patch.status,
        int(np.count_nonzero(patch.active)),
        float(np.linalg.norm(pad_force(patch, areas))),
        0.0 if truth is None else float(truth.f_PC @ truth.n_PC),
        float(np.linalg.norm(patch.centroid - truth.p_PC)) if truth is not None and touched else None,
        float(angles_between(patch.eigenvectors[:, 2], truth.n_PC))
        if truth is not None and patch.status == "area"
        else None,
    )


def pad_force(patch: Patch, areas: FloatArray) -> FloatArray:
    """Force of the object on a pad's live cells, from their pressures and areas (n,), m^2; in P, shape (3,), N."""
    force: FloatArray = -np.nansum((patch.pressure * areas)[:, None] * patch.n_PT, axis=0)
    return force


def report_pose(
    name: str, X_PO: FloatArray, X_PO_true: RigidTransform, model: ObjectModel, touch: Contacts, free: FloatArray
) -> PoseReport:
    """Compares a pose (3, 4) with the truth.

    Args:
        name: name of its source.
        X_PO: the pose.
        X_PO_true: the true pose.
        model: the object.
        touch: the contacts, with normals.
        free: the directions that the touch does not determine, shape (f, 6).
    """
    assert touch.n_PC is not None
    X_true = X_PO_true.GetAsMatrix34()
    increment = increments_between(X_PO, X_true)
    determined = determined_part(increment, free, model.size)
    p_OC = (touch.p_PC - X_true[:, 3]) @ X_true[:, :3]
    n_OC = touch.n_PC @ X_true[:, :3]
    (MDTS,), (MATN,) = touch_errors(model, touch, X_PO[None])
    (RME,), (MAE,) = truth_errors(p_OC, n_OC, X_true, X_PO[None])
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
