"""A box without symmetries in the hand, touched in the middle of all six faces, where its surface is flat."""

import functools
import math

import numpy as np
import trimesh
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.motion.object_motion import MotionNoise
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import split_errors
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams

DEFAULT_PARAMS = PoseTrackerParams()
SIGMA_POSITION, SIGMA_NORMAL = 0.0009, math.radians(5.0)
p_OC = np.array(
    [
        [0.03, 0.02, 0.03],
        [-0.03, -0.02, 0.01],
        [0.01, 0.05, -0.03],
        [-0.01, -0.05, 0.04],
        [0, 0.02, 0.07],
        [0, 0, -0.07],
    ]
)
n_OC = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
STILL = MotionNoise(palm_translation=1e-9, palm_rotation=1e-9)


@functools.cache
def make_box() -> ObjectModel:
    """Built once for each process, for a model never changes."""
    return ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.10, 0.14)), cache=False, symmetry="none")


def draw_biases(generator: np.random.Generator, position: float, normal: float) -> NDArray[np.float64]:
    """Of the contacts, (k, 6)."""
    return generator.normal(size=(len(p_OC), 6)) * np.repeat([position, normal], 3)


def touch(
    X_PO: NDArray[np.float64],
    generator: np.random.Generator,
    bias: NDArray[np.float64] | None = None,
    stable: tuple[float, float] = (0.0, 0.0),
    sigmas: tuple[float, float] = (SIGMA_POSITION, SIGMA_NORMAL),
) -> Contacts:
    """What is measured at a pose: noise of these sigmas, of which the stable part is the bias."""
    bias = np.zeros((len(p_OC), 6)) if bias is None else bias
    own = math.sqrt(sigmas[0] ** 2 - stable[0] ** 2), math.sqrt(sigmas[1] ** 2 - stable[1] ** 2)
    p_PC = p_OC @ X_PO[:, :3].T + X_PO[:, 3] + bias[:, :3] + own[0] * generator.normal(size=p_OC.shape)
    turn = exp_so3(bias[:, 3:] + own[1] * generator.normal(size=p_OC.shape))
    n_PC = (turn @ (n_OC @ X_PO[:, :3].T)[..., None])[..., 0]
    return Contacts(p_PC, n_PC, sigma_position=sigmas[0], sigma_normal=sigmas[1])


def read(
    contacts: Contacts,
    source: NDArray[np.intp] | None = None,
    sources: tuple[str, ...] = tuple("abcdef"),
    params: PoseTrackerParams = DEFAULT_PARAMS,
) -> ContactReading:
    """New contacts of some sources, of which none is doubted."""
    source = np.arange(len(contacts)) if source is None else source
    parts = split_errors(contacts, np.ones(len(contacts)), np.ones(2), params)
    return ContactReading(contacts, source, sources, True, ErrorScales(), Evidence(contacts), parts)
