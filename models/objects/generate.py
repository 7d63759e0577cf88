"""Generates the shipped objects: `python models/objects/generate.py [names...] [--out DIR]`.

Writes NAME.obj and NAME.sdf for each name (all objects by default) into DIR (this folder by default). Each run
gives the same bytes with the same versions of numpy, scikit-image, trimesh and manifold3d (constraints.txt).
"""

import argparse
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from object_shapes.catalogue import CATALOGUE  # noqa: E402 (next to this script)
from object_shapes.files import as_shipped, obj_text, sdf_text, write  # noqa: E402


def generate(name: str, folder: Path) -> str:
    """Writes one object's two files; returns a line that describes it."""
    spec = CATALOGUE[name]
    mesh = as_shipped(spec.build())
    description = spec.build.__doc__.splitlines()[0]
    write(folder / f"{name}.obj", obj_text(mesh, f"{name}: {description}\nMade by models/objects/generate.py."))
    write(folder / f"{name}.sdf", sdf_text(mesh, name, spec.mass, spec.friction, spec.color))
    size = " x ".join(f"{1000 * x:.0f}" for x in mesh.extents)
    return f"{len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {size} mm, {spec.mass:g} kg"


def main(arguments: list[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Generates the shipped objects' OBJ and SDF files.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(CATALOGUE)}; all by default")
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIR", help="folder to write into")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in CATALOGUE]
    if unknown:
        parser.error(f"unknown object {unknown[0]!r}; the objects are {', '.join(CATALOGUE)}")
    options.out.mkdir(parents=True, exist_ok=True)
    names = options.names or list(CATALOGUE)
    for i, name in enumerate(names, 1):
        print(f"[{i}/{len(names)}] {name}: ", end="", flush=True)
        start = time.perf_counter()
        print(f"{generate(name, options.out)} ({time.perf_counter() - start:.1f} s)", flush=True)


if __name__ == "__main__":
    main()
