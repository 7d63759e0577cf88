"""A small depth-buffer renderer, for pictures where there is no display, GPU or browser; its loops compiled by numba.

Sources: [B77] J. Blinn, Models of light reflection for computer synthesized pictures, SIGGRAPH, 1977.
"""

import dataclasses
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray

# Surfaces nearer to the camera than this are not drawn, m.
_NEAR = 1e-3
# Share of a framed image that stays free on each side.
_MARGIN = 0.03
# Directions towards the lights in the camera's frame (right, down, forward), and their strengths.
_KEY_LIGHT, _KEY = (-0.45, -0.65, -0.61), 0.62
_FILL_LIGHT, _FILL = (0.80, -0.10, -0.59), 0.22
_AMBIENT = 0.34
_GLOSS, _GLOSS_EXPONENT = 0.16, 40


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera C: x to the right, y down, z forward.

    Attributes:
        X_CP: pose of the scene's frame in the camera, shape (3, 4).
        focal_length: pixels.
        width, height: of the image, pixels.
    """

    X_CP: FloatArray
    focal_length: float
    width: int
    height: int

    @classmethod
    def framing(
        cls,
        points: FloatArray,
        direction: FloatArray,
        up: FloatArray,
        width: int,
        height: int,
        field_of_view: float = 0.45,
    ) -> Self:
        """A camera that sees all of the points, and fills the image with them but for a margin.

        Args:
            points: shape (n, 3), m.
            direction: from the points to the camera, shape (3,).
            up: shape (3,), not along `direction`.
            width: pixels.
            height: pixels.
            field_of_view: of the smaller side, rad.
        """
        forward = -direction / np.linalg.norm(direction)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        R_CP = np.stack([right, np.cross(forward, right), forward])
        focal_length = 0.5 * min(width, height) / np.tan(0.5 * field_of_view)
        slopes = (1.0 - 2.0 * _MARGIN) * 0.5 * np.array([width, height]) / focal_length
        seen = points @ R_CP.T
        # Along each image axis the two outermost rays fix the centre and the distance.
        highest = (seen[:, :2] + slopes * -seen[:, 2:]).max(axis=0)
        lowest = (seen[:, :2] - slopes * -seen[:, 2:]).min(axis=0)
        distance = float(np.max((highest - lowest) / (2.0 * slopes)))
        p_CP = np.append(-0.5 * (highest + lowest), distance)
        return cls(np.column_stack([R_CP, p_CP]), float(focal_length), width, height)


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
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


def render(surface: Surface, camera: Camera) -> Layer:
    """Draws a surface: nearest triangle per pixel, smooth normals, two lights that go with the camera."""
    R_CP, p_CP = camera.X_CP[:, :3], camera.X_CP[:, 3]
    p_C = surface.vertices @ R_CP.T + p_CP
    inverse_depth, face, weights, faces = _nearest_faces(p_C, surface.faces, camera)
    colour, facing = _shade(face, weights, faces, p_C, surface.normals @ R_CP.T, surface.colour)
    return Layer(colour, inverse_depth, facing)


def inverse_depths(vertices: FloatArray, faces: NDArray[np.int32], camera: Camera) -> NDArray[np.float32]:
    """What a depth camera sees of triangles: 1 / z of the nearest one at each pixel, 0 where there is none.

    Args:
        vertices: in the scene's frame, shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        camera: where it is seen from.

    Returns:
        Shape (height, width), 1/m.
    """
    nearest: NDArray[np.float32] = _nearest_faces(vertices @ camera.X_CP[:, :3].T + camera.X_CP[:, 3], faces, camera)[0]
    return nearest


def _nearest_faces(
    p_C: FloatArray, faces: NDArray[np.int32], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32], NDArray[np.int32]]:
    """Inverse depth, face and weights of its corners at each pixel; the faces that lie before the camera."""
    depth = np.maximum(p_C[:, 2], 1e-9)
    pixels = camera.focal_length * p_C[:, :2] / depth[:, None] + 0.5 * np.array([camera.width, camera.height])
    visible = np.all(p_C[faces, 2] > _NEAR, axis=1)
    chosen = np.ascontiguousarray(faces[visible], dtype=np.int32)
    inverse_depth, face, weights = _rasterize(pixels, 1.0 / depth, chosen, camera.width, camera.height)
    return inverse_depth, face, weights, chosen


@njit(cache=True)
def _rasterize(pixels, inverse_depths, faces, width, height):  # type: ignore[no-untyped-def]
    """For each pixel the nearest face, its inverse depth, and the weights of its corners there."""
    nearest = np.zeros((height, width), dtype=np.float32)
    face = np.full((height, width), -1, dtype=np.int32)
    weights = np.zeros((height, width, 3), dtype=np.float32)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by = pixels[a, 0], pixels[a, 1], pixels[b, 0], pixels[b, 1]
        cx, cy = pixels[c, 0], pixels[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        left, right = max(0, int(np.ceil(min(ax, bx, cx) - 0.5))), min(width - 1, int(max(ax, bx, cx) - 0.5))
        top, bottom = max(0, int(np.ceil(min(ay, by, cy) - 0.5))), min(height - 1, int(max(ay, by, cy) - 0.5))
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                u, v, w = u * inverse_depths[a], v * inverse_depths[b], w * inverse_depths[c]
                here = u + v + w
                if here > nearest[row, column]:
                    nearest[row, column] = here
                    face[row, column] = f
                    weights[row, column, 0] = u / here
                    weights[row, column, 1] = v / here
                    weights[row, column, 2] = w / here
    return nearest, face, weights


@njit(cache=True)
def _shade(face, weights, faces, p_C, n_C, albedo):  # type: ignore[no-untyped-def]
    """Colour and cosine of the angle of view at each pixel; the highlight is [B77]'s."""
    height, width = face.shape
    colour = np.zeros((height, width, 3), dtype=np.float32)
    facing = np.zeros((height, width), dtype=np.float32)
    n, eye, base = np.empty(3), np.empty(3), np.empty(3)
    for row in range(height):
        for column in range(width):
            f = face[row, column]
            if f < 0:
                continue
            w = weights[row, column]
            for i in range(3):
                n[i] = eye[i] = base[i] = 0.0
                for corner in range(3):
                    vertex = faces[f, corner]
                    n[i] += w[corner] * n_C[vertex, i]
                    eye[i] -= w[corner] * p_C[vertex, i]
                    base[i] += w[corner] * albedo[vertex, i]
            n /= max(np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2), 1e-9)
            eye /= np.sqrt(eye[0] ** 2 + eye[1] ** 2 + eye[2] ** 2)
            cosine = n[0] * eye[0] + n[1] * eye[1] + n[2] * eye[2]
            if cosine < 0.0:  # the inside of an open mesh is lit like its outside
                cosine = -cosine
                n *= -1.0
            key = n[0] * _KEY_LIGHT[0] + n[1] * _KEY_LIGHT[1] + n[2] * _KEY_LIGHT[2]
            fill = n[0] * _FILL_LIGHT[0] + n[1] * _FILL_LIGHT[1] + n[2] * _FILL_LIGHT[2]
            hx, hy, hz = _KEY_LIGHT[0] + eye[0], _KEY_LIGHT[1] + eye[1], _KEY_LIGHT[2] + eye[2]
            half = (n[0] * hx + n[1] * hy + n[2] * hz) / max(np.sqrt(hx * hx + hy * hy + hz * hz), 1e-9)
            gloss = _GLOSS * max(half, 0.0) ** _GLOSS_EXPONENT
            light = _AMBIENT + _KEY * max(key, 0.0) + _FILL * max(fill, 0.0)
            for i in range(3):
                colour[row, column, i] = min(base[i] * light + gloss, 1.0)
            facing[row, column] = cosine
    return colour, facing
