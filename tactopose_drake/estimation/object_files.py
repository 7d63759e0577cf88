"""Loading of an object's model from a mesh, SDF, URDF or MJCF file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.errors import InvalidFileError

_SIMULATED = {".sdf", ".urdf", ".xml"}


def load_object(
    path: str | Path,
    *,
    scale: float = 1.0,
    symmetry: Literal["auto", "none"] | Sequence[RotationalSymmetry] = "auto",
    mass: float | None = None,
    surface_sigma: float = 0.0,
    scale_sigma: float = 0.0,
) -> ObjectModel:
    """The model of a mesh, or of one body in an SDF, URDF or MJCF file: its collision shapes, mass and mass centre.

    Args:
        path: the file. O is the mesh's frame, or the body's.
        scale: metres per unit of the mesh; must be 1 for the other formats, which are in metres.
        symmetry: as in `ObjectModel.from_mesh`.
        mass: mass, kg; None: the file's.
        surface_sigma: standard deviation of the surface, m, as in `ObjectModel.from_mesh`.
        scale_sigma: relative standard deviation of the scale, likewise.

    Raises:
        InvalidFileError: if the file cannot be read, or holds more than one body or no shape with an inside.
        InvalidInputError: as in `ObjectModel.from_mesh`.
    """
    path = Path(path)
    if path.suffix.lower() not in _SIMULATED:
        return ObjectModel.from_mesh(
            path, scale=scale, symmetry=symmetry, mass=mass, surface_sigma=surface_sigma, scale_sigma=scale_sigma
        )
    if scale != 1.0:
        raise InvalidFileError(f"{path}: scale must be 1, as only meshes may be in another unit, not {scale:g}.")
    # Imported only for such files: it loads modules that meshes do not need.
    from tactopose_drake.estimation.simulated_body import read_body

    body = read_body(path)
    return ObjectModel.from_mesh(
        body.shape,
        name=path.stem,
        symmetry=symmetry,
        mass=body.mass if mass is None else mass,
        center_of_mass=body.center_of_mass,
        surface_sigma=surface_sigma,
        scale_sigma=scale_sigma,
    )
