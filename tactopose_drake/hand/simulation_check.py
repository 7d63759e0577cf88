"""Check of a hand's contact properties and dynamics for simulation."""

import math
from collections.abc import Iterator

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody, SpatialInertia
from pydrake.systems.framework import Context

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.hand.contact_properties import rigid_shapes, self_collisions, unsaid_shapes
from tactopose_drake.hand.findings import Finding
from tactopose_drake.hand.hand_in_plant import Hand, joints_of

_SLOWEST = 0.5  # s that a joint's damping may take to let the default grasp controller's spring close it
_STIFFNESS = ReachParams().stiffness  # N m/rad


def check_simulation(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, context: Context) -> Iterator[Finding]:
    """Yields findings on contact, masses and damping, which matter only in simulation.

    Args:
        plant: finalized plant with the hand, its base fixed.
        scene_graph: the plant's SceneGraph.
        hand: the hand in it.
        context: the plant's context in a diagram with the SceneGraph, with all joints at zero.
    """
    yield from _contact(plant, scene_graph, hand, context)
    yield from _dynamics(plant, hand, context)


def _contact(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, context: Context) -> Iterator[Finding]:
    inspector, instance = scene_graph.model_inspector(), hand.model_instance
    rigid, unsaid = rigid_shapes(plant, inspector, instance), unsaid_shapes(plant, inspector, instance)
    if rigid:
        text = f"rigid shapes, which cannot touch a rigid object in hydroelastic contact: {', '.join(rigid)}"
        yield Finding("contact", text, "fault")
    if unsaid:
        text = f"{len(unsaid)} shapes do not say whether they are compliant; the simulation takes them for hard rubber"
        yield Finding("contact", text, "note")
    if not rigid and not unsaid:
        yield Finding("contact", "all shapes are compliant")
    pairs = self_collisions(plant, context, instance)
    if pairs:
        text = "at zero joint positions overlap, and pass through each other in the simulation: "
        yield Finding("contact", text + ", ".join(f"{a} and {b}" for a, b in pairs), "note")
    else:
        yield Finding("contact", "no two links overlap at zero joint positions")


def _dynamics(plant: MultibodyPlant, hand: Hand, context: Context) -> Iterator[Finding]:
    joints = joints_of(plant, hand)
    light = [joint for joint in joints if joint.num_positions() and not joint.child_body().get_mass(context) > 0.0]
    bare = [joint.child_body().name() for joint in light if not _carried(plant, joint, context) > 0.0]
    carrying = [joint.child_body().name() for joint in light if joint.child_body().name() not in bare]
    if bare:
        text = f"links without a mass, which can be posed but not simulated: {', '.join(bare)}"
        yield Finding("dynamics", text, "note")
    if carrying:
        text = f"links without a mass, which are simulated with that of what they carry: {', '.join(carrying)}"
        yield Finding("dynamics", text, "note")
    replaced = [
        body.name() for body in map(plant.get_body, plant.GetBodyIndices(hand.model_instance)) if _is_water(body)
    ]
    if replaced:
        text = (
            "links with an impossible inertia in the file, such as without a mass, which Drake replaces by balls of "
            f"1 kg: {', '.join(replaced)}"
        )
        yield Finding("dynamics", text, "note")
    elif not light:
        yield Finding(
            "dynamics", f"all links have masses, {plant.CalcTotalMass(context, [hand.model_instance]):.3g} kg in all"
        )
    damping = max(
        (float(np.max(j.default_damping_vector())) for j in joints if j.name() in hand.config.driven), default=0.0
    )
    if damping > _SLOWEST * _STIFFNESS:
        stiffness = f"{damping / 0.1:g}"
        text = (
            f"joint damping of up to {damping:g} N m s/rad lets the fingers close slowly; give the scenario "
            f"`reach: {{stiffness: {stiffness}}}` and `controller: {{finger_stiffness: {stiffness}}}`, N m/rad"
        )
        yield Finding("dynamics", text, "note")


def _is_water(body: RigidBody) -> bool:
    """Whether a body has the inertia that Drake substitutes for an invalid one: a kilogram of water."""
    water = SpatialInertia.SolidSphereWithMass(1.0, (0.75e-3 / math.pi) ** (1.0 / 3.0))
    return np.allclose(
        body.default_spatial_inertia().CopyToFullMatrix6(), water.CopyToFullMatrix6(), rtol=0.0, atol=1e-9
    )


def _carried(plant: MultibodyPlant, joint: Joint, context: Context) -> float:
    """The mass of all that a joint moves, kg."""
    bodies = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    return sum(float(plant.get_body(index).get_mass(context)) for index in bodies)
