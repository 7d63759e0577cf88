"""Parsing of models with Drake, and the resolution of their `package://` URLs."""

import contextlib
import dataclasses
import os
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources.shipped_files import resource_root

_FARTHEST = 1000.0  # m


@dataclasses.dataclass(kw_only=True, slots=True)
class ModelPackage:
    """A package of models that a Python distribution installs."""

    name: str = ""  # the name in `package://<name>/...` URLs
    distribution: str = ""  # the distribution that contains it, as pip names it
    folder: str = ""  # its root among the distribution's files

    def path(self) -> Path:
        """The package's root.

        Raises:
            InvalidInputError: if the distribution is not installed, or has no such folder.
        """
        try:
            root = Path(str(distribution(self.distribution).locate_file(self.folder)))
        except (PackageNotFoundError, ValueError) as error:
            raise InvalidInputError(
                f"package {self.name!r}: the distribution {self.distribution!r} is not installed; "
                f"`pip install {self.distribution}` brings it."
            ) from error
        if not root.is_dir():
            raise InvalidInputError(f"package {self.name!r}: {self.distribution!r} has no folder {self.folder!r}.")
        return root


def make_parser(plant: MultibodyPlant, packages: Sequence[ModelPackage] = ()) -> Parser:
    """A parser that resolves `package://` URLs of tactopose_drake, of ROS_PACKAGE_PATH, and of the given packages.

    If a model's name is taken, the model is renamed, for example to `gripper_1`.

    Raises:
        InvalidInputError: if a package is not installed.
    """
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    parser.package_map().PopulateFromRosPackagePath()
    parser.package_map().Add("tactopose_drake", str(resource_root()))
    for package in packages:
        parser.package_map().Add(package.name, str(package.path()))
    return parser


@contextlib.contextmanager
def passing_builder() -> Iterator[DiagramBuilder]:
    """A builder for temporary systems. It builds a diagram at the end, without which Drake would never free them."""
    builder = DiagramBuilder()
    yield builder
    builder.Build()


def add_model(parser: Parser, model: str | Path) -> ModelInstanceIndex:
    """Parses a file that holds one model: an SDF, URDF or MJCF, given by path or URL.

    Raises:
        InvalidFileError: if there is no such file, Drake cannot read it, or it does not hold exactly one model.
    """
    if "://" not in str(model) and not os.path.exists(model):
        raise InvalidFileError(f"{model} must be an SDF, URDF or MJCF, but there is no such file.")
    try:
        instances = parser.AddModels(url=model) if "://" in str(model) else parser.AddModels(str(model))
    except (
        RuntimeError,
        ValueError,
        SystemExit,
    ) as error:  # Drake would end the process, as where a joint's limits are swapped.
        reason = " ".join(str(error).split()).removesuffix(".")
        advice = " Write meshes to collide with as OBJ, glTF or VTK." if "unsupported extension" in reason else ""
        if "unknown package" in reason:
            known = ", ".join(sorted(parser.package_map().GetPackageNames()))
            advice = f" Known are {known}: of folders on ROS_PACKAGE_PATH the <name> in their package.xml counts."
        raise InvalidFileError(f"{model} must be a model that Drake can read ({reason}).{advice}") from None
    if len(instances) != 1:
        raise InvalidFileError(f"{model} must hold 1 model, not {len(instances)}.")
    return instances[0]


def fixed_pose(name: str, transform: Transform) -> RigidTransform:
    """The pose of a transform in a file, which must not be random.

    Raises:
        InvalidInputError: if it is random, has a base frame, or is not a pose.
    """
    if not transform.IsDeterministic():  # Drake would abort the process.
        raise InvalidInputError(f"{name} must be a fixed pose, not a random one.")
    if transform.base_frame not in (None, "", "world"):
        raise InvalidInputError(f"{name}.base_frame must be left out, not {transform.base_frame!r}.")
    try:
        return _sound(name, transform.GetDeterministicValue())
    except RuntimeError as error:
        raise InvalidInputError(f"{name} must be a pose ({' '.join(str(error).split())}).") from None


def drawn_pose(name: str, transform: Transform, seed: int) -> RigidTransform:
    """The pose of a transform in a file, whose random parts are drawn with a seed.

    Raises:
        InvalidInputError: if it has a base frame, its ranges are invalid, or it is not a pose.
    """
    try:
        return _sound(name, transform.Sample(RandomGenerator(seed)))
    except RuntimeError as error:
        raise InvalidInputError(f"{name} must be a pose ({' '.join(str(error).split())}).") from None


def _sound(name: str, X: RigidTransform) -> RigidTransform:
    """Checks that a pose is valid and at most a kilometre from the origin; Drake accepts any matrix."""
    matrix = X.GetAsMatrix34()
    R, p = matrix[:, :3], matrix[:, 3]
    if not np.isfinite(matrix).all() or np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.norm(p) > _FARTHEST:
        raise InvalidInputError(f"{name} must be a pose of a rotation and at most {_FARTHEST:g} m.")
    return X
