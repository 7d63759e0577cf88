"""Writes the SDF and OBJ files that a scenario needs from an object's model."""

import logging
import re
from pathlib import Path

import numpy as np
import trimesh

from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.shape.object_model import ObjectModel

_FRICTION = 0.9

_SDF = """<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="https://drake.mit.edu">
  <model name="{name}">
    <link name="{name}">
      <inertial>
        <pose>{x:.6f} {y:.6f} {z:.6f} 0 0 0</pose>
        <mass>{mass:.6g}</mass>
        <inertia>
          <ixx>{ixx:.6e}</ixx>
          <ixy>{ixy:.6e}</ixy>
          <ixz>{ixz:.6e}</ixz>
          <iyy>{iyy:.6e}</iyy>
          <iyz>{iyz:.6e}</iyz>
          <izz>{izz:.6e}</izz>
        </inertia>
      </inertial>
      <visual name="visual">
        <geometry><mesh><uri>{name}.obj</uri></mesh></geometry>
        <material><diffuse>0.9 0.9 0.9 1</diffuse></material>
      </visual>
      <collision name="collision">
        <geometry><mesh><uri>{name}.obj</uri></mesh></geometry>
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


def write_simulated_object(model: ObjectModel, folder: Path) -> Path:
    """Writes a model's repaired mesh, in metres, as OBJ, and an SDF with its mass; returns the SDF's path.

    If the object's origin is far away, its frame is moved to its middle and a warning logged, since slips and pose
    errors are measured at the frame's origin.
    """
    if has_far_origin(model):
        logging.getLogger("tactopose_drake").warning(
            "%s: its frame's origin is %.2f m away from it; simulated in a frame at its middle, %s m in the file's.",
            model.name,
            float(np.linalg.norm(model.middle)),
            np.round(model.middle, 4).tolist(),
        )
        model = model.about_middle
    name = re.sub(r"\W", "_", model.name, flags=re.ASCII) or "object"
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    (folder / f"{name}.obj").write_text(str(mesh.export(file_type="obj", include_normals=True)))
    x, y, z = model.center_of_mass.tolist()
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = model.inertia.tolist()
    text = _SDF.format(
        name=name, x=x, y=y, z=z, mass=model.mass, friction=_FRICTION,
        ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz,
    )  # fmt: skip
    path = folder / f"{name}.sdf"
    path.write_text(text)
    return path
