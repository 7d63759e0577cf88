"""Mesh files of every format, made of small bodies and then damaged: their triangles, bytes, references."""

import bz2
import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

create = trimesh.creation
Vertices, Faces = NDArray[np.float64], NDArray[np.int64]
FORMATS = ("obj", "stl", "stl_ascii", "ply", "ply_ascii", "off", "glb", "gltf", "dae", "3mf")
BAD_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e154, 1e30, 1e-300, 5e-324, 1e6, 0.0)
OUTSIDE = "outside.bin"


class MeshFile(NamedTuple):
    """The name and content of a mesh file, and of the files beside it."""

    name: str
    content: bytes
    others: dict[str, bytes]


def body(rng: np.random.Generator) -> trimesh.Trimesh:
    """A closed body of few faces, some centimetres long."""
    sides = rng.uniform(0.01, 0.1, 3)
    makers: list[Callable[[], trimesh.Trimesh]] = [
        lambda: create.box(sides),
        lambda: create.icosphere(int(rng.integers(0, 3)), sides[0]),
        lambda: create.uv_sphere(sides[0], [int(rng.integers(4, 9)), int(rng.integers(4, 9))]),
        lambda: create.cylinder(sides[0], sides[1], sections=int(rng.integers(3, 20))),
        lambda: create.annulus(0.5 * sides[0], sides[0], sides[1], sections=int(rng.integers(3, 20))),
        lambda: create.torus(sides[0], 0.3 * sides[0], 8, 6),
        lambda: create.capsule(sides[1], sides[0], count=[6, 6]),
        lambda: trimesh.boolean.union(
            [create.box(sides), create.box(sides[::-1]).apply_translation(0.4 * sides)], engine="manifold"
        ),
        lambda: trimesh.boolean.difference([create.box(sides), create.icosphere(1, 0.3 * sides.max())]),
    ]
    mesh = makers[int(rng.integers(len(makers)))]()
    if rng.random() < 0.5:
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        mesh.apply_translation(rng.uniform(-0.1, 0.1, 3))
    return mesh


def joined(rng: np.random.Generator) -> tuple[Vertices, Faces]:
    """One body, or several: apart, touching, overlapping, within each other, turned inside out."""
    parts = [body(rng)]
    while rng.random() < 0.3 and len(parts) < 4:
        other = parts[0].copy() if rng.random() < 0.3 else body(rng)
        other.apply_scale(float(rng.choice([1.0, 0.5, 0.1, 0.01])))
        shift = rng.choice([0.0, 0.25, 0.5, 1.0, 3.0]) * parts[0].extents
        other.apply_translation(shift * (rng.random(3) < 0.5))
        if rng.random() < 0.3:
            other.invert()
        parts.append(other)
    offsets = np.cumsum([0, *[len(part.vertices) for part in parts[:-1]]])
    vertices = np.concatenate([np.array(part.vertices) for part in parts])
    return vertices, np.concatenate([np.array(part.faces) + n for part, n in zip(parts, offsets, strict=True)])


