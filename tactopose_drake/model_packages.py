"""Where `package://` URLs of models lead: to this package, to ROS packages, and to what other distributions bring."""

import dataclasses
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources import resource_root


@dataclasses.dataclass(kw_only=True, slots=True)
class ModelPackage:
    """A package of models that a Python distribution has installed."""

    name: str = ""  # what `package://<name>/...` calls it in the model's files
    distribution: str = ""  # the distribution that brings it, as pip names it
    folder: str = ""  # its root among the distribution's files

    def path(self) -> Path:
        """Its root.

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
    """A parser that resolves `package://tactopose_drake/...`, what ROS_PACKAGE_PATH leads to, and the given packages.

    Raises:
        InvalidInputError: if a package is not installed.
    """
    parser = Parser(plant)
    parser.package_map().PopulateFromRosPackagePath()
    parser.package_map().Add("tactopose_drake", str(resource_root()))
    for package in packages:
        parser.package_map().Add(package.name, str(package.path()))
    return parser


def add_model(parser: Parser, model: str | Path) -> ModelInstanceIndex:
    """Parses a file that holds one model: an SDF, URDF or MJCF, by path or by URL.

    Raises:
        InvalidFileError: if Drake cannot read the file, or it does not hold exactly one model.
    """
    try:
        instances = parser.AddModels(url=model) if "://" in str(model) else parser.AddModels(str(model))
    except RuntimeError as error:
        raise InvalidFileError(f"{model}: is no model that Drake can read ({' '.join(str(error).split())}).") from None
    if len(instances) != 1:
        raise InvalidFileError(f"{model}: holds {len(instances)} models; allowed is one.")
    return instances[0]
