"""A convex prism with a soft skin, as tetrahedra whose corners are on its faces or at the skin's depth.

Drake's hydroelastic pressure over a mesh is linear on each tetrahedron: zero on the mesh's faces, and maximal at the
deepest corners. Since all inner corners are at the skin's depth, the pressure in the skin is
modulus * depth / thickness everywhere, and constant below it: a soft layer of uniform thickness on a stiff core.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def soft_prism(outline: Array, half_width: float, thickness: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and tetrahedra of a prism along z.

    Args:
        outline: corners of its convex cross-section in x and y, counterclockwise, shape (k, 2), m.
        half_width: half of its extent along z, m.
        thickness: thickness of the skin, m.

    Returns:
        Vertices, shape (4 k, 3), m, the outer ones first; tetrahedra, shape (t, 4), of positive volume.
    """
    k = len(outline)
    outer = np.concatenate([np.column_stack([outline, np.full(k, z)]) for z in (-half_width, half_width)])
    inset, depth = inset_polygon(outline, thickness), half_width - thickness
    inner = np.concatenate([np.column_stack([inset, np.full(k, z)]) for z in (-depth, depth)])
    vertices = np.concatenate([outer, inner])
    faces = prism_faces(k)
    tetrahedra = []
    for face in faces:
        # The prism between an outer triangle and the inner one below it, split by the order of the indices, so that
        # neighbours agree on the diagonals between them.
        a, b, c = sorted(face)
        tetrahedra += [(a, b, c, c + 2 * k), (a, b, c + 2 * k, b + 2 * k), (a, b + 2 * k, c + 2 * k, a + 2 * k)]
    # The core is a fan from its corner 0. Its faces there have diagonals that end in that corner.
    tetrahedra += [(2 * k, *(2 * k + i for i in face)) for face in faces if 0 not in face]
    tetrahedra_array = np.array(tetrahedra, dtype=np.int64)
    volume = volumes(vertices, tetrahedra_array)
    flat = np.abs(volume) < 1e-9 * np.abs(volume).max()
    tetrahedra_array[volume < 0] = tetrahedra_array[volume < 0][:, [0, 1, 3, 2]]
    return vertices, tetrahedra_array[~flat]


def prism_faces(k: int) -> list[tuple[int, int, int]]:
    """Triangles of a prism's surface, seen from outside counterclockwise: bottom 0 to k - 1, top k to 2 k - 1.

    The diagonals of all faces with corner 0 end there.
    """
    faces = []
    for i in range(k):
        j = (i + 1) % k
        if j == 0:
            faces += [(i, 0, k + i), (0, k, k + i)]
        else:
            faces += [(i, j, k + j), (i, k + j, k + i)]
        if 0 < i < k - 1:
            faces += [(0, j, i), (k, k + i, k + j)]
    return faces


def inset_polygon(outline: Array, distance: float) -> Array:
    """A convex polygon with every edge moved inwards, shape (k, 2)."""
    edges = np.roll(outline, -1, axis=0) - outline
    inward = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    offset = np.einsum("ki,ki->k", inward, outline) + distance
    corners = [np.linalg.solve(inward[[i - 1, i]], offset[[i - 1, i]]) for i in range(len(outline))]
    return np.array(corners)


def volumes(vertices: Array, tetrahedra: NDArray[np.int64]) -> Array:
    """Signed volumes of tetrahedra, m^3."""
    a, b, c, d = vertices[tetrahedra].transpose(1, 0, 2)
    signed: Array = np.einsum("ti,ti->t", np.cross(b - a, c - a), d - a) / 6
    return signed


def vtk_text(vertices: Array, tetrahedra: NDArray[np.int64]) -> str:
    """A mesh of tetrahedra as a legacy VTK file."""
    points = "\n".join(" ".join(f"{x:.9g}" for x in vertex) for vertex in vertices)
    cells = "\n".join("4 " + " ".join(str(i) for i in cell) for cell in tetrahedra)
    return (
        "# vtk DataFile Version 3.0\nWritten by generate.py\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS {len(vertices)} double\n{points}\n"
        f"CELLS {len(tetrahedra)} {5 * len(tetrahedra)}\n{cells}\n"
        f"CELL_TYPES {len(tetrahedra)}\n" + "10\n" * len(tetrahedra)
    )


def obj_text(vertices: Array, k: int) -> str:
    """The surface of the prism as a Wavefront OBJ file with a normal for each face."""
    faces = prism_faces(k)
    normals = [np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a]) for a, b, c in faces]
    lines = ["# Written by generate.py"]
    lines += ["v " + " ".join(f"{x:.9g}" for x in vertex) for vertex in vertices[: 2 * k]]
    lines += ["vn " + " ".join(f"{x:.6f}" for x in n / np.linalg.norm(n)) for n in normals]
    lines += ["f " + " ".join(f"{i + 1}//{n + 1}" for i in face) for n, face in enumerate(faces)]
    return "\n".join(lines) + "\n"
