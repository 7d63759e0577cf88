"""Six grips of the hand with tactile pads, for tables 5.2 and 5.3 of the thesis, and the objectives compared on them.

The thesis grasped four objects in six ways with a real Barrett Hand; here, Drake simulates such a hand. As in the
thesis' first experiment, the pads touch informative parts of the shape: an end, an edge, or a handle. The last grip is
the thesis' horizontal bottle, where the pads touch only a cylinder, so that no touch determines its translation along
its axis.

Each grip is kept as a file, named by a hash of the simulation's inputs, so that the next run only reads it.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.3.
"""

import dataclasses
import functools
import hashlib
import math
import os
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.common.schema import Rotation, Transform
from pydrake.common.yaml import yaml_dump_typed

import tactopose_drake as tp
from tactopose_drake.core.objectives import CellDistance, CovarianceMatching, LeastSquaresObjective, PatchContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.sensing import Patch, describe_patch
from tactopose_drake.core.shape import PointGrid, build_point_grid, cache_folder
from tactopose_drake.errors import TactoposeError
from tactopose_drake.resources import model_path
from tactopose_drake.runs import simulate_grasp
from tactopose_drake.station import Grip, Scenario, load_scenario

Array = NDArray[np.float64]

PAD_TOP = 0.0775  # height of the palm's pad, z in P, m
LAYER = 0.003  # thickness of the pads' soft layer, m
MOST_TURN, MOST_SHIFT = math.radians(20.0), 0.010  # maximum displacement about and along each axis
# Standard deviations of these uniform displacements.
SIGMA_TURN, SIGMA_SHIFT = MOST_TURN / math.sqrt(3.0), MOST_SHIFT / math.sqrt(3.0)
UNITS = np.repeat([MOST_TURN, MOST_SHIFT], 3)
PCA, DISTANCE, OURS = "algorithm 5.2", "algorithm 5.3", "ours"


def make_grip(name: str, p_PO: tuple[float, float, float], rotation: Rotation, spread: float = 0.0) -> Scenario:
    """A grip of one of the package's objects, held at p_PO, m, until the fingers have closed; the spread is in rad."""
    scenario = load_scenario("barrett_like")
    assert scenario.grip is not None
    controller = dataclasses.replace(scenario.grip.controller, fixed={"finger_1_spread_joint": spread})
    scenario.object = name
    scenario.grip = Grip(X_PO={name: Transform(translation=list(p_PO), rotation=rotation)}, controller=controller)
    scenario.estimation.estimator.period = 2.0 * scenario.duration  # Once at the start, before any contact.
    return scenario


UPRIGHT, LYING = Rotation(), Rotation(value=Rotation.Rpy(deg=[0.0, 90.0, 0.0]))
# On its side, with the handle up, rotated about the mug's axis by 25 degrees towards a finger.
HANDLE_UP = Rotation(value=Rotation.Rpy(deg=[-90.0, -65.0, 90.0]))
GRIPS = {
    "a) tea box, upright, an edge under a finger": make_grip("tea_box", (-0.016, 0.0, PAD_TOP - 0.0005), UPRIGHT),
    "b) tea box, lying, its end under a finger": make_grip("tea_box", (-0.020, 0.0, PAD_TOP + 0.0420), LYING),
    "c) can, upright": make_grip("soda_can", (0.0, 0.0, PAD_TOP - 0.0005), UPRIGHT, spread=0.6),
    "d) can, lying, its end under a finger": make_grip("soda_can", (-0.020, 0.0, PAD_TOP + 0.0326), LYING),
    "e) mug, lying, two fingers on its handle": make_grip("mug", (0.050, 0.0, PAD_TOP + 0.0405), HANDLE_UP),
    "f) thermal bottle, lying": make_grip("thermal_bottle", (-0.100, 0.0, PAD_TOP + 0.0335), LYING),
}


@dataclasses.dataclass(frozen=True, eq=False)
class PadGrasp:
    """The pads' readings of an object, and its pose.

    Attributes:
        model: the object; its frame O is at the centre of its bounding box, with the axes of its file.
        patches: patches in P, in the order of the hand's pads.
        X_PO: true pose of the object, shape (3, 4).
        q: positions of the hand's joints, in the order of its own plant, rad.
        objectives: the objectives that are compared, by name.
    """

    model: tp.ObjectModel
    patches: tuple[Patch, ...]
    X_PO: Array
    q: Array
    objectives: dict[str, LeastSquaresObjective]

    def felt(self, patches: tuple[Patch, ...]) -> "PadGrasp":
        """The same grasp with other patches."""
        return dataclasses.replace(self, patches=patches, objectives=make_objectives(self.model, patches))


