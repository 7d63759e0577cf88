"""The cube and the cylinder of the thesis' chapter 3, their exact contacts, and displaced initial poses.

As in the thesis, a trial has four exact contacts, chosen from the point cloud that the searches use. The thesis does
not state the sizes of the objects or the distribution of the displacements: the numbers below reproduce the 'Initial'
rows of its table 3.1. A single distribution of displacements does so for both objects if the cube is rotated about one
of its corners.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, chapter 3.
"""

import dataclasses
import functools
import math

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

import tactopose_drake as tp
from tactopose_drake.core.poses import retract

SIGMA_ROTATION = math.radians(7.25)  # standard deviation of the displacement about each axis
SIGMA_TRANSLATION = 0.002  # m, standard deviation along each axis
CONTACTS = 4
# What the exact contacts claim to be, for the likelihood of `tp.estimate_pose`: about what its grid resolves.
SIGMA_POSITION, SIGMA_NORMAL = 1e-4, math.radians(2.0)


@dataclasses.dataclass(frozen=True)
class Shape:
    """An object of the table; its surface samples are the thesis' point cloud, about eight points a square centimetre.

    Attributes:
        model: the object.
        touchable: which of its samples may be touched, shape (n,): those with some distance from every edge.
    """

    model: tp.ObjectModel
    touchable: NDArray[np.intp]


@dataclasses.dataclass(frozen=True)
class Trial:
    """Four exact contacts with the object at X_PO = 1, and a displaced initial pose."""

    contacts: tp.Contacts
    prior: tp.PosePrior


@functools.cache
def make_shapes() -> dict[str, Shape]:
    """A cube with its frame at a corner, and a cylinder with its frame at the centre."""
    edge = 0.095
    cube = trimesh.creation.box((edge, edge, edge))
    cube.apply_translation([edge / 2, edge / 2, edge / 2])
    cylinder = trimesh.creation.cylinder(radius=0.035, height=0.11, sections=720)
    return {"cube": make_shape(cube, "cube", margin=0.01), "cylinder": make_shape(cylinder, "cylinder", margin=0.015)}


def make_shape(mesh: trimesh.Trimesh, name: str, margin: float) -> Shape:
    """A shape that is touched at a distance of at least `margin` (m) from its edges, as by a fingertip."""
    model = tp.ObjectModel.from_mesh(mesh, name=name, cache=False)
    points, normals = model.samples.points, model.samples.normals
    beyond_an_edge = normals @ normals.T < math.cos(math.radians(60))
    gap = np.where(beyond_an_edge, cdist(points, points), math.inf).min(axis=1)
    return Shape(model, np.flatnonzero(gap >= margin))


def make_trial(shape: Shape, generator: np.random.Generator) -> Trial:
    """Draws four exact contacts and the displaced pose, which is all prior knowledge."""
    touched = generator.choice(shape.touchable, CONTACTS, replace=False)
    samples = shape.model.samples
    contacts = tp.Contacts(
        samples.points[touched],
        samples.normals[touched],
        sigma_position=SIGMA_POSITION,
        sigma_normal=SIGMA_NORMAL,
    )
    increment = generator.normal(size=6) * np.repeat([SIGMA_ROTATION, SIGMA_TRANSLATION], 3)
    return Trial(contacts, tp.PosePrior(retract(np.eye(3, 4), increment), SIGMA_TRANSLATION, SIGMA_ROTATION))
