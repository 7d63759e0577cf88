"""Reads OBJ files of vertices and triangles only, such as this package's own, without loading trimesh.

Loading trimesh takes most of a second, and its reader twenty times as long as this one. The result is the same as its
reader's. Any other file is left to trimesh.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray

LARGEST_PLAIN = 32 * 2**20
"""Largest file, bytes; in a larger one the numbers, each temporarily a string, would take gigabytes."""


def plain_obj(content: bytes) -> tuple[FloatArray, NDArray[np.int64]] | None:
    """Vertices (v, 3) and faces (f, 3) of a file with one part; None if it contains anything else, or is malformed.

    A face has three vertices, optionally with the normals of the same numbers, and each vertex belongs to a face.
    """
    rows = [row for row in map(bytes.split, content.splitlines()) if row and not row[0].startswith(b"#")]
    vertices = [row[1:] for row in rows if row[0] == b"v"]
    faces = [row[1:] for row in rows if row[0] == b"f"]
    if len(vertices) + len(faces) + sum(row[0] == b"vn" for row in rows) < len(rows):
        return None
    corners = [corner.partition(b"//") for face in faces for corner in face]
    if not corners or any(row and len(row) != 3 for row in (*vertices, *faces)):
        return None
    if any(between and number != normal for number, between, normal in corners):
        return None
    try:
        points = np.array(vertices).astype(np.float64)
        index = np.array([number for number, _, _ in corners]).astype(np.int64).reshape(-1, 3) - 1
    except (ValueError, OverflowError):
        return None
    if index.min() < 0 or index.max() >= len(points) or not np.bincount(index.ravel(), minlength=len(points)).all():
        return None
    return points, index
