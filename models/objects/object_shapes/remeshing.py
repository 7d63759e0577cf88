"""Remeshing of a closed surface: well-shaped triangles whose edges have a wanted local length.

The moves are those of [BK04] Botsch, Kobbelt, A remeshing approach to multiresolution modeling, 2004: split long
edges, collapse short ones, flip towards Delaunay. (The caller does the relaxation between the rounds, because it needs
the surface itself.) They are executed one by one on plain floats, so that every machine takes the same decisions.
"""

import math
from collections.abc import Iterator
from itertools import combinations

Point = tuple[float, float, float]


def _sub(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _midpoint(a: Point, b: Point) -> Point:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2


class Remesher:
    """A closed triangle mesh that is changed by local moves; vertices and faces keep their numbers until dropped.

    Attributes:
        points: position of each vertex, m; those of dropped vertices are stale.
        lengths: wanted length of the edges at each vertex, m.
        faces: corners of the faces in use, counter-clockwise from outside, by number.
        around: the numbers of the faces at each vertex; empty for a dropped vertex.
    """

    def __init__(self, points: list[Point], faces: list[tuple[int, int, int]], lengths: list[float]) -> None:
        self.points, self.lengths = list(points), list(lengths)
        self.faces = dict(enumerate(faces))
        self.around: list[set[int]] = [set() for _ in points]
        for number, face in self.faces.items():
            for corner in face:
                self.around[corner].add(number)
        self._next_face = len(faces)

    def split_long_edges(self) -> None:
        """Splits the edges that are longer than 4/3 of the wanted length in two; one pass."""
        for a, b in self._edges():
            if b in self._neighbours(a) and self._excess(a, b) > 4 / 3:
                self._split(a, b)

    def collapse_short_edges(self) -> None:
        """Merges the ends of edges shorter than 4/5 of the wanted length, if the surface remains a manifold."""
        for a, b in self._edges():
            if self.around[a] and self.around[b] and b in self._neighbours(a) and self._excess(a, b) < 4 / 5:
                self._collapse(a, b)

    def flip_edges(self) -> None:
        """Flips the edges whose opposite angles sum to more than 180 degrees, if the surface is nearly flat."""
        for a, b in self._edges():
            if b in self._neighbours(a):
                self._flip(a, b)

    def _edges(self) -> list[tuple[int, int]]:
        pairs = {(min(a, b), max(a, b)) for face in self.faces.values() for a, b in combinations(face, 2)}
        return sorted(pairs)

    def _neighbours(self, vertex: int) -> set[int]:
        return {corner for face in self.around[vertex] for corner in self.faces[face]} - {vertex}

    def _excess(self, a: int, b: int) -> float:
        edge = _sub(self.points[a], self.points[b])
        return math.sqrt(_dot(edge, edge)) / min(self.lengths[a], self.lengths[b])

    def _normal(self, face: tuple[int, int, int]) -> Point:
        p, q, r = (self.points[corner] for corner in face)
        return _cross(_sub(q, p), _sub(r, p))

    def _wings(self, a: int, b: int) -> Iterator[tuple[int, int]]:
        """The two faces at an edge, each with its third corner."""
        for number in sorted(self.around[a] & self.around[b]):
            (third,) = set(self.faces[number]) - {a, b}
            yield number, third

    def _replace(self, number: int, face: tuple[int, int, int] | None) -> None:
        """Drops a face, or sets it, which may be new."""
        for corner in self.faces.pop(number, ()):
            self.around[corner].discard(number)
        if face is not None:
            self.faces[number] = face
            for corner in face:
                self.around[corner].add(number)

    def _split(self, a: int, b: int) -> None:
        middle = len(self.points)
        self.points.append(_midpoint(self.points[a], self.points[b]))
        self.lengths.append(min(self.lengths[a], self.lengths[b]))
        self.around.append(set())
        for number, _ in list(self._wings(a, b)):
            face = self.faces[number]
            self._replace(number, tuple(middle if corner == b else corner for corner in face))
            self._replace(self._next_face, tuple(middle if corner == a else corner for corner in face))
            self._next_face += 1

    def _collapse(self, a: int, b: int) -> None:
        dropped = self.around[a] & self.around[b]
        if len(self._neighbours(a) & self._neighbours(b)) != 2:
            return
        middle = _midpoint(self.points[a], self.points[b])
        moved = (self.around[a] | self.around[b]) - dropped
        for number in moved:
            face = self.faces[number]
            before = self._normal(face)
            p, q, r = (middle if corner in (a, b) else self.points[corner] for corner in face)
            after = _cross(_sub(q, p), _sub(r, p))
            if _dot(before, after) < 0.5 * math.sqrt(_dot(before, before) * _dot(after, after)):
                return
        for number in dropped:
            self._replace(number, None)
        for number in self.around[b].copy():
            self._replace(number, tuple(a if corner == b else corner for corner in self.faces[number]))
        self.points[a] = middle
        self.lengths[a] = min(self.lengths[a], self.lengths[b])

    def _flip(self, a: int, b: int) -> None:
        (one, c), (two, d) = self._wings(a, b)
        if d in self._neighbours(c) or min(len(self.around[a]), len(self.around[b])) <= 3:
            return
        if self._cotangent(a, b, c) + self._cotangent(a, b, d) >= -1e-9:
            return
        n_1, n_2 = self._normal(self.faces[one]), self._normal(self.faces[two])
        face_1 = tuple(d if corner == b else corner for corner in self.faces[one])
        face_2 = tuple(c if corner == a else corner for corner in self.faces[two])
        turned = (self._normal(face_1), self._normal(face_2))
        for old in (n_1, n_2):
            for new in turned:
                if _dot(old, new) < 0.8 * math.sqrt(_dot(old, old) * _dot(new, new)):
                    return
        self._replace(one, face_1)
        self._replace(two, face_2)

    def _cotangent(self, a: int, b: int, apex: int) -> float:
        u, v = _sub(self.points[a], self.points[apex]), _sub(self.points[b], self.points[apex])
        normal = _cross(u, v)
        return _dot(u, v) / max(math.sqrt(_dot(normal, normal)), 1e-300)
