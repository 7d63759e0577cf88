"""A small depth-buffer renderer, for pictures without a display, GPU or browser; its loops are compiled.

Sources: [B77] J. Blinn, Models of light reflection for computer synthesized pictures, SIGGRAPH, 1977.
"""

import dataclasses
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.raster_kernels import rasterize, shade

# Surfaces nearer to the camera than this are not drawn, m, as a pinhole camera cannot show what is beside or behind it.
_NEAR = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera C: x to the right, y down, z forward.

    Attributes:
        X_CP: pose of the scene's frame in the camera, shape (3, 4).
        focal_length: pixels.
        width, height: of the image, pixels.
        center: where the camera's axis meets the image, pixels to the right of and below its upper left corner.
    """

    X_CP: FloatArray
    focal_length: float
    width: int
    height: int
    center: tuple[float, float]

    @classmethod
    def framing(
        cls,
        points: FloatArray,
        direction: FloatArray,
        up: FloatArray,
        width: int,
        height: int,
        field_of_view: float = 0.45,
        margin: float = 0.03,
    ) -> Self:
        """A camera that sees all of the points, which fill the image up to a margin.

        Args:
            points: shape (n, 3), m.
            direction: from the points to the camera, shape (3,).
            up: shape (3,), not along `direction`.
            width: pixels.
            height: pixels.
            field_of_view: of the smaller side, rad.
            margin: share of the image that stays free on each side.
        """
        forward = -direction / np.linalg.norm(direction)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        R_CP = np.stack([right, np.cross(forward, right), forward])
        focal_length = 0.5 * min(width, height) / np.tan(0.5 * field_of_view)
        slopes = (1.0 - 2.0 * margin) * 0.5 * np.array([width, height]) / focal_length
        seen = points @ R_CP.T
        # Along each image axis the two outermost rays fix the centre and the distance.
        highest = (seen[:, :2] + slopes * -seen[:, 2:]).max(axis=0)
        lowest = (seen[:, :2] - slopes * -seen[:, 2:]).min(axis=0)
        distance = float(np.max((highest - lowest) / (2.0 * slopes)))
        p_CP = np.append(-0.5 * (highest + lowest), distance)
        center = 0.5 * width, 0.5 * height
        return cls(np.column_stack([R_CP, p_CP]), float(focal_length), width, height, center)


@dataclasses.dataclass(frozen=True, eq=False)
class DrawnSurface:
    """Triangles to be drawn.

    Attributes:
        vertices: shape (v, 3), m.
        normals: outward unit normals at the vertices, shape (v, 3).
        faces: vertex indices, shape (f, 3).
        colour: red, green, blue of each vertex, shape (v, 3), 0 to 1.
    """

    vertices: FloatArray
    normals: FloatArray
    faces: NDArray[np.int32]
    colour: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Layer:
    """The nearest surface at each pixel.

    Attributes:
        colour: shaded colour, shape (height, width, 3), 0 to 1; zero where there is no surface.
        inverse_depth: 1 / z, shape (height, width), 1/m; 0 where there is no surface.
        facing: cosine between normal and line of sight, shape (height, width), 0 to 1.
    """

    colour: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]
    facing: NDArray[np.float32]

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Where there is a surface, shape (height, width)."""
        covered: NDArray[np.bool_] = self.inverse_depth > 0.0
        return covered


def render(surface: DrawnSurface, camera: Camera) -> Layer:
    """Draws a surface: nearest triangle per pixel, smooth normals, two lights fixed to the camera."""
    R_CP, p_CP = camera.X_CP[:, :3], camera.X_CP[:, 3]
    p_C = surface.vertices @ R_CP.T + p_CP
    inverse_depth, face, weights, faces = _nearest_faces(p_C, surface.faces, camera)
    colour, facing = shade(face, weights, faces, p_C, surface.normals @ R_CP.T, surface.colour)
    return Layer(colour, inverse_depth, facing)


def inverse_depths(vertices: FloatArray, faces: NDArray[np.int32], camera: Camera) -> NDArray[np.float32]:
    """The depth image of triangles: 1 / z of the nearest one at each pixel, 0 if there is none.

    Args:
        vertices: in the scene's frame, shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        camera: the viewpoint.

    Returns:
        Shape (height, width), 1/m.
    """
    nearest: NDArray[np.float32] = _nearest_faces(vertices @ camera.X_CP[:, :3].T + camera.X_CP[:, 3], faces, camera)[0]
    return nearest


def _nearest_faces(
    p_C: FloatArray, faces: NDArray[np.int32], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32], NDArray[np.int32]]:
    """Inverse depth, face and weights of its corners at each pixel; and the faces in front of the camera."""
    depth = np.maximum(p_C[:, 2], 1e-9)
    pixels = camera.focal_length * p_C[:, :2] / depth[:, None] + camera.center
    before = p_C[:, 2] > _NEAR
    chosen = np.ascontiguousarray(faces if before.all() else faces[before[faces].all(axis=1)], dtype=np.int32)
    inverse_depth, face, weights = rasterize(pixels, 1.0 / depth, chosen, camera.width, camera.height)
    return inverse_depth, face, weights, chosen
