"""The topology of a triangle mesh: which faces share edges, which form bodies, and which edges bound holes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError

IntArray = NDArray[np.int64]
AnyIntArray = NDArray[np.int32] | IntArray

_COINCIDENT = 1e-5  # angle between two faces at an edge, rad, up to which they coincide: single-precision rounding


@dataclass(frozen=True, eq=False)
class FaceLinks:
    """Which half edges of faces meet. Half edge 3 f + c runs from corner c of face f to the next corner.

    Attributes:
        pairs: half edges that meet, shape (m, 2).
        open: half edges that meet no other, shape (b,).
        crowded: groups of half edges of an edge that more than two faces share.
    """

    pairs: IntArray
    open: IntArray
    crowded: tuple[IntArray, ...]


def half_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Start and end vertices of all half edges, each of shape (3 f,)."""
    return faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)


def link_faces(faces: IntArray) -> FaceLinks:
    """Matches half edges by their two vertices, regardless of direction."""
    code = _edge_codes(faces)
    order = np.argsort(code, kind="stable")
    first = np.flatnonzero(np.diff(code[order], prepend=-1))
    count = np.diff(first, append=len(order))
    two = first[count == 2]
    crowded = tuple(order[i : i + n] for i, n in zip(first[count > 2], count[count > 2], strict=True))
    return FaceLinks(np.stack([order[two], order[two + 1]], axis=1), order[first[count == 1]], crowded)


def second_sides(faces: IntArray) -> NDArray[np.bool_]:
    """Which faces are a doubled sheet's second side, which is no surface of its own, shape (f,).

    A sheet is a connected patch of faces that occur in both orientations. Where two bodies touch along it, two other
    faces meet it at its rim, and it bounds both. Its second side is a mere repetition if only one does, if the sheet
    has no rim, or if there is nothing but such sheets.

    Args:
        faces: vertex indices, shape (f, 3); none occurs twice in the same orientation.
    """
    _, first, group, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    group = group.reshape(-1)
    doubled: NDArray[np.bool_] = count[group] == 2
    second = doubled.copy()
    second[first] = False
    if doubled.all() or not doubled.any():
        return second
    sheet = first[count == 2]
    codes = _edge_codes(faces).reshape(-1, 3)
    others = np.sort(codes[~doubled], axis=None)
    code, edge, sides = np.unique(codes[sheet], return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    label = connected(len(sheet) + len(code), np.repeat(np.arange(len(sheet)), 3), len(sheet) + edge)
    patches = int(label.max()) + 1
    met = np.searchsorted(others, code, side="right") - np.searchsorted(others, code)
    rim = label[len(sheet) :][sides == 1]
    total = np.bincount(rim, minlength=patches)
    by_one = np.bincount(rim, weights=met[sides == 1] == 1, minlength=patches)
    kept_sheet = sheet[((total > 0) & (2 * by_one <= total))[label[: len(sheet)]]]
    second[np.isin(group, group[kept_sheet])] = False
    return second


def _edge_codes(faces: IntArray) -> IntArray:
    """A number for each half edge that depends on its two vertices, regardless of direction, shape (3 f,)."""
    start, end = half_edges(faces)
    codes: IntArray = np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)
    return codes


def agree_on_sides(faces: IntArray, pairs: IntArray) -> tuple[IntArray, int]:
    """Flips faces until linked faces are consistently oriented, in each body the minority; returns the number flipped.

    Raises:
        InvalidMeshError: if it is not orientable, like a Moebius strip.
    """
    start, _ = half_edges(faces)
    clash = start[pairs[:, 0]] == start[pairs[:, 1]]
    if not clash.any():
        return faces, 0
    count = len(faces)
    rows, columns = pairs[:, 0] // 3, pairs[:, 1] // 3
    graph = _graph(count, rows, columns).tocsr()
    clashes = {(int(a), int(b)) for a, b in zip(rows[clash], columns[clash], strict=True)}
    body = connected(count, rows, columns)
    turned = np.zeros(count, dtype=bool)
    roots = np.unique(body, return_index=True)[1]
    for root in np.unique(body[rows[clash]]):
        visited, predecessors = scipy.sparse.csgraph.breadth_first_order(graph, roots[root], directed=False)
        for face in visited[1:]:
            before = predecessors[face]
            turned[face] = turned[before] ^ ((before, face) in clashes or (face, before) in clashes)
    majority = np.bincount(body, weights=turned) * 2 > np.bincount(body)
    turned ^= majority[body]
    if np.any(clash != (turned[rows] != turned[columns])):
        raise InvalidMeshError("must have an inside, not only one side, like a Moebius strip.")
    return np.where(turned[:, None], faces[:, ::-1], faces), int(turned.sum())


