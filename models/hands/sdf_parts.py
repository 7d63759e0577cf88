"""Links, joints and solids as SDF text, shared by the generators of hands and arms."""

from dataclasses import dataclass, field
from math import radians

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import UnitInertia

GREY, DARK, RUBBER = "0.62 0.64 0.67 1", "0.16 0.17 0.19 1", "0.28 0.30 0.34 1"
LINK_MODULUS = 1.0e7  # Pa
FRICTION = 0.9  # rubber on a dry, hard object


@dataclass(kw_only=True)
class Solid:
    """A primitive in its link's frame; capsules and cylinders extend along z from `center`.

    A mesh is a pair of files without their suffixes: .obj for the visual geometry, .vtk (tetrahedra) for contact; its
    size is that of its bounding box, for the inertia.
    """

    kind: str  # capsule, cylinder, box, sphere, mesh
    size: tuple[float, ...]  # m: (radius, length), (x, y, z) or (radius,)
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad
    color: str = GREY
    collides: bool = True
    mesh: str = ""

    def geometry(self, *, to_touch: bool) -> str:
        if self.kind == "mesh":
            return f"<mesh><uri>{self.mesh}.{'vtk' if to_touch else 'obj'}</uri></mesh>"
        if self.kind == "box":
            return f"<box><size>{numbers(*self.size)}</size></box>"
        if self.kind == "sphere":
            return f"<sphere><radius>{numbers(*self.size)}</radius></sphere>"
        radius, length = self.size
        return f"<{self.kind}><radius>{numbers(radius)}</radius><length>{numbers(length)}</length></{self.kind}>"

    def unit_inertia(self) -> UnitInertia:
        if self.kind in ("box", "mesh"):
            return UnitInertia.SolidBox(*self.size)
        if self.kind == "sphere":
            return UnitInertia.SolidSphere(*self.size)
        make = UnitInertia.SolidCapsule if self.kind == "capsule" else UnitInertia.SolidCylinder
        return make(*self.size, np.array([0.0, 0.0, 1.0]))


@dataclass(kw_only=True)
class Link:
    """A link, and the joint that moves it."""

    name: str
    mass: float  # kg, distributed uniformly over the first solid
    solids: list[Solid]
    parent: str = ""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the parent
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad, in the parent
    joint: str = ""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    limits_deg: tuple[float, float] = (0.0, 0.0)
    effort: float = 2.0  # N m
    speed: float = 0.0  # maximum, rad/s; 0: not limited
    damping: float = 0.03  # N m s/rad
    rotor_inertia: float = 2.0e-4  # kg m^2, reflected to the joint
    mimic: str = ""  # the joint that this one follows; then it has no actuator
    ratio: float = 1.0  # ratio of this joint's position to that of the other
    extra: list[str] = field(default_factory=list)  # frames and joints attached to this link


def numbers(*values: float) -> str:
    return " ".join(f"{0.0 if abs(v) < 1e-12 else v:.9g}" for v in values)


def pose(position: tuple[float, ...], rpy: tuple[float, ...] = (0.0, 0.0, 0.0), relative_to: str = "") -> str:
    where = f' relative_to="{relative_to}"' if relative_to else ""
    return f"<pose{where}>{numbers(*position, *rpy)}</pose>"


def weld(name: str, parent: str, child: str) -> str:
    return f'<joint name="{name}" type="fixed"><parent>{parent}</parent><child>{child}</child></joint>'


def inertial_text(link: Link) -> str:
    solid = link.solids[0]
    R = RotationMatrix(RollPitchYaw(list(solid.rpy)))
    moments = link.mass * solid.unit_inertia().ReExpress(R).CopyToFullMatrix3()
    terms = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), moments[np.triu_indices(3)], strict=True)
    inertia = "".join(f"<{name}>{numbers(value)}</{name}>" for name, value in terms)
    return f"<inertial>{pose(solid.center)}<mass>{numbers(link.mass)}</mass><inertia>{inertia}</inertia></inertial>"


def link_text(link: Link, *, modulus: float = LINK_MODULUS, resolution: float = 0.006) -> str:
    lines = [f'<link name="{link.name}">']
    if link.parent:
        lines.append(pose(link.position, link.rpy, link.parent))
    lines.append(inertial_text(link))
    for i, solid in enumerate(link.solids):
        place = pose(solid.center, solid.rpy)
        look = f"<material><diffuse>{solid.color}</diffuse></material>"
        shown, touched = (f"<geometry>{solid.geometry(to_touch=to_touch)}</geometry>" for to_touch in (False, True))
        lines.append(f'<visual name="visual_{i}">{place}{shown}{look}</visual>')
        if solid.collides:
            proximity = (
                "<drake:proximity_properties><drake:compliant_hydroelastic/>"
                f"<drake:hydroelastic_modulus>{numbers(modulus)}</drake:hydroelastic_modulus>"
                f"<drake:mesh_resolution_hint>{numbers(resolution)}</drake:mesh_resolution_hint>"
                f"<drake:mu_static>{numbers(FRICTION)}</drake:mu_static>"
                f"<drake:mu_dynamic>{numbers(FRICTION)}</drake:mu_dynamic></drake:proximity_properties>"
            )
            lines.append(f'<collision name="collision_{i}">{place}{touched}{proximity}</collision>')
    lines.append("</link>")
    return "\n".join(lines)


def joint_text(link: Link) -> str:
    lower, upper = (radians(angle) for angle in link.limits_deg)
    # For Drake, an effort limit of zero means that a joint has no actuator.
    effort = 0.0 if link.mimic else link.effort
    mimic = f'<drake:mimic joint="{link.mimic}" multiplier="{numbers(link.ratio)}" offset="0"/>' if link.mimic else ""
    rotor = "" if link.mimic else f"<drake:rotor_inertia>{numbers(link.rotor_inertia)}</drake:rotor_inertia>"
    bounds = f"<lower>{numbers(lower)}</lower><upper>{numbers(upper)}</upper><effort>{numbers(effort)}</effort>"
    bounds += f"<velocity>{numbers(link.speed)}</velocity>" if link.speed else ""
    dynamics = f"<dynamics><damping>{numbers(link.damping)}</damping></dynamics>"
    return (
        f'<joint name="{link.joint}" type="revolute"><parent>{link.parent}</parent><child>{link.name}</child>\n'
        f"<axis><xyz>{numbers(*link.axis)}</xyz><limit>{bounds}</limit>{dynamics}</axis>{mimic}{rotor}</joint>"
    )


def model_text(name: str, links: list[Link], more_links: list[str], group: str = "hand") -> str:
    """The file of a model: links in order, each with its attachments; `more_links` names the links among these.

    Contacts between links of the `group` are excluded.
    """
    parts = []
    for link in links:
        parts += [link_text(link), *link.extra]
        if link.joint:
            parts.append(joint_text(link))
    members = "\n".join(f"<drake:member>{member}</drake:member>" for member in [*(k.name for k in links), *more_links])
    # Neighbouring links overlap at their joints, so contact within the model is not modelled.
    collision_filter = (
        f'<drake:collision_filter_group name="{group}">\n{members}\n'
        f"<drake:ignored_collision_filter_group>{group}</drake:ignored_collision_filter_group>\n"
        "</drake:collision_filter_group>"
    )
    body = "\n".join([*parts, collision_filter])
    return (
        '<?xml version="1.0"?>\n<!-- Written by generate.py; change the figures there. -->\n'
        '<sdf version="1.11" xmlns:drake="http://drake.mit.edu">\n'
        f'<model name="{name}">\n{body}\n</model>\n</sdf>\n'
    )
