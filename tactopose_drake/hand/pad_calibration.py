"""Calibration of a soft pad's alpha, the ratio of depth to pressure, by pressing known shapes on a simulated pad.

The pad is a flat elastic layer on a stiff core, in Drake's hydroelastic contact: the pressure at a depth d is
modulus * d / thickness. Rigid shapes, longer than the pad, tilt about its y axis and press down one end of it. With a
good alpha the pressures of the cells become points whose principal components are tilted like the shape.

The ideal layer has alpha = thickness / modulus. The best one for the descriptor differs by a few percent, because a
cell that a shape covers in part reads less than the depth below it.

Source: [B16] J. Bimbo, thesis, 2016, section 5.2.2, which uses finite elements.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Box,
    Cylinder,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    HydroelasticContactRepresentation,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import minimize_scalar

from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.sensing.tactile_array import mean_pressure
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CellRow, RowPattern
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_pressure import pressure_field

PAD_SIZE = (0.04, 0.015)  # m, along x and y
TILTS_DEG = (0.0, 2.0, 5.0, 7.0)  # [B16] table 5.1
DEPTH_SHARES = (0.25, 1 / 3, 0.4)  # of the layer's thickness, at the pad's lower end
OFFSETS = (0.0, 0.25, 0.5, 0.75)  # of a cell: where the shape's edges lie between the cells

_LENGTH = 0.12  # of the shapes, m: they reach beyond the pad at any tilt
_RIB = 0.008  # width of the thin shape and of the legs of the L, m


@dataclasses.dataclass(frozen=True)
class PressedShape:
    """A rigid shape: its underside is the plane z = 0 of its frame O, its length along x of O."""

    geometry: Shape
    X_OG: RigidTransform


@dataclasses.dataclass(frozen=True, eq=False)
class Press:
    """One simulated press.

    Attributes:
        shape: name of the pressed shape.
        tilt: tilt of the shape's underside about y, rad; positive lowers the end at +x.
        depth: depth of the underside below the undeformed pad at the pad's end, m.
        pressure: pressure on the cells, shape (m,), Pa.
    """

    shape: str
    tilt: float
    depth: float
    pressure: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class AlphaFit:
    """The result of `find_alpha`.

    Attributes:
        alpha: depth over pressure, m/Pa.
        layout: the simulated pad's cells; z of T points out of the pad.
        presses: the simulated presses.
        errors: tilt of each patch minus that of the shape, shape (k,), rad; NaN if only a row of cells feels it.
    """

    alpha: float
    layout: TactileLayout
    presses: tuple[Press, ...]
    errors: FloatArray


def cylinder(radius: float) -> PressedShape:
    """A lying cylinder; it touches along a line."""
    return PressedShape(
        Cylinder(radius, _LENGTH), RigidTransform(RotationMatrix.MakeYRotation(math.pi / 2), [0, 0, radius])
    )


def flat(width: float) -> PressedShape:
    """A bar's flat underside."""
    return PressedShape(Box(_LENGTH, width, 0.02), RigidTransform([0, 0, 0.01]))


def l_shape() -> PressedShape:
    """The flat underside of two ribs at right angles: one along the pad's side, one across its lower end."""
    x, y = 0.5 * PAD_SIZE[0], -0.5 * PAD_SIZE[1]
    outer_x, outer_y, inner_x, inner_y = x + 0.01, y - 0.01, x - _RIB, y + _RIB
    corners = np.array([
        [outer_x, outer_y], [outer_x, outer_y + _LENGTH], [inner_x, outer_y + _LENGTH], [inner_x, inner_y],
        [outer_x - _LENGTH, inner_y], [outer_x - _LENGTH, outer_y],
    ])  # fmt: skip
    vertices = [(*corner, z) for z in (0.0, 0.02) for corner in corners]
    below = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)]
    above = [(a + 6, c + 6, b + 6) for a, b, c in below]
    sides = [face for i in range(6) for j in [(i + 1) % 6] for face in ((i, j, j + 6), (i, j + 6, i + 6))]
    lines = [f"v {a:.9g} {b:.9g} {c:.9g}" for a, b, c in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in (*below, *above, *sides)]
    mesh = InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "l_shape"))
    return PressedShape(Mesh(mesh), RigidTransform())


@functools.cache
def thesis_shapes() -> Mapping[str, PressedShape]:
    """The shapes of [B16] table 5.1, which does not give their sizes. The cylinder is as thick as a bottle."""
    return {"cylinder": cylinder(0.035), "L-shape": l_shape(), "flat, wide": flat(0.1), "flat, thin": flat(_RIB)}


def find_alpha(*, modulus: float, thickness: float, cell: float = 0.001) -> AlphaFit:
    """Simulates presses, and fits alpha so that the patches' tilts match the shapes' in the least squares sense.

    Args:
        modulus: modulus of the soft layer, Pa; `hydroelastic_modulus` in a model.
        thickness: thickness of the soft layer, m; half the thickness of a box-shaped geometry, as Drake's pressure
            rises from its faces to its middle.
        cell: edge of the square cells, m.

    Raises:
        InvalidInputError: if a value is not positive, or fewer than three cells fit across the pad.
    """
    layout = pressed_pad(cell)
    presses = tuple(
        press
        for name, shape in thesis_shapes().items()
        for press in simulate_presses(name, shape, layout, modulus=modulus, thickness=thickness)
    )
    if np.all(np.isnan(tilt_errors(layout, presses, thickness / modulus))):
        raise InvalidInputError(f"thickness must be of a layer whose presses reach three cells, not {thickness:g} m.")
    return fit_alpha(layout, presses, thickness / modulus)


