"""Writes shadow_like.sdf: a five-finger right hand with the published dimensions of the Shadow Dexterous Hand.

Run `python models/hands/shadow_like/generate.py` after changing a number; the output depends on this file and on
sdf_parts.py next to its folder.
Frames: z along the straight fingers, x towards the thumb's side, -y out of the palm; every link's origin lies on the
joint that moves it. The sources of the numbers are in README.md.
"""

import math
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # the generators' shared module is next to their folders

import sdf_parts as sdf
from sdf_parts import DARK, GREY, RUBBER, Link, Solid, link_text, pose, weld

TIP_RADIUS = 0.009  # m, radius of the hemisphere and of the cylinder below it
TIP_LENGTH = 0.014  # m, from the sensor's measuring frame to the hemisphere's centre
# Pressure at full compression, Pa. A sphere pressed by d onto a plane carries pi E d^2, so 5 N compress it by 0.2 mm
# (0.3 mm, as the simulator's mesh is inscribed in the sphere): little enough for the rigid contact model to be valid.
TIP_MODULUS = 4.0e7
# Chords of this length deviate from the sphere by at most 0.06 mm.
TIP_RESOLUTION = 0.002  # m


def phalanx(length: float, radius: float, *, color: str = GREY) -> list[Solid]:
    """A phalanx between two hinges, with the hinge's pin (along x) at its base."""
    center = (0.0, 0.0, length / 2)
    pin = Solid(
        kind="cylinder", size=(radius * 0.75, radius * 2.1), rpy=(0, math.pi / 2, 0), color=DARK, collides=False
    )
    return [Solid(kind="capsule", size=(radius, length - 2 * radius * 0.75), center=center, color=color), pin]


def fingertip(finger: str, distal: str, height: float) -> list[str]:
    """The sensor's frame on the distal link, the weld whose reaction it measures, and the fingertip beyond it."""
    tip = Solid(kind="capsule", size=(TIP_RADIUS, TIP_LENGTH), center=(0, 0, TIP_LENGTH / 2), color=RUBBER)
    frame = f'<frame name="{finger}_sensor" attached_to="{distal}">{pose((0, 0, height))}</frame>'
    link = Link(name=f"{finger}_tip", mass=0.006, solids=[tip], parent=f"{finger}_sensor")
    joint = weld(f"{finger}_tip_weld", f"{finger}_sensor", f"{finger}_tip")
    return [frame, link_text(link, modulus=TIP_MODULUS, resolution=TIP_RESOLUTION), joint]


def finger_links(
    finger: str, prefix: str, base: str, position: tuple[float, float, float], spread: float
) -> list[Link]:
    """Knuckle (J4), proximal (J3), middle (J2) and distal phalanx (J1, coupled to J2)."""
    knuckle = Solid(kind="cylinder", size=(0.0085, 0.014), rpy=(math.pi / 2, 0, 0), color=DARK)
    # The distal phalanx is slimmer than the fingertip, so that the fingertip touches first.
    distal = Solid(kind="capsule", size=(0.0072, 0.007), center=(0, 0, 0.005))
    return [
        Link(
            name=f"{finger}_knuckle", mass=0.008, solids=[knuckle], parent=base, position=position,
            joint=f"{prefix}J4", axis=(0, spread, 0), limits_deg=(-20, 20),
        ),
        Link(
            name=f"{finger}_proximal", mass=0.030, solids=phalanx(0.045, 0.0085), parent=f"{finger}_knuckle",
            joint=f"{prefix}J3", limits_deg=(-15, 90),
        ),
        Link(
            name=f"{finger}_middle", mass=0.017, solids=phalanx(0.025, 0.0078), parent=f"{finger}_proximal",
            position=(0, 0, 0.045), joint=f"{prefix}J2", limits_deg=(0, 90),
        ),
        Link(
            name=f"{finger}_distal", mass=0.012, solids=[distal, phalanx(0.01, 0.0075)[1]], parent=f"{finger}_middle",
            position=(0, 0, 0.025), joint=f"{prefix}J1", limits_deg=(0, 90), mimic=f"{prefix}J2",
            extra=fingertip(finger, f"{finger}_distal", 0.012),
        ),
    ]  # fmt: skip


