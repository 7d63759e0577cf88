"""Any number of objects with everyday shapes and random dimensions.

    python examples/object_families.py --count 1000 --seed 0 --out library

writes an STL file for each, named after its family: a library for `tactopose identify`. The same seed gives the same
objects; a smaller count gives the first objects of a larger one.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from rich.progress import track

Generator = np.random.Generator
_SEGMENTS = 48


def _between(generator: Generator, low: float, high: float) -> float:
    return float(generator.uniform(low, high))


def _revolved(profile: ArrayLike) -> trimesh.Trimesh:
    """The solid of revolution of a profile (r, z) in m, which goes from the bottom's middle outwards and up."""
    return trimesh.creation.revolve(np.asarray(profile), sections=_SEGMENTS)


def _block(size: ArrayLike, center: ArrayLike) -> trimesh.Trimesh:
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def _union(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return _tidied(trimesh.boolean.union(meshes, engine="manifold"))


def _tidied(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Removes the slivers that boolean operations leave, and merges vertices that are equal in single precision."""
    mesh.merge_vertices(digits_vertex=6)
    mesh.update_faces(mesh.nondegenerate_faces())
    return mesh


def _box(generator: Generator) -> trimesh.Trimesh:
    return trimesh.creation.box(generator.uniform(0.03, 0.15, 3))


def _cylinder(generator: Generator) -> trimesh.Trimesh:
    radius, height = _between(generator, 0.015, 0.05), _between(generator, 0.03, 0.2)
    return trimesh.creation.cylinder(radius, height, sections=_SEGMENTS)


def _capsule(generator: Generator) -> trimesh.Trimesh:
    radius, height = _between(generator, 0.012, 0.04), _between(generator, 0.03, 0.15)
    return trimesh.creation.capsule(height, radius, count=[24, 24])


def _frustum(generator: Generator) -> trimesh.Trimesh:
    wide, height = _between(generator, 0.025, 0.06), _between(generator, 0.04, 0.18)
    narrow = wide * _between(generator, 0.2, 0.85)
    return _revolved([[0, 0], [wide, 0], [narrow, height], [0, height]])


def _prism(generator: Generator) -> trimesh.Trimesh:
    sides, radius = int(generator.choice([3, 5, 6, 8])), _between(generator, 0.02, 0.06)
    return trimesh.creation.cylinder(radius, _between(generator, 0.03, 0.15), sections=sides)


def _superquadric(generator: Generator) -> trimesh.Trimesh:
    """A superquadric, from an icosphere [Barr 1981, Superquadrics and angle-preserving transformations]."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    x, y, z = mesh.vertices.T
    exponents = generator.uniform(0.4, 1.5, 2)
    around, up = np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))

    def power(value: NDArray[np.float64], exponent: float) -> NDArray[np.float64]:
        return np.sign(value) * np.abs(value) ** exponent

    level = power(np.cos(up), exponents[0])
    rows = [level * power(np.cos(around), exponents[1]), level * power(np.sin(around), exponents[1])]
    mesh.vertices = np.column_stack([*rows, power(np.sin(up), exponents[0])]) * generator.uniform(0.02, 0.07, 3)
    return mesh


def _bottle(generator: Generator) -> trimesh.Trimesh:
    radius, body = _between(generator, 0.02, 0.05), _between(generator, 0.06, 0.16)
    neck, shoulder, top = radius * _between(generator, 0.25, 0.6), _between(generator, 0.01, 0.04), 0.03
    angle = np.linspace(0.0, math.pi / 2, 8)
    arc = np.column_stack([neck + (radius - neck) * np.cos(angle), body + shoulder * np.sin(angle)])
    end = body + shoulder + top * _between(generator, 0.5, 1.5)
    return _revolved([[0, 0], [radius, 0], *arc, [neck, end], [0, end]])


def _bowl(generator: Generator) -> trimesh.Trimesh:
    radius, depth, wall = _between(generator, 0.035, 0.08), _between(generator, 0.025, 0.07), 0.005
    angle = np.linspace(0.0, math.pi / 2, 14)
    outside = np.column_stack([radius * np.sin(angle), depth * (1.0 - np.cos(angle))])
    inside = np.column_stack([(radius - wall) * np.sin(angle), depth - (depth - wall) * np.cos(angle)])
    return _revolved(np.concatenate([outside, inside[::-1]]))