def damage(rng: np.random.Generator, vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Does one thing to the triangles that no exporter should."""
    vertices, faces = vertices.copy(), faces.copy()
    some = rng.random(len(faces)) < rng.choice([0.02, 0.1, 0.5])
    some[rng.integers(len(faces))] = True
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    chosen = rng.integers(len(vertices), size=int(rng.integers(1, 4)))
    what = int(rng.integers(17))
    if what == 0:
        faces = faces[~some] if not some.all() else faces
    elif what == 1:
        faces = np.concatenate([faces, faces[some]])
    elif what == 2:
        faces[some] = faces[some, ::-1]
    elif what == 3:
        faces[some, 1] = faces[some, 0]
    elif what == 4:
        vertices[chosen, rng.integers(3)] = rng.choice(BAD_NUMBERS)
    elif what == 5:
        vertices[chosen] += rng.normal(size=(len(chosen), 3)) * size * rng.choice([1e-8, 1e-5, 1e-3, 0.1, 1.0, 10.0])
    elif what == 6:
        vertices += rng.normal(size=vertices.shape) * size * rng.choice([1e-9, 1e-7, 1e-5, 1e-2, 0.3])
    elif what == 7:
        vertices = vertices[faces % len(vertices)].reshape(-1, 3)
        faces = np.arange(len(vertices)).reshape(-1, 3)
        vertices = vertices + rng.choice([0.0, 1e-8, 1e-6, 1e-4]) * size * rng.normal(size=vertices.shape)
    elif what == 8:
        faces[some, rng.integers(3)] = rng.integers(len(vertices), size=int(some.sum()))
    elif what == 9:
        faces = rng.permutation(faces)[:, rng.permutation(3)]
    elif what == 10:
        vertices[chosen] = vertices[rng.integers(len(vertices), size=len(chosen))]
    elif what == 11:
        vertices *= 10.0 ** rng.choice([-300, -9, -3, -1, 1, 3, 9, 150, 300])
    elif what == 12:
        vertices += rng.choice([1.0, 50.0, 1e4, 1e8, 1e15]) * rng.normal(size=3)
    elif what == 13:
        vertices *= np.where(np.arange(3) == rng.integers(3), rng.choice([0.0, 1e-12, 1e-7, 1e-4, -1.0, 20.0]), 1.0)
    elif what == 14:  # a vertex in the middle of an edge, in one of its faces only
        a, b, c = faces[int(np.flatnonzero(some)[0])]
        a, b = (int(n) % len(vertices) for n in (a, b))
        vertices = np.vstack([vertices, vertices[[a, b]].mean(axis=0)])
        n = len(vertices) - 1
        faces = np.vstack([np.delete(faces, np.flatnonzero(some)[0], axis=0), [[a, n, c], [n, b, c]]])
        faces = np.vstack([faces, [[a, b, n]]]) if rng.random() < 0.5 else faces
    elif what == 15:  # parts that pass through the rest
        middle = vertices.mean(axis=0)
        vertices[chosen] = middle - rng.uniform(0.0, 2.0) * (vertices[chosen] - middle)
    else:
        faces[some] += int(rng.choice([-1, 1, len(vertices), 2**31]))
    return vertices, faces


def write(rng: np.random.Generator, vertices: Vertices, faces: Faces, kind: str) -> MeshFile:
    """A file of these triangles, be they as damaged as they may."""
    good = (faces >= 0).all() and (faces < len(vertices)).all()
    if kind in ("off", "obj") or not good:
        kind = kind if kind in ("off", "obj") else "obj"
        digits = int(rng.integers(4, 18))
        lines = [" ".join(f"{x:.{digits}g}" for x in row) for row in vertices]
        if kind == "off":
            listed = [f"3 {a} {b} {c}" for a, b, c in faces]
            text = "\n".join([f"OFF\n{len(vertices)} {len(faces)} 0", *lines, *listed])
        else:
            listed = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
            text = "\n".join(["mtllib ../outside.mtl", *[f"v {line}" for line in lines], *listed, ""])
        return MeshFile(f"mesh.{kind}", text.encode(), {})
    scale = 1000.0 if kind == "3mf" else 1.0  # trimesh writes such files in millimetres
    mesh = trimesh.Trimesh(scale * vertices, faces, process=False)
    if kind == "gltf":
        files = {name: bytes(content) for name, content in mesh.scene().export(file_type="gltf").items()}
        return MeshFile("mesh.gltf", files.pop("model.gltf"), files)
    if kind == "ply_ascii":
        content = mesh.export(file_type="ply", encoding="ascii")
    else:
        content = mesh.scene().export(file_type=kind) if kind == "3mf" else mesh.export(file_type=kind)
    content = content.encode() if isinstance(content, str) else bytes(content)
    return MeshFile(f"mesh.{kind.split('_')[0]}", content, {})


def damage_bytes(rng: np.random.Generator, content: bytes) -> bytes:
    """Flips bits, overwrites, cuts off, repeats, or exchanges numbers and names in a file."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        if not data:
            break
        near_start = rng.random() < 0.5
        place = int(rng.integers(min(len(data), 200) if near_start else len(data)))
        length = int(rng.integers(1, 9))
        what = int(rng.integers(8))
        if what == 0:
            data[place] ^= 1 << int(rng.integers(8))
        elif what == 1:
            data[place : place + length] = rng.bytes(length)
        elif what == 2:
            del data[place:]
        elif what == 3:
            del data[place : place + length]
        elif what == 4:
            data[place:place] = data[place : place + 20 * length]
        elif what == 5:
            digits = [n for n, byte in enumerate(data) if 48 <= byte < 58]
            if digits:
                n = digits[int(rng.integers(len(digits)))]
                data[n : n + 1] = str(
                    rng.choice(["9" * 9, "-1", "1e999", "nan", "4294967295", "0", "2147483648"])
                ).encode()
        elif what == 6:
            data[place : place + 4] = struct.pack("<I", int(rng.choice([0, 2**31, 2**32 - 1, 10**9, 10**7])))
        else:
            data[place : place + length] = bytes([int(rng.choice([0, 10, 32, 60, 91, 123, 255]))]) * length
    return bytes(data)


def hostile(rng: np.random.Generator) -> MeshFile:
    """A file that wants something: memory, time, or another file."""
    wishes: list[Callable[[], MeshFile]] = [
        lambda: MeshFile("mesh.ply", _ply_header(10**9, 10**9), {}),
        lambda: MeshFile("mesh.ply", _ply_header(10**9, 10**9, "ascii 1.0") + b"0 0 0\n" * 50, {}),
        lambda: MeshFile("mesh.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(500), {}),
        lambda: MeshFile("mesh.off", b"OFF\n4000000000 4000000000 0\n0 0 0\n", {}),
        lambda: MeshFile("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n", {}),
        lambda: MeshFile("mesh.zip", packed({"mesh.obj": bytes(2**20)}), {}),
        lambda: MeshFile("mesh.3mf", packed({"3D/3dmodel.model": b" " * (300 * 2**20)}), {}),
        lambda: MeshFile("mesh.zae", packed({"manifest.xml": b" " * (300 * 2**20)}), {}),
        lambda: MeshFile("mesh.bz2", bz2.compress(bytes(2**20)), {}),
        lambda: _gltf_naming(
            str(rng.choice([f"../{OUTSIDE}", f"/etc/../{OUTSIDE}", "/dev/zero", "link.bin", "pipe.bin"]))
        ),
        lambda: MeshFile("mesh.dae", _ENTITIES, {}),
        lambda: MeshFile(
            "mesh.3mf", packed({"3D/3dmodel.model": nested_components(int(rng.choice([2, 30, 200])))}), {}
        ),
        lambda: MeshFile("mesh.dae", nested_nodes(int(rng.choice([2, 30, 200]))), {}),
        lambda: MeshFile("mesh.xaml", _ENTITIES, {}),
        lambda: MeshFile("mesh.gltf", b"[" * 200_000, {}),
        lambda: _gltf_of_many_nodes(int(rng.choice([3, 100, 3000]))),
    ]
    return wishes[int(rng.integers(len(wishes)))]()


def _ply_header(vertices: int, faces: int, form: str = "binary_little_endian 1.0") -> bytes:
    return (
        f"ply\nformat {form}\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def packed(files: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


def _gltf() -> tuple[dict[str, Any], dict[str, bytes]]:
    """A box as glTF: what its file holds, and the files of its buffers."""
    mesh = create.box((0.1, 0.1, 0.1))
    files = {name: bytes(content) for name, content in mesh.scene().export(file_type="gltf").items()}
    return json.loads(files.pop("model.gltf")), files


def _gltf_naming(uri: str) -> MeshFile:
    tree, files = _gltf()
    for buffer in tree["buffers"]:
        buffer["uri"] = uri
    return MeshFile("mesh.gltf", json.dumps(tree).encode(), files)


def _gltf_of_many_nodes(count: int) -> MeshFile:
    """A tree of nodes in which each has the next one twice."""
    tree, files = _gltf()
    tree["nodes"] = [{"children": [n + 1, n + 1], "name": str(n)} for n in range(count)] + [{"mesh": 0, "name": "box"}]
    tree["scenes"], tree["scene"] = [{"nodes": [0]}], 0
    return MeshFile("mesh.gltf", json.dumps(tree).encode(), files)


def nested_components(deep: int) -> bytes:
    """Objects each of which has the one before twice: 2^n instances of a box."""
    mesh = create.box((100.0, 100.0, 100.0))
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    component = '<component objectid="{0}"/>'
    objects = "".join(
        f'<object id="{n}"><components>{2 * component.format(n - 1)}</components></object>' for n in range(1, deep)
    )
    return (
        '<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="0"><mesh><vertices>{corners}</vertices><triangles>{triangles}</triangles></mesh></object>'
        f"{objects}"
        f'</resources><build><item objectid="{deep - 1}"/></build></model>'
    ).encode()


def nested_nodes(count: int) -> bytes:
    """The same in Collada: each node has the one before twice."""
    text = create.box((0.1, 0.1, 0.1)).export(file_type="dae").decode()
    box = re.search("<instance_geometry.*</instance_geometry>", text, re.DOTALL)
    assert box is not None
    twice = '<instance_node url="#n{0}"/><instance_node url="#n{0}"/>'
    nodes = "".join(f'<node id="n{n}">{twice.format(n - 1) if n else box[0]}</node>' for n in range(count))
    text = text.replace(box[0], f'<instance_node url="#n{count - 1}"/>')
    library = f"<library_nodes>{nodes}</library_nodes><library_visual_scenes>"
    return text.replace("<library_visual_scenes>", library).encode()


_ENTITIES = (
    b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a0 "dos"><!ENTITY out SYSTEM "outside.bin">'
    + b"".join(b'<!ENTITY a%d "%s">' % (n, b"&a%d;" % (n - 1) * 10) for n in range(1, 12))
    + b"]><COLLADA>&out;&a11;</COLLADA>"
)


def place(file: MeshFile, folder: Path) -> Path:
    """Writes a file and those beside it into a folder."""
    for name, content in {file.name: file.content, **file.others}.items():
        (folder / name).write_bytes(content)
    return folder / file.name
