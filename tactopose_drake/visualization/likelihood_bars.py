"""Likelihoods of objects in Meshcat: a row for each object, with its shape and a bar as long as its likelihood.

Meshcat has no text: a small shape shows which object a bar belongs to, and the row's path ends in the object's name.
The parts are made once and then only scaled and moved, because Meshcat records only such changes.
"""

import re
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.visualization.appearance import ESTIMATE, TRUTH
from tactopose_drake.visualization.meshcat import look_at

HEIGHT = 0.05
"""Height of a row, m."""
LENGTH = 0.3
"""Length of the bar for a likelihood of 1, m."""

_THICKNESS = 0.4  # Of a bar, as a share of the row's height.
_SHAPE = 0.8  # Size of an object's shape, as a share of the row's height.
_LEAST = 1e-3  # Likelihood of the shortest bar: a scale of zero cannot be undone.
_FRAME_OPACITY = 0.12
_MARGIN = 1.1  # size of the visible region relative to the bars


def add_bars(meshcat: Meshcat, path: str, models: Sequence[ObjectModel]) -> None:
    """Adds a row for each object, the first at the top, in the plane x = 0: shapes at y = 0, bars along +y.

    Args:
        meshcat: the display.
        path: path of the rows; whatever it held is deleted.
        models: the objects.
    """
    meshcat.Delete(path)
    for row, model in enumerate(models):
        at = row_path(path, row, model.name)
        meshcat.SetTransform(at, RigidTransform([0.0, 0.0, -HEIGHT * row]))
        # Upright, and turned slightly so that more than one side is seen.
        R = RotationMatrix.MakeYRotation(np.radians(15.0)) @ RotationMatrix.MakeZRotation(np.radians(-30.0))
        vertices = (model.vertices - model.middle) / model.size
        meshcat.SetTriangleMesh(
            f"{at}/shape", R.matrix() @ (_SHAPE * HEIGHT * vertices).T, model.faces.T, Rgba(*ESTIMATE.colour, 1.0)
        )
        thick = _THICKNESS * HEIGHT
        meshcat.SetObject(f"{at}/frame", Box(thick, LENGTH, thick), Rgba(0.3, 0.3, 0.35, _FRAME_OPACITY))
        meshcat.SetTransform(f"{at}/frame", RigidTransform(_middle(1.0)))
        meshcat.SetObject(f"{at}/bar/box", Box(thick, LENGTH, thick), Rgba(*TRUTH.colour, 1.0))


def look_at_bars(meshcat: Meshcat, count: int) -> None:
    """Points Meshcat's camera at the bars of `count` objects, from the front."""
    low, high = np.array([-0.5 * HEIGHT, (0.5 - count) * HEIGHT]), np.array([HEIGHT + LENGTH, 0.5 * HEIGHT])
    middle = np.append(0.0, 0.5 * (low + high))
    look_at(meshcat, middle, _MARGIN * float(np.linalg.norm(high - low)), np.array([1.0, 0.0, 0.0]))


def set_bars(
    meshcat: Meshcat,
    path: str,
    models: Sequence[ObjectModel],
    found: Identification | None,
    time: float | None = None,
) -> None:
    """Scales the bars. An object whose name is not among the identities has the shortest bar.

    Args:
        meshcat: the display.
        path: path of the rows.
        models: the objects of `add_bars`.
        found: the likelihoods; None if there are none yet.
        time: time in the recording, s, if there is one.
    """
    likelihoods = {} if found is None else {identity.name: identity.likelihood for identity in found}
    for row, model in enumerate(models):
        likelihood = max(likelihoods.get(model.name, 0.0), _LEAST)
        bar = f"{row_path(path, row, model.name)}/bar"
        meshcat.SetTransform(bar, RigidTransform(_middle(likelihood)), time)
        meshcat.SetProperty(f"{bar}/box", "scale", [1.0, likelihood, 1.0], time)


def row_path(path: str, row: int, name: str) -> str:
    """Path of a row."""
    return f"{path}/{row}/{re.sub(r'[^0-9A-Za-z_-]', '_', name)}"


def _middle(likelihood: float) -> FloatArray:
    return np.array([0.0, HEIGHT + 0.5 * LENGTH * likelihood, 0.0])