def pair_around_edge(vertices: FloatArray, faces: IntArray, crowd: IntArray) -> IntArray:
    """Pairs the half edges of an edge that several bodies share, so that each pair bounds one wedge of solid.

    Seen along the edge, solid is clockwise of a face that runs with the edge and anticlockwise of one that runs against
    it. So, sorted by angle, each face against the edge is paired with the next one, which must run with it.

    Args:
        vertices: shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        crowd: the edge's half edges, shape (n,).

    Raises:
        InvalidMeshError: if the faces do not alternate.
    """
    start, end = faces[crowd // 3, crowd % 3], faces[crowd // 3, (crowd + 1) % 3]
    a, b = int(min(start[0], end[0])), int(max(start[0], end[0]))
    along = start == a
    place = np.round(0.5 * (vertices[a] + vertices[b]), 4).tolist()
    error = InvalidMeshError(
        f"must be manifold, with edges of two faces, or of bodies that touch, not with {len(crowd)} faces that share "
        f"the edge at {place} m and enclose no bodies."
    )
    if along.sum() * 2 != len(crowd):
        raise error
    edge = vertices[b] - vertices[a]
    edge /= max(float(np.linalg.norm(edge)), 1e-300)
    arm = vertices[faces[crowd // 3, (crowd + 2) % 3]] - vertices[a]
    arm -= np.outer(arm @ edge, edge)
    first = int(np.argmin(along))
    across = np.cross(edge, arm[first])
    angle = np.mod(np.arctan2(arm @ across, arm @ arm[first]), 2 * np.pi)
    # If two faces coincide, the wedge that ends there comes before the one that begins.
    angle[(angle >= 2 * np.pi - _COINCIDENT) | ((angle <= _COINCIDENT) & along)] = 2 * np.pi
    angle[first] = 0.0
    rising = np.argsort(angle)
    place = np.empty(len(crowd), dtype=np.int64)
    place[rising] = np.cumsum(np.diff(angle[rising], prepend=0.0) > _COINCIDENT)
    order = np.lexsort((~along, place))
    if np.any(along[order[0::2]]) or not np.all(along[order[1::2]]):
        raise error
    return crowd[np.stack([order[0::2], order[1::2]], axis=1)]


def split_vertices(faces: IntArray, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Splits vertices so that every fan of linked faces around a vertex has its own.

    Args:
        faces: vertex indices, shape (f, 3), linked faces consistently oriented.
        pairs: half edges that meet, shape (m, 2).

    Returns:
        The faces with new vertex indices (f, 3), and each new vertex's old index (v,).
    """
    start, _ = half_edges(faces)
    after = pairs - pairs % 3 + (pairs + 1) % 3  # the half edge that starts where this one ends
    corner = connected(
        len(start), np.concatenate([pairs[:, 0], after[:, 0]]), np.concatenate([after[:, 1], pairs[:, 1]])
    )
    old = np.empty(int(corner.max()) + 1, dtype=np.int64)
    old[corner] = start
    return corner.reshape(-1, 3), old


def edge_labels(count: int, pairs: IntArray) -> IntArray:
    """A label for each half edge of `count` faces, shape (3 count,): the same for the two of a pair."""
    label = np.arange(3 * count)
    label[pairs[:, 1]] = label[pairs[:, 0]]
    return label


def split_repeated_edges(vertices: FloatArray, faces: IntArray, label: IntArray) -> tuple[FloatArray, IntArray]:
    """Inserts a vertex into the middle of each edge that joins the same two vertices as another edge.

    Args:
        vertices: shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        label: the edge of each half edge, shape (3 f,), see `edge_labels`.
    """
    start, end = half_edges(faces)
    ends = np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1)
    _, first, edge = np.unique(label, return_index=True, return_inverse=True)
    _, kept = np.unique(ends[first], axis=0, return_index=True)
    repeated = np.setdiff1d(np.arange(len(first)), kept)
    if not len(repeated):
        return vertices, faces
    middle = np.full(len(first), -1)
    middle[repeated] = len(vertices) + np.arange(len(repeated))
    middles = middle[edge].reshape(-1, 3)
    cut = np.any(middles >= 0, axis=1)
    pieces = []
    for corners, between in zip(faces[cut].tolist(), middles[cut].tolist(), strict=True):
        rim = [vertex for pair in zip(corners, between, strict=True) for vertex in pair if vertex >= 0]
        apex = rim.index(max(between))
        rim = rim[apex:] + rim[:apex]
        pieces += [[rim[0], b, c] for b, c in itertools.pairwise(rim[1:])]
    return np.concatenate([vertices, vertices[ends[first[repeated]]].mean(axis=1)]), np.concatenate(
        [faces[~cut], np.array(pieces)]
    )


def connected(count: int, a: IntArray, b: IntArray) -> IntArray:
    """The component that each of `count` nodes belongs to, numbered from 0, shape (count,); edges join a to b, (e,)."""
    label = scipy.sparse.csgraph.connected_components(_graph(count, a, b), directed=False)[1]
    return np.asarray(label, dtype=np.int64)


def _graph(count: int, a: IntArray, b: IntArray) -> scipy.sparse.coo_array:
    return scipy.sparse.coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(count, count))


def body_labels(faces: IntArray) -> IntArray:
    """The body that each face belongs to, numbered from 0, shape (f,): faces that share a vertex are of one body."""
    label = connected(int(faces.max()) + 1, *half_edges(faces))
    return np.unique(label[faces[:, 0]], return_inverse=True)[1].astype(np.int64)


def boundary_loops(faces: IntArray, open_half_edges: IntArray) -> list[IntArray]:
    """The rims of a mesh's holes as closed chains of vertices; every vertex must be on at most one rim."""
    start, end = half_edges(faces)
    following = dict(zip(start[open_half_edges].tolist(), end[open_half_edges].tolist(), strict=True))
    loops = []
    while following:
        vertex = next(iter(following))
        loop = []
        while vertex in following:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop, dtype=np.int64))
    return loops
