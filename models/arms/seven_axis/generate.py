"""Writes seven_axis.sdf: an arm of seven revolute joints with enough reach and strength to carry a hand.

Run `python models/arms/seven_axis/generate.py` after changing a number; the output depends on this file and on
../../hands/sdf_parts.py. At joint positions zero, the arm is vertical, with every link's z axis upwards. The joints
rotate about z and y alternately: shoulder (1 to 3), elbow (4), wrist (5 to 7).
"""

import math
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "hands"))  # the generators' shared module is next to the hands

import sdf_parts as sdf
from sdf_parts import DARK, GREY, Link, Solid, pose

SHOULDER = 0.34  # height of the shoulder's centre above the foot, m
UPPER_ARM = 0.42  # from the shoulder's centre to the elbow's, m
FOREARM = 0.40  # from the elbow's to the wrist's, m
FLANGE = 0.12  # from the wrist's to the flange, m
LIGHT = "0.88 0.89 0.90 1"
# Each joint: half its range, deg; effort, N m; speed, rad/s; reflected rotor inertia, kg m^2.
JOINTS = (
    (170.0, 300.0, 1.5, 0.8),
    (120.0, 300.0, 1.5, 0.8),
    (170.0, 180.0, 1.7, 0.4),
    (120.0, 180.0, 1.7, 0.4),
    (170.0, 100.0, 2.4, 0.1),
    (120.0, 60.0, 2.4, 0.1),
    (175.0, 60.0, 2.4, 0.05),
)


def tube(radius: float, length: float, *, color: str = LIGHT) -> Solid:
    """A cylindrical link that starts at the link's origin."""
    return Solid(kind="capsule", size=(radius, length), center=(0, 0, length / 2), color=color)


def hub(radius: float, width: float) -> Solid:
    """The housing of a joint that rotates about y."""
    return Solid(kind="cylinder", size=(radius, width), rpy=(math.pi / 2, 0, 0), color=DARK)


def arm_links() -> list[Link]:
    foot = Solid(kind="cylinder", size=(0.11, 0.16), center=(0, 0, 0.08), color=DARK)
    turret = Solid(kind="cylinder", size=(0.09, 0.16), center=(0, 0, 0.08), color=LIGHT)
    plate = Solid(kind="cylinder", size=(0.04, 0.02), center=(0, 0, FLANGE - 0.01), color=GREY)
    bodies: list[tuple[str, float, list[Solid], float]] = [
        # name, mass in kg, solids, height of its joint above that of the previous link
        ("turret", 5.0, [turret], 0.16),
        ("shoulder", 4.5, [hub(0.085, 0.17), tube(0.065, 0.16)], SHOULDER - 0.16),
        ("upper_arm", 3.5, [tube(0.065, UPPER_ARM - 0.24)], 0.20),
        ("elbow", 3.5, [hub(0.072, 0.15), tube(0.055, 0.16)], UPPER_ARM - 0.20),
        ("lower_arm", 2.5, [tube(0.052, FOREARM - 0.26)], 0.20),
        ("arm_wrist", 1.8, [hub(0.055, 0.12), Solid(kind="sphere", size=(0.055,), color=LIGHT)], FOREARM - 0.20),
        ("hand_mount", 0.6, [Solid(kind="cylinder", size=(0.045, 0.06), center=(0, 0, 0.07), color=DARK), plate], 0.0),
    ]
    links = [Link(name="foot", mass=6.0, solids=[foot])]
    for i, (name, mass, solids, height) in enumerate(bodies):
        half_range, effort, speed, rotor_inertia = JOINTS[i]
        links.append(
            Link(
                name=name, mass=mass, solids=solids, parent=links[-1].name, position=(0, 0, height),
                joint=f"joint_{i + 1}", axis=(0, 1, 0) if i % 2 else (0, 0, 1), limits_deg=(-half_range, half_range),
                effort=effort, speed=speed, damping=1.0, rotor_inertia=rotor_inertia,
            )
        )  # fmt: skip
    links[-1].extra.append(f'<frame name="flange" attached_to="{links[-1].name}">{pose((0, 0, FLANGE))}</frame>')
    return links


def model_text() -> str:
    return sdf.model_text("seven_axis", arm_links(), [], group="arm")


if __name__ == "__main__":
    Path(__file__).with_name("seven_axis.sdf").write_text(model_text(), encoding="utf-8")
