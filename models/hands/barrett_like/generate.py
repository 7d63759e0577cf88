"""Writes barrett_like.sdf and finger_pad.{vtk,obj}: a three-finger hand with the published dimensions of the BH8-280.

Run `python models/hands/barrett_like/generate.py` after changing a number; the output depends on this file, its
neighbour soft_prism.py, sdf_parts.py next to its folder, and the cells in models/sensors/bh280_finger.yaml.
Frames: the palm's z points out of the palm, finger 3 is at -y, fingers 1 and 2 at +y when not spread. A finger's x
points along it, its z along its joints' axis, -y to its palm side. The sources of the numbers are in README.md.
"""

import itertools
import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import sdf_parts as sdf
from sdf_parts import DARK, RUBBER, Link, Solid, link_text, weld
from soft_prism import obj_text, soft_prism, vtk_text

from tactopose_drake.hand import load_tactile_pad

# Barrett's names. A_W: from the palm's centre to the axes of the spread; A_1: from there to the proximal joint;
# A_2: from there to the distal joint; Phi_2, Phi_3: angles of the links at zero joint positions.
A_W, A_1, A_2 = 0.025, 0.050, 0.070  # m
PHI_2, PHI_3 = math.radians(2.46), math.radians(42.0)
SPREAD_HEIGHT, JOINT_HEIGHT = 0.0415, 0.0754  # of the knuckles' frame and of the proximal joints above the base, m
PALM_HEIGHT = 0.0775  # m, of the palm's cells
DISTAL_RATIO = 1 / 3

SKIN = 0.003  # m, thickness of the soft layer
SKIN_MODULUS = 1.5e5  # Pa: 50 kPa for each millimetre
PAD_HALF_WIDTH = 0.0095  # m
PALM_PAD = (0.084, 0.050)  # m
# A fingertip's cross-section outside the cells, m: how far the rows' planes extend (x at the root, y at the tip),
# and the back, from the tip to the root.
PAD_ROOT, PAD_TIP = 0.016, 0.0015
PAD_BACK = ((0.0545, 0.0050), (0.0510, 0.0065), (PAD_ROOT, 0.0065))

FINGERS = ("finger_1", "finger_2", "finger_3")
OUTWARDS = (-math.pi / 2, 0.0, 0.0)  # from a frame with x outwards and z up to that of an open finger


def pad_outline() -> NDArray[np.float64]:
    """The fingertip's cross-section, counterclockwise, shape (k, 2), m: its palm side is the rows' own planes."""
    layout = load_tactile_pad("bh280_finger").layout
    middle, normal = layout.p_TC[1::3, :2], layout.n_T[1::3, :2]
    planes = [(n, n @ p) for p, n in zip(middle, normal, strict=True)]
    del planes[1]  # The second row is in the first one's plane.
    corners = [np.array([PAD_ROOT, middle[0, 1]])]
    for (n, c), (m, d) in itertools.pairwise(planes):
        corners.append(np.linalg.solve([n, m], [c, d]))
    last, offset = planes[-1]
    corners.append(np.array([(offset - last[1] * PAD_TIP) / last[0], PAD_TIP]))
    return np.array([*corners, *PAD_BACK])


def pad_files() -> dict[str, str]:
    """The fingertip's mesh files by name, relative to the centre of their bounding box."""
    outline = pad_outline()
    vertices, tetrahedra = soft_prism(outline, PAD_HALF_WIDTH, SKIN)
    vertices = vertices - [*pad_box()[0], 0.0]
    return {"finger_pad.vtk": vtk_text(vertices, tetrahedra), "finger_pad.obj": obj_text(vertices, len(outline))}


def pad_box() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre and size of the bounding box of the fingertip's cross-section, m."""
    outline = pad_outline()
    low, high = outline.min(axis=0), outline.max(axis=0)
    return (low + high) / 2, high - low


def pad(name: str, parent: str, mass: float, solid: Solid) -> list[str]:
    """A soft pad, welded to a link whose frame it shares."""
    link = Link(name=name, mass=mass, solids=[solid], parent=parent)
    return [link_text(link, modulus=SKIN_MODULUS), weld(f"{name}_weld", parent, name)]