def hand_links() -> list[Link]:
    forearm = Solid(kind="cylinder", size=(0.038, 0.15), center=(0, 0, -0.088), color=DARK)
    cuff = Solid(kind="cylinder", size=(0.045, 0.03), center=(0, 0, -0.15), color=GREY)
    palm = [
        Solid(kind="box", size=(0.062, 0.022, 0.080), center=(0.012, 0.0, 0.048)),
        Solid(kind="box", size=(0.072, 0.022, 0.022), center=(0.0, 0.0, 0.006)),
        Solid(kind="capsule", size=(0.011, 0.05), center=(0.011, 0, 0.086), rpy=(0, math.pi / 2, 0), color=DARK),
    ]
    hinge = Solid(kind="cylinder", size=(0.016, 0.05), rpy=(0, math.pi / 2, 0), color=DARK)
    neck = Solid(kind="cylinder", size=(0.015, 0.034), center=(0, 0, 0.017), color=DARK, collides=False)
    metacarpal = [
        Solid(kind="box", size=(0.019, 0.020, 0.056), center=(0.0, 0.0, 0.032)),
        Solid(kind="cylinder", size=(0.008, 0.018), rpy=(math.pi / 2, 0, 0), color=DARK, collides=False),
    ]
    thumb_base = Solid(kind="sphere", size=(0.013,), color=DARK)
    thumb_hub = Solid(kind="sphere", size=(0.0105,), color=DARK)
    thumb_distal = Solid(kind="capsule", size=(0.0075, 0.008), center=(0, 0, 0.0055))
    wrist = {"effort": 10.0, "damping": 4.0, "rotor_inertia": 4.0e-3}
    return [
        Link(name="forearm", mass=3.0, solids=[forearm, cuff]),
        Link(
            name="wrist", mass=0.1, parent="forearm", joint="WRJ2", axis=(0, 1, 0), limits_deg=(-30, 10),
            solids=[hinge, neck], **wrist,
        ),
        Link(
            name="palm", mass=0.3, solids=palm, parent="wrist", position=(0, 0, 0.034), joint="WRJ1",
            limits_deg=(-45, 35), **wrist,
        ),
        *finger_links("first", "FF", "palm", (0.033, 0, 0.095), -1),
        *finger_links("middle", "MF", "palm", (0.011, 0, 0.099), -1),
        *finger_links("ring", "RF", "palm", (-0.011, 0, 0.095), 1),
        Link(
            name="little_metacarpal", mass=0.030, solids=metacarpal, parent="palm", position=(-0.033, 0, 0.02071),
            joint="LFJ5", axis=(math.sin(math.radians(35)), 0, math.cos(math.radians(35))), limits_deg=(0, 45),
        ),
        *finger_links("little", "LF", "little_metacarpal", (0, 0, 0.06579), 1),
        Link(
            name="thumb_base", mass=0.010, solids=[thumb_base], parent="palm", position=(0.034, -0.00858, 0.029),
            rpy=(0, math.pi / 4, 0), joint="THJ5", axis=(0, 0, -1), limits_deg=(-60, 60),
        ),
        Link(
            name="thumb_proximal", mass=0.040, solids=phalanx(0.038, 0.0105), parent="thumb_base", joint="THJ4",
            limits_deg=(0, 70),
        ),
        Link(
            name="thumb_hub", mass=0.005, solids=[thumb_hub], parent="thumb_proximal", position=(0, 0, 0.038),
            joint="THJ3", limits_deg=(-12, 12),
        ),
        Link(
            name="thumb_middle", mass=0.020, solids=phalanx(0.032, 0.009), parent="thumb_hub", joint="THJ2",
            axis=(0, -1, 0), limits_deg=(-40, 40),
        ),
        Link(
            name="thumb_distal", mass=0.012, solids=[thumb_distal], parent="thumb_middle", position=(0, 0, 0.032),
            rpy=(0, 0, -math.pi / 2), joint="THJ1", limits_deg=(-15, 90),
            extra=fingertip("thumb", "thumb_distal", 0.0135),
        ),
    ]  # fmt: skip


def model_text() -> str:
    tips = [f"{finger}_tip" for finger in ("first", "middle", "ring", "little", "thumb")]
    return sdf.model_text("shadow_like", hand_links(), tips)


if __name__ == "__main__":
    Path(__file__).with_name("shadow_like.sdf").write_text(model_text(), encoding="utf-8")