def _cup(generator: Generator) -> trimesh.Trimesh:
    """A mug: a thick-walled cylinder with a handle."""
    radius, height, wall = _between(generator, 0.03, 0.05), _between(generator, 0.06, 0.12), 0.005
    body = _revolved([[0, 0], [radius, 0], [radius, height], [radius - wall, height], [radius - wall, wall], [0, wall]])
    handle = trimesh.creation.torus(height * _between(generator, 0.22, 0.34), 0.006, 32, 16)
    place = trimesh.transformations.rotation_matrix(math.pi / 2, [1, 0, 0])
    place[:3, 3] = [radius, 0, height / 2]
    handle.apply_transform(place)
    # The handle's ends are inside the wall.
    hollow = trimesh.creation.cylinder(
        radius - wall / 2,
        height,
        sections=_SEGMENTS,
        transform=trimesh.transformations.translation_matrix([0, 0, wall + height / 2]),
    )
    return _union(body, trimesh.boolean.difference([handle, hollow], engine="manifold"))


def _angle(generator: Generator) -> trimesh.Trimesh:
    """Two blocks in the shape of an L."""
    long, high, wide = generator.uniform([0.05, 0.04, 0.02], [0.15, 0.12, 0.06])
    thick, other = generator.uniform(0.012, 0.03, 2)
    return _union(
        _block([long, wide, thick], [long / 2, 0, thick / 2]), _block([other, wide, high], [other / 2, 0, high / 2])
    )


def _cross(generator: Generator) -> trimesh.Trimesh:
    """Two bars that cross away from their middles."""
    a, b = generator.uniform(0.06, 0.16, 2)
    wide, thick = generator.uniform(0.015, 0.035, 2)
    at = _between(generator, -0.35, 0.35) * a
    return _union(_block([a, wide, thick], [0, 0, 0]), _block([wide, b, thick], [at, 0.2 * b, 0.3 * thick]))


def _hammer(generator: Generator) -> trimesh.Trimesh:
    """A rod with a block at its end."""
    length, radius = _between(generator, 0.08, 0.2), _between(generator, 0.008, 0.015)
    head = generator.uniform([0.03, 0.02, 0.02], [0.1, 0.05, 0.05])
    rod = trimesh.creation.cylinder(radius, length, sections=_SEGMENTS)
    return _union(rod, _block(head, [_between(generator, -0.3, 0.3) * head[0], 0, length / 2]))


def _ring(generator: Generator) -> trimesh.Trimesh:
    return trimesh.creation.torus(_between(generator, 0.025, 0.06), _between(generator, 0.006, 0.02), 48, 24)


FAMILIES: dict[str, Callable[[Generator], trimesh.Trimesh]] = {
    "angle": _angle,
    "bottle": _bottle,
    "bowl": _bowl,
    "box": _box,
    "capsule": _capsule,
    "cross": _cross,
    "cup": _cup,
    "cylinder": _cylinder,
    "frustum": _frustum,
    "hammer": _hammer,
    "prism": _prism,
    "ring": _ring,
    "superquadric": _superquadric,
}


def make_object(index: int, seed: int) -> tuple[str, trimesh.Trimesh]:
    """The name and the surface, in m, of one object; its family follows from its index."""
    family = list(FAMILIES)[index % len(FAMILIES)]
    return f"{family}_{index:04d}", FAMILIES[family](np.random.default_rng((seed, index)))


def write_objects(folder: Path, count: int, seed: int) -> None:
    """Writes the first `count` objects of a seed as STL files; other files in the folder stay."""
    folder.mkdir(parents=True, exist_ok=True)
    for index in track(range(count), f"writing {folder}", transient=True):
        name, mesh = make_object(index, seed)
        mesh.export(folder / f"{name}.stl")


def main() -> None:
    """Writes a library."""
    parser = argparse.ArgumentParser(description="Writes a library of random objects.")
    parser.add_argument("--count", type=int, default=1000, help="of objects")
    parser.add_argument("--seed", type=int, default=0, help="of their measures")
    parser.add_argument("--out", type=Path, required=True, help="the folder")
    arguments = parser.parse_args()
    write_objects(arguments.out, arguments.count, arguments.seed)


if __name__ == "__main__":
    main()
