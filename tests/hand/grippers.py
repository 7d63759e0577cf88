"""Grippers: of two fingers that slide, and of fingers that bend; fingertips are spheres about their sensors' frames."""

import math
from pathlib import Path

URDF = """<robot name="two_finger" xmlns:drake="https://drake.mit.edu">
  <link name="base">
    <inertial><mass value="0.4"/><inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="4e-4"/></inertial>
    <collision><origin xyz="0 0 -0.01"/><geometry><box size="0.12 0.04 0.02"/></geometry></collision>
  </link>
  {fingers}
</robot>"""

FINGER = """
  <link name="{name}_finger">
    <inertial><mass value="0.05"/><inertia ixx="2e-5" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="2e-5"/></inertial>
    <collision><origin xyz="{x} 0 0.045"/><geometry><box size="0.008 0.012 0.08"/></geometry>{property}</collision>
  </link>
  <link name="{name}_tip">
    <inertial><mass value="0.01"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial>
    <collision name="{name}_ball"><geometry><sphere radius="0.012"/></geometry>{property}</collision>
  </link>
  <joint name="{name}_slide" type="prismatic">
    <parent link="base"/><child link="{name}_finger"/><axis xyz="{axis} 0 0"/>
    <limit lower="0" upper="0.045" effort="40" velocity="1"/>{mimic}
  </joint>
  <joint name="{name}_weld" type="fixed">
    <parent link="{name}_finger"/><child link="{name}_tip"/><origin xyz="{x} 0 0.1"/>
  </joint>"""

YAML = """model: two_finger.urdf
base_link: base
palm_frame: base
fingers:
- name: left
  joints: [left_slide]
  sensor_frame: left_tip
  weld: left_weld
  surface: !SphereSurface {radius: 0.012}
- name: right
  joints: [right_slide]
  sensor_frame: right_tip
  weld: right_weld
  surface: !SphereSurface {radius: 0.012}
"""


def write_gripper(folder: Path, *, property: str = "", mimic: str = "", yaml: str = YAML) -> Path:
    """Writes the gripper's files and returns its YAML's path.

    Args:
        folder: receives them.
        property: what stands in the fingers' <collision> behind the <geometry>.
        mimic: what stands in the right finger's <joint>.
        yaml: of the hand.
    """
    left = FINGER.format(name="left", x=-0.06, axis=1, property=property, mimic="")
    right = FINGER.format(name="right", x=0.06, axis=-1, property=property, mimic=mimic)
    (folder / "two_finger.urdf").write_text(URDF.replace("{fingers}", left + right))
    path = folder / "two_finger.hand.yaml"
    path.write_text(yaml)
    return path


BENDING_FINGER = """
  <link name="{name}_near">
    <inertial><mass value="0.04"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0 0 0.025"/><geometry><box size="0.01 0.014 0.04"/></geometry></collision>
  </link>
  <link name="{name}_far">
    <inertial><mass value="0.04"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0 0 0.02"/><geometry><box size="0.01 0.014 0.03"/></geometry></collision>
  </link>
  <link name="{name}_tip">
    <inertial><mass value="0.01"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial>
    <collision><geometry><sphere radius="0.01"/></geometry></collision>
  </link>
  <joint name="{name}_j0" type="revolute">
    <parent link="base"/><child link="{name}_near"/><origin xyz="{x} {y} 0" rpy="0 0 {angle}"/>
    <axis xyz="0 -1 0"/><limit lower="-0.6" upper="1.4" effort="5" velocity="3"/>
  </joint>
  <joint name="{name}_j1" type="revolute">
    <parent link="{name}_near"/><child link="{name}_far"/><origin xyz="0 0 0.05"/>
    <axis xyz="0 -1 0"/><limit lower="-0.6" upper="1.4" effort="5" velocity="3"/>
  </joint>
  <joint name="{name}_weld" type="fixed">
    <parent link="{name}_far"/><child link="{name}_tip"/><origin xyz="0 0 0.045"/>
  </joint>"""

BENDING_YAML = """- name: {name}
  joints: [{name}_j0, {name}_j1]
  sensor_frame: {name}_tip
  weld: {name}_weld
  surface: !SphereSurface {{radius: 0.01}}
"""


def write_bending_gripper(folder: Path, count: int) -> Path:
    """Writes the files of a gripper whose fingers f0, f1, ... stand evenly about z and bend; returns its YAML."""
    angles = [2.0 * math.pi * place / count for place in range(count)]
    fingers = "".join(
        BENDING_FINGER.format(name=f"f{place}", x=0.05 * math.cos(angle), y=0.05 * math.sin(angle), angle=angle)
        for place, angle in enumerate(angles)
    )
    (folder / "bending.urdf").write_text(URDF.replace("{fingers}", fingers))
    path = folder / "bending.hand.yaml"
    yaml = "model: bending.urdf\nbase_link: base\npalm_frame: base\nfingers:\n"
    path.write_text(yaml + "".join(BENDING_YAML.format(name=f"f{place}") for place in range(count)))
    return path