class GripLostError(TactoposeError):
    """A simulated hand does not hold its object."""


def make_objectives(model: tp.ObjectModel, patches: tuple[Patch, ...]) -> dict[str, LeastSquaresObjective]:
    """The objectives that are compared, by name."""
    cloud = _point_grid(model)
    return {
        PCA: CovarianceMatching(cloud, patches, thickness=LAYER),
        DISTANCE: CellDistance(cloud, patches),
        OURS: PatchContact(model.grid, patches),
    }


@functools.cache
def _point_grid(model: tp.ObjectModel) -> PointGrid:
    return build_point_grid(model.samples.points)


def load_pad_grasp(name: str, scenario: Scenario) -> PadGrasp:
    """Reads a grip from the package's cache folder; simulates it and writes it there if it is missing.

    Raises:
        GripLostError: if the hand does not hold the object.
    """
    mesh = trimesh.load_mesh(scenario.object_mesh())
    content = b"with joints" + yaml_dump_typed(scenario).encode() + scenario.object_sdf().read_bytes()
    content += np.asarray(mesh.vertices).tobytes()
    own = Path(scenario.hand)
    hand_folder = own.parent if own.is_file() else model_path("hands", scenario.hand)
    hand_files = sorted(path for path in hand_folder.iterdir() if path.is_file())
    content += b"".join(path.read_bytes() for path in hand_files)
    folder = cache_folder() / "pad_grips"
    path = folder / f"{scenario.object}_{hashlib.blake2b(content, digest_size=6).hexdigest()}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        _save(path, name, scenario)
    with np.load(path) as arrays:
        pads = zip(arrays["p_PT"], arrays["n_PT"], arrays["pressure"], arrays["limits"], strict=True)
        patches = tuple(
            describe_patch(
                p_PT,
                pressure,
                alpha=alpha,
                n_PT=n_PT,
                threshold=threshold,
                saturation=saturation if math.isfinite(saturation) else None,
            )
            for p_PT, n_PT, pressure, (alpha, threshold, saturation) in pads
        )
        X_PO, q = arrays["X_PO"], arrays["q"]
    middle = mesh.bounds.mean(axis=0)
    X_PO[:, 3] += X_PO[:, :3] @ middle
    model = tp.ObjectModel.from_mesh(mesh.apply_translation(-middle), name=scenario.object)
    return PadGrasp(model, patches, X_PO, q, make_objectives(model, patches))


def _save(path: Path, name: str, scenario: Scenario) -> None:
    """Simulates a grip and writes it atomically, so that no reader sees half a file.

    Another process may write the same grip, with the same result.
    """
    result = simulate_grasp(scenario)
    if not result.stable:
        raise GripLostError(f"{name}: {result.reason}.")
    patches, q = (result.station.diagram.GetOutputPort(n).Eval(result.context) for n in ("patches", "joint_positions"))
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as file:
        np.savez(
            file,
            X_PO=result.X_PO.GetAsMatrix34(),
            q=q,
            p_PT=[patch.p_PT for patch in patches],
            n_PT=[patch.n_PT for patch in patches],
            pressure=[patch.pressure for patch in patches],
            limits=[(patch.alpha, patch.threshold, patch.saturation) for patch in patches],
        )
    os.replace(partial, path)


def displaced_poses(X_PO: Array, count: int, generator: np.random.Generator) -> Array:
    """Poses (count, 3, 4), rotated and translated from X_PO (3, 4) uniformly up to the maximum about and along each
    axis.
    """
    return retract(np.repeat(X_PO[None], count, axis=0), generator.uniform(-1.0, 1.0, (count, 6)) * UNITS)


class DisplacedSpace:
    """The box of possible true poses around a displaced one."""

    def __init__(self, X_PO: Array) -> None:
        self._X_PO = X_PO

    @property
    def center(self) -> Array:
        """The displaced pose, shape (3, 4)."""
        return self._X_PO

    @property
    def information(self) -> Array:
        """The inverse covariance of the box's poses, shape (6, 6)."""
        return np.diag(3.0 / UNITS**2)

    @property
    def reach(self) -> tuple[float, float]:
        """Half the box's size about and along each axis, rad and m."""
        return MOST_TURN, MOST_SHIFT

    def sample(self, generator: np.random.Generator, count: int) -> Array:
        """Random poses, shape (count, 3, 4)."""
        return displaced_poses(self._X_PO, count, generator)