def fit_alpha(layout: TactileLayout, presses: Sequence[Press], near: float) -> AlphaFit:
    """Fits alpha so that the patches' tilts match those of the pressed shapes in the least squares sense.

    Args:
        layout: the cells.
        presses: presses, at least one of which reaches three cells.
        near: alpha is between 0.3 and 3 times this, m/Pa.
    """

    def cost(factor: float) -> float:
        return float(np.nansum(tilt_errors(layout, presses, factor * near) ** 2))

    alpha = near * float(minimize_scalar(cost, bounds=(0.3, 3.0), method="bounded", options={"xatol": 1e-5}).x)
    return AlphaFit(alpha, layout, tuple(presses), tilt_errors(layout, presses, alpha))


def pressed_pad(cell: float) -> TactileLayout:
    """Square cells that fill the pad, centred on T's origin; z out of the pad."""
    positive_number("cell", cell)
    rows, columns = (round(size / cell) for size in PAD_SIZE)
    if columns < 3:
        raise InvalidInputError(f"cell must be at most {PAD_SIZE[1] / 3:g} m, not {cell:g} m.")
    places = cell * (np.arange(rows) - 0.5 * (rows - 1))
    pattern = [CellRow(center=[float(x), 0.0, 0.0], count=columns, cell=[cell, cell]) for x in places]
    return RowPattern(pitch=cell, rows=pattern).make()


def simulate_presses(
    name: str, shape: PressedShape, layout: TactileLayout, *, modulus: float, thickness: float
) -> list[Press]:
    """Presses one shape at each of `TILTS_DEG`, `DEPTH_SHARES` and `OFFSETS`.

    Args:
        name: the shape's name.
        shape: the shape.
        layout: the cells, on the plane z = 0 of T.
        modulus: modulus of the soft layer, Pa.
        thickness: thickness of the soft layer, m.
    """
    positive_number("modulus", modulus)
    positive_number("thickness", thickness)
    rig = _Rig(shape, modulus, thickness)
    end, cell = layout.corners[..., 0].max(), math.sqrt(layout.areas[0])
    presses = []
    for tilt_deg in TILTS_DEG:
        tilt = math.radians(tilt_deg)
        for depth in thickness * np.array(DEPTH_SHARES):
            for offset in OFFSETS:
                # The underside is at this depth at the pad's end for every offset of the shape.
                x = y = offset * cell
                X_TO = RigidTransform(RotationMatrix.MakeYRotation(tilt), [x, y, math.tan(tilt) * (end - x) - depth])
                presses.append(Press(name, tilt, float(depth), rig.press(layout, X_TO)))
    return presses


def patch_of(layout: TactileLayout, press: Press, alpha: float) -> Patch:
    """The descriptor of a press, in T."""
    rounding = 1e-6 * press.pressure.max()  # ignores cells that the shape only touches at an edge
    return describe_patch(layout.p_TC, press.pressure, alpha=alpha, n_PT=layout.n_T, threshold=rounding)


def tilt_errors(layout: TactileLayout, presses: Sequence[Press], alpha: float) -> FloatArray:
    """Tilt of each patch about y minus that of the pressed shape, shape (k,), rad.

    NaN for a press that only a row of cells feels.
    """
    thirds = np.array([patch_of(layout, press, alpha).eigenvectors[:, 2] for press in presses])
    errors: FloatArray = np.arctan2(-thirds[:, 0], -thirds[:, 2]) - [press.tilt for press in presses]
    return errors


class _Rig:
    """A soft pad in the plane z = 0 of T, and a movable rigid shape."""

    def __init__(self, shape: PressedShape, modulus: float, thickness: float) -> None:
        scene_graph = SceneGraph()
        source = scene_graph.RegisterSource()
        # Pressure rises from every face of the box towards its middle; the margin keeps the side faces off the cells.
        size = [side + 6 * thickness for side in PAD_SIZE]
        pad = GeometryInstance(RigidTransform([0, 0, -thickness]), Box(*size, 2 * thickness), "pad")
        soft, rigid = ProximityProperties(), ProximityProperties()
        AddCompliantHydroelasticProperties(max(size), modulus, soft)
        pad.set_proximity_properties(soft)
        self._pad = scene_graph.RegisterAnchoredGeometry(source, pad)
        self._frame = scene_graph.RegisterFrame(source, GeometryFrame("O"))
        pressed = GeometryInstance(shape.X_OG, shape.geometry, "shape")
        AddRigidHydroelasticProperties(0.002, rigid)
        pressed.set_proximity_properties(rigid)
        scene_graph.RegisterGeometry(source, self._frame, pressed)
        self._scene_graph, self._source = scene_graph, source
        self._context = scene_graph.CreateDefaultContext()

    def press(self, layout: TactileLayout, X_TO: RigidTransform) -> FloatArray:
        """The pressure on the cells, shape (m,), Pa."""
        poses = FramePoseVector()
        poses.set_value(self._frame, X_TO)
        self._scene_graph.get_source_pose_port(self._source).FixValue(self._context, poses)
        query = self._scene_graph.get_query_output_port().Eval(self._context)
        surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
        fields = [pressure_field(s, RigidTransform(), pad_is_M=s.id_M() == self._pad) for s in surfaces]
        return mean_pressure(layout, fields)
