"""Patches of tactile pads in Meshcat: a plate on each pressed cell, and the principal axes of each patch.

The parts are made once and then only moved, shown and scaled, because Meshcat records only such changes.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.distance import pdist

from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.visualization.appearance import PATCH_AXES, PRESSURE
from tactopose_drake.visualization.frame_marks import along, shine_through
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat

_PLATE_HEIGHT, _OPACITY = 0.0004, 0.85  # of the plates
_AXIS_RADIUS = 0.0007
# Minimum drawn length of an axis, m; the third would be too short to be seen.
_LEAST_LENGTH = 0.004


def add_patches(meshcat: Meshcat | RemoteMeshcat, path: str, patches: int, cells: int) -> None:
    """Adds the parts that show patches, hidden until `move_patches` places them.

    Args:
        meshcat: the display.
        path: path of the parts.
        patches: number of patches that can be shown at once.
        cells: number of cells of each that can be shown.
    """
    meshcat.Delete(path)
    for slot in range(patches):
        at = f"{path}/{slot}"
        for cell in range(cells):
            plate = f"{at}/cells/{cell}"
            meshcat.SetObject(plate, Box(1.0, 1.0, _PLATE_HEIGHT), Rgba(*PRESSURE.colour, _OPACITY))
            # The object penetrates the pad, and would hide the plates.
            shine_through(meshcat, plate)
        for k in range(3):
            meshcat.SetObject(f"{at}/axes/{k}", Cylinder(_AXIS_RADIUS, 1.0), Rgba(*PATCH_AXES.colour))
        meshcat.SetProperty(at, "visible", False)


def move_patches(
    meshcat: Meshcat | RemoteMeshcat,
    path: str,
    patches: Sequence[Patch],
    slots: int,
    cells: int,
    time: float | None = None,
) -> None:
    """Places the parts that `add_patches` has added, and hides those that are not needed.

    A plate's area is proportional to its cell's pressure; it reaches its neighbours at the saturation pressure of the
    array, or at the largest pressure of the patch if the array has none. Each known axis extends one standard deviation
    to both sides of the centroid.

    Args:
        meshcat: the display.
        path: path of the parts.
        patches: in the frame of the path's parent; patches beyond `slots`, and cells beyond `cells`, are not shown.
        slots: number of patches for which `add_patches` has added parts.
        cells: number of cells of each for which it has added parts.
        time: time in the recording, s, if there is one.
    """
    for slot in range(slots):
        at = f"{path}/{slot}"
        shown = slot < len(patches) and patches[slot].is_felt
        meshcat.SetProperty(at, "visible", shown, time)
        if shown:
            _move_plates(meshcat, f"{at}/cells", patches[slot], cells, time)
            _move_axes(meshcat, f"{at}/axes", patches[slot], time)


def plate_sizes(patch: Patch) -> FloatArray:
    """Length and width of the plates on a patch's cells, shape (n, 2), m; zero for cells without pressure."""
    pitch = float(pdist(patch.p_PT).min()) if len(patch.p_PT) > 1 else 2 * _LEAST_LENGTH
    felt = np.where(patch.active, patch.pressure, 0.0)
    largest = patch.saturation if math.isfinite(patch.saturation) else max(felt.max(), 1e-9)
    widths = pitch * np.sqrt(np.minimum(felt / largest, 1.0))
    return np.stack([widths * math.hypot(1.0, *patch.stretch), widths], axis=1)


def plate_pose(patch: Patch, cell: int) -> RigidTransform:
    """Pose of the plate on a cell: z points out of the pad, and x along the longer sides of the cells."""
    z = patch.n_PT[cell]
    x = patch.stretch - (patch.stretch @ z) * z
    if not x.any():
        return along(z, patch.p_PT[cell])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.stack([x, np.cross(z, x), z], axis=1)), patch.p_PT[cell])


def _move_plates(meshcat: Meshcat | RemoteMeshcat, path: str, patch: Patch, cells: int, time: float | None) -> None:
    sizes = plate_sizes(patch)
    for cell in range(cells):
        shown = cell < len(sizes) and bool(sizes[cell, 1] > 0)
        meshcat.SetProperty(f"{path}/{cell}", "visible", shown, time)
        if shown:
            meshcat.SetTransform(f"{path}/{cell}", plate_pose(patch, cell), time)
            meshcat.SetProperty(f"{path}/{cell}", "scale", [*sizes[cell].tolist(), 1.0], time)


def _move_axes(meshcat: Meshcat | RemoteMeshcat, path: str, patch: Patch, time: float | None) -> None:
    for k in range(3):
        axis = patch.eigenvectors[:, k]
        known = bool(np.all(np.isfinite(axis)))
        meshcat.SetProperty(f"{path}/{k}", "visible", known, time)
        if known:
            length = max(2 * math.sqrt(patch.eigenvalues[k]), _LEAST_LENGTH)
            X_PAxis = along(axis, patch.centroid)
            meshcat.SetTransform(f"{path}/{k}", X_PAxis, time)
            meshcat.SetProperty(f"{path}/{k}", "scale", [1.0, 1.0, length], time)
