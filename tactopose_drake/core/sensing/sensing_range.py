"""The box in front of a tactile pad in which an object's surface is felt."""

import dataclasses

import numpy as np

from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class SensingBox:
    """A box whose z axis points out of the pad; z = 0 is the finger's stiff core, beneath the pad's soft layer.

    Attributes:
        X_PB: its pose, shape (3, 4).
        lower: its lowest corner in B, shape (3,), m.
        upper: its highest corner in B, shape (3,), m.
    """

    X_PB: FloatArray
    lower: FloatArray
    upper: FloatArray


def sensing_box(patch: Patch, *, thickness: float, height: float) -> SensingBox:
    """The box over a pad's cells up to their edges, from `height` below the core to `height` above the pad.

    Its z axis is the mean of the cells' normals, its x axis the pad's longest direction across it.

    Args:
        patch: only its cells' positions and normals are used.
        thickness: of the soft layer, m, >= 0.
        height: m, > 0.

    Raises:
        InvalidInputError: a thickness or height out of range, a pad of one cell, or one whose normals cancel.
    """
    thickness = positive_number("thickness", thickness, allow_zero=True)
    height = positive_number("height", height)
    if len(patch.p_PT) < 2:
        raise InvalidInputError("p_PT must have at least 2 cells for the box over a pad, not 1.")
    z = patch.n_PT.mean(axis=0)
    if np.linalg.norm(z) < 1e-3:
        raise InvalidInputError("n_PT must face a side for the box over a pad, but the normals cancel.")
    z /= np.linalg.norm(z)
    middle = patch.p_PT.mean(axis=0)
    flat = patch.p_PT - middle
    x = np.linalg.svd(flat - np.outer(flat @ z, z))[2][0]
    R_PB = np.stack([x, np.cross(z, x), z], axis=1)
    cells = (patch.p_PT - middle) @ R_PB
    floor = cells[:, 2].min() - thickness
    margin = np.append(patch.half_pitch * np.sqrt(1.0 + (patch.stretch @ R_PB[:, :2]) ** 2), height)
    shift = np.array([0.0, 0.0, floor])
    lower = np.minimum(cells.min(axis=0), [np.inf, np.inf, floor]) - shift - margin
    upper = cells.max(axis=0) - shift + margin
    return SensingBox(make_poses(R_PB, middle + R_PB @ shift), lower, upper)
