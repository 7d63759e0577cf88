"""Rasterisation and shading of triangles, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Ints2, Singles2, Singles3

# The look of pictures; nothing is measured in them. Constants, so that the compiler knows the exponent.
# Directions towards the lights in the camera's frame (right, down, forward), and their strengths.
_KEY_LIGHT, _KEY = (-0.45, -0.65, -0.61), 0.62
_FILL_LIGHT, _FILL = (0.80, -0.10, -0.59), 0.22
_AMBIENT = 0.34
_GLOSS, _GLOSS_EXPONENT = 0.16, 40


@kernel
def rasterize(
    pixels: Floats2, inverse_depths: Floats1, faces: Ints2, width: int, height: int
) -> tuple[Singles2, Ints2, Singles3]:
    """For each pixel the nearest face, its inverse depth, and the barycentric weights of its corners there."""
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


@kernel
def shade(
    face: Ints2, weights: Singles3, faces: Ints2, p_C: Floats2, n_C: Floats2, albedo: Floats2
) -> tuple[Singles3, Singles3]:
    """Colour and cosine of the viewing angle at each pixel; the highlight is that of [B77]."""
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