def finger_links(
    name: str, base: str, position: tuple[float, float, float], rpy: tuple[float, float, float]
) -> list[Link]:
    """Proximal and distal link; the distal one is coupled."""
    center = (0.5 * A_2 * math.cos(PHI_2), -0.5 * A_2 * math.sin(PHI_2), 0.0)
    along = (0.0, math.pi / 2, -PHI_2)  # z of the capsule along the line between the joints
    bone = Solid(kind="capsule", size=(0.0085, A_2 - 0.012), center=center, rpy=along)
    pin = Solid(kind="cylinder", size=(0.0095, 0.022), color=DARK, collides=False)
    neck = Solid(kind="box", size=(0.018, 0.014, 0.015), center=(0.008, -0.001, 0.0))
    middle, size = pad_box()
    tip = Solid(kind="mesh", mesh="finger_pad", size=(*size, 2 * PAD_HALF_WIDTH), center=(*middle, 0.0), color=RUBBER)
    closing, motor = (0.0, 0.0, -1.0), {"effort": 1.8, "rotor_inertia": 1.5e-3}
    return [
        Link(
            name=f"{name}_proximal", mass=0.05, solids=[bone, pin], parent=base, position=position, rpy=rpy,
            joint=f"{name}_proximal_joint", axis=closing, limits_deg=(0, 140), **motor,
        ),
        Link(
            name=f"{name}_distal", mass=0.03, solids=[neck, pin], parent=f"{name}_proximal",
            position=(A_2 * math.cos(PHI_2), -A_2 * math.sin(PHI_2), 0.0), rpy=(0, 0, -PHI_2 - PHI_3),
            joint=f"{name}_distal_joint", axis=closing, limits_deg=(0, 140 * DISTAL_RATIO),
            mimic=f"{name}_proximal_joint", ratio=DISTAL_RATIO,
            extra=pad(f"{name}_pad", f"{name}_distal", 0.01, tip),
        ),
    ]  # fmt: skip


def knuckle_link(name: str, side: float, *, mimic: str = "") -> Link:
    """The link between a spread axis and a proximal joint; x outwards, which is y of the palm at zero."""
    arm = Solid(kind="box", size=(A_1 + 0.004, 0.026, 0.030), center=(A_1 / 2 - 0.004, 0.0, 0.017))
    return Link(
        name=f"{name}_knuckle", mass=0.05, solids=[arm], parent="palm", position=(side * A_W, 0, SPREAD_HEIGHT),
        rpy=(0, 0, math.pi / 2), joint=f"{name}_spread_joint", axis=(0, 0, -side), limits_deg=(0, 180), effort=1.5,
        damping=0.1, rotor_inertia=1.5e-3, mimic=mimic,
    )  # fmt: skip


def hand_links() -> list[Link]:
    base = Solid(kind="cylinder", size=(0.045, 0.036), center=(0, 0, 0.018), color=DARK)
    body = Solid(kind="box", size=(0.050, 0.046, 0.0355), center=(0, 0, 0.05375))
    mount = Solid(kind="box", size=(0.026, 0.030, 0.034), center=(0, -0.035, 0.053))
    plate = Solid(kind="box", size=(*PALM_PAD, 2 * SKIN), center=(0, 0, PALM_HEIGHT - SKIN), color=RUBBER)
    palm = Link(name="palm", mass=0.59, solids=[base, body, mount], extra=pad("palm_pad", "palm", 0.02, plate))
    on_knuckle = (A_1, 0.0, JOINT_HEIGHT - SPREAD_HEIGHT)
    return [
        palm,
        knuckle_link("finger_1", 1.0),
        *finger_links("finger_1", "finger_1_knuckle", on_knuckle, OUTWARDS),
        knuckle_link("finger_2", -1.0, mimic="finger_1_spread_joint"),
        *finger_links("finger_2", "finger_2_knuckle", on_knuckle, OUTWARDS),
        *finger_links("finger_3", "palm", (0.0, -A_1, JOINT_HEIGHT), (-math.pi / 2, 0.0, -math.pi / 2)),
    ]


def model_text() -> str:
    return sdf.model_text("barrett_like", hand_links(), [*(f"{finger}_pad" for finger in FINGERS), "palm_pad"])


if __name__ == "__main__":
    for name, text in (pad_files() | {"barrett_like.sdf": model_text()}).items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")
