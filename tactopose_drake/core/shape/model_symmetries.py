"""The rotations that leave a model's object unchanged, exactly or nearly, whether given or detected."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.shape.symmetry import CONTINUOUS, RotationalSymmetry, are_alike, symmetry_group
from tactopose_drake.core.validation import FloatArray

# Largest usual misfit of given rotations, rms, as a share of the size: a label or a small handle makes less, an axis in
# a wrong place more.
_USUAL_MISFIT = 0.05
_ALONG = 0.9986  # cosine of 3 degrees, within which an axis is named after one of O's


class KnownSymmetries(NamedTuple):
    """The symmetries of an `ObjectModel`, as its attributes name them.

    Attributes:
        symmetries: axes about which the object may be turned without a change.
        near: axes about which every rotation nearly leaves it unchanged.
        poses: the finite symmetries' group, shape (g, 3, 4).
        misfits: of these poses, shape (g,), m.
        likenesses: poses that leave the object roughly unchanged, except those of the group, shape (n, 3, 4).
    """

    symmetries: tuple[RotationalSymmetry, ...]
    near: tuple[RotationalSymmetry, ...]
    poses: FloatArray
    misfits: FloatArray
    likenesses: FloatArray


def known_symmetries(
    arrays: Arrays, grid: DistanceGrid, samples: SurfaceSamples, given: tuple[RotationalSymmetry, ...] | None
) -> KnownSymmetries:
    """The symmetries that are given, or, if None, those detected when the model was built."""
    if given is not None:
        poses = symmetry_group(given)
        return KnownSymmetries(given, (), poses, misfits(grid, samples, poses), _others(arrays["likenesses"], poses))
    centroid = arrays["centroid"]
    found = tuple(
        RotationalSymmetry(axis, centroid, int(order))
        for axis, order in zip(arrays["axes"], arrays["orders"], strict=True)
    )
    near = tuple(RotationalSymmetry(axis, centroid, CONTINUOUS) for axis in arrays["near_axes"])
    poses = arrays["symmetry_poses"]
    return KnownSymmetries(found, near, poses, arrays["symmetry_misfits"], _others(arrays["likenesses"], poses))


def _others(likenesses: FloatArray, group: FloatArray) -> FloatArray:
    """The likenesses (n, 3, 4) that are none of a group's poses (g, 3, 4)."""
    return likenesses[~are_alike(group, likenesses).any(axis=0)]


def misfits(grid: DistanceGrid, samples: SurfaceSamples, poses: FloatArray) -> FloatArray:
    """Rms distance of the samples from the surface when moved by each of the poses X_OO' (g, 3, 4), m, shape (g,)."""
    turned = transform_points(poses, samples.points)
    distance = grid.distance(turned.reshape(-1, 3)).reshape(len(turned), -1)
    off: FloatArray = np.sqrt(np.mean(distance**2, axis=1))
    return off


def symmetry_lines(
    known: KnownSymmetries, are_given: bool, grid: DistanceGrid, samples: SurfaceSamples, size: float
) -> list[str]:
    """A sentence on each given symmetry that leaves the surface far off, or one on near symmetries that were found."""
    if not are_given:
        return [_near_symmetry_line(known.near, grid, samples)] if known.near else []
    lines = []
    for i, each in enumerate(known.symmetries):
        off = float(misfits(grid, samples, each.turns()).max())
        if off > _USUAL_MISFIT * size:
            lines.append(
                f"symmetry[{i}] is taken as told, though its turns leave the surface off by up to {1e3 * off:.3g} mm, "
                f"rms. Is its axis through {np.round(each.point, 4).tolist()} m, in the mesh's frame?"
            )
    return lines


def _near_symmetry_line(near: Sequence[RotationalSymmetry], grid: DistanceGrid, samples: SurfaceSamples) -> str:
    """A sentence on what a near symmetry means, and how to declare it."""
    turns = np.concatenate([each.turns() for each in near])
    off = f"surface off by up to {1e3 * misfits(grid, samples, turns).max():.1f} mm, rms"
    named = "any axis" if len(near) > 1 else f"its {axis_name(near[0].axis)} axis"
    option = " ".join(f"--symmetry {axis_name(each.axis)}" for each in near)
    return (
        f"is nearly unchanged by turns about {named} ({off}); where a touch does not tell such turns apart, they are "
        f"one hypothesis with that direction free. `{option}`, or tp.RotationalSymmetry in from_mesh(symmetry=...), "
        "says that they never matter, `none` that they do."
    )


def axis_name(axis: FloatArray) -> str:
    """A unit vector (3,) in O in the form that the option `--symmetry` takes."""
    main = int(np.abs(axis).argmax())
    return "xyz"[main] if abs(axis[main]) > _ALONG else ",".join(f"{x:.3f}" for x in axis + 0.0)
