"""Writes a mesh as Wavefront OBJ with normals, and the SDF model that Drake simulates."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]

SDF_TEMPLATE = """<?xml version="1.0"?>
<!-- Written by models/objects/generate.py; edit that, not this. -->
<sdf version="1.9" xmlns:drake="https://drake.mit.edu">
  <model name={name}>
    <link name={name}>
      <inertial>
        <pose>{com} 0 0 0</pose>
        <mass>{mass}</mass>
        <inertia>
          <ixx>{ixx}</ixx>
          <ixy>{ixy}</ixy>
          <ixz>{ixz}</ixz>
          <iyy>{iyy}</iyy>
          <iyz>{iyz}</iyz>
          <izz>{izz}</izz>
        </inertia>
      </inertial>
      <visual name="visual">
        <geometry>
          <mesh>
            <uri>{uri}</uri>
          </mesh>
        </geometry>
        <material>
          <diffuse>{color} 1</diffuse>
        </material>
      </visual>
      <collision name="collision">
        <geometry>
          <mesh>
            <uri>{uri}</uri>
          </mesh>
        </geometry>
        <drake:proximity_properties>
          <drake:rigid_hydroelastic/>
          <drake:mu_dynamic>{friction}</drake:mu_dynamic>
          <drake:mu_static>{friction}</drake:mu_static>
        </drake:proximity_properties>
      </collision>
    </link>
  </model>
</sdf>
"""


def as_shipped(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with its vertices rounded to the micrometre, as the file will hold it."""
    return trimesh.Trimesh(np.round(mesh.vertices, 6) + 0.0, mesh.faces, process=False)


def vertex_normals(mesh: trimesh.Trimesh) -> Array:
    """Outward unit normals at the vertices, shape (v, 3): the mean over the faces, weighted by their angles there."""
    corners = mesh.vertices[mesh.faces]
    to_next = np.roll(corners, -1, axis=1) - corners
    to_next /= np.linalg.norm(to_next, axis=2, keepdims=True)
    to_previous = -np.roll(to_next, 1, axis=1)
    angles = np.arccos(np.clip(np.einsum("fij,fij->fi", to_next, to_previous), -1, 1))
    face_normals = np.cross(to_next[:, 0], to_next[:, 1])
    face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
    normals = np.zeros_like(mesh.vertices)
    np.add.at(normals, mesh.faces, angles[:, :, None] * face_normals[:, None, :])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def obj_text(mesh: trimesh.Trimesh, header: str) -> str:
    """The OBJ file: positions to the micrometre, one normal a vertex (renderers that shade smoothly ask for them)."""
    lines = [f"# {line}" for line in header.splitlines()]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in np.round(vertex_normals(mesh), 4) + 0.0]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in mesh.faces + 1]
    return "\n".join(lines) + "\n"


def sdf_text(mesh: trimesh.Trimesh, name: str, mass: float, friction: float, color: tuple[float, float, float]) -> str:
    """The SDF model: one link, a uniform solid of the given mass (kg), rigid in hydroelastic contact."""
    solid = mesh.copy()
    solid.density = mass / solid.volume
    inertia = solid.moment_inertia
    inertia = np.where(np.abs(inertia) < 1e-6 * np.abs(inertia).max(), 0.0, inertia)
    moments = {f"i{'xyz'[i]}{'xyz'[j]}": f"{inertia[i, j]:.6e}" for i in range(3) for j in range(i, 3)}
    return SDF_TEMPLATE.format(
        name=quoteattr(name),
        uri=f"{name}.obj",
        com=" ".join(f"{x:.6f}" for x in np.round(solid.center_mass, 6) + 0.0),
        mass=f"{mass:g}",
        friction=f"{friction:g}",
        color=" ".join(f"{c:g}" for c in color),
        **moments,
    )


def write(path: Path, text: str) -> None:
    """Writes with Unix line ends on every system, so that the bytes are the same everywhere."""
    path.write_text(text, encoding="ascii", newline="\n")
