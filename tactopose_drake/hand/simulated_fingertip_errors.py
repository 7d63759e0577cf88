"""Errors of a simulated hand's fingertips and tactile pads: other radii and other mountings than in its files."""

from collections.abc import Mapping

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    GeometrySet,
    Mesh,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant

_STILL = 1e-12  # tolerance of an identity pose, in m and in the rotation matrix


def change_fingertips(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    radius: Mapping[str, float],
    X_SM: Mapping[str, RigidTransform],
) -> None:
    """Makes the collision shapes of a hand's fingertips thicker, and moves them; the plant is not finalized yet.

    Args:
        plant: the simulator's plant.
        scene_graph: its SceneGraph.
        hand: the hand in it.
        radius: increase of each fingertip's radius, by finger, m. A mesh or a box is scaled about the fingertip's
            middle, in proportion to the fingertip's half-width.
        X_SM: pose of the true sensor frame M in the nominal one S, by finger; the fingertip moves with it.
    """
    alone, parts = make_hand_plant(hand.config)
    context, inspector = alone.CreateDefaultContext(), scene_graph.model_inspector()
    for finger, frame in parts.sensor_frames.items():
        X_BS = alone.CalcRelativeTransform(context, parts.welds[finger].child_body().body_frame(), frame)
        surface = parts.surfaces[finger]
        middle_B = X_BS @ surface.X_SF[:, 3]
        for geometry in plant.GetCollisionGeometriesForBody(hand.welds[finger].child_body()):
            X_BG = inspector.GetPoseInFrame(geometry)
            scale = 1.0 + radius[finger] / surface.half_width
            shape, is_scaled = _thicker(inspector.GetShape(geometry), radius[finger], scale)
            p_BG = middle_B + scale * (X_BG.translation() - middle_B) if is_scaled else X_BG.translation()
            X_BG = X_BS @ X_SM[finger] @ X_BS.inverse() @ RigidTransform(X_BG.rotation(), p_BG)
            _change(plant, scene_graph, hand, geometry, shape, X_BG)


def move_pads(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, X_TM: Mapping[str, RigidTransform]) -> None:
    """Moves the collision shapes of a hand's tactile pads; the plant is not finalized yet.

    Args:
        plant: the simulator's plant.
        scene_graph: its SceneGraph.
        hand: the hand in it.
        X_TM: pose of the true array frame M in the nominal one T, by pad.
    """
    inspector = scene_graph.model_inspector()
    for pad, frame in hand.pad_frames.items():
        X_BT = frame.GetFixedPoseInBodyFrame()
        for geometry in plant.GetCollisionGeometriesForBody(frame.body()):
            X_BG = X_BT @ X_TM[pad] @ X_BT.inverse() @ inspector.GetPoseInFrame(geometry)
            _change(plant, scene_graph, hand, geometry, inspector.GetShape(geometry), X_BG)


def check_mounting(hand: Hand, X_SM: Mapping[str, RigidTransform], X_TM: Mapping[str, RigidTransform]) -> None:
    """Checks that no body would be moved by the mounting errors of two sensors.

    Args:
        hand: the hand.
        X_SM: pose of each true sensor frame in the nominal one, by finger.
        X_TM: likewise for each tactile array, by pad.

    Raises:
        InvalidInputError: if two sensors are on one body, and one of them has a mounting error.
    """
    senses = [(hand.welds[finger].child_body().name(), X) for finger, X in X_SM.items()]
    senses += [(hand.pad_frames[pad].body().name(), X) for pad, X in X_TM.items()]
    bodies = [name for name, _ in senses]
    moved = {name for name, X in senses if not X.IsNearlyIdentity(_STILL)}
    if twice := sorted(name for name in moved if bodies.count(name) > 1):
        raise InvalidInputError(
            f"SimulatedErrors must have no mounting error of the two sensors of {', '.join(twice)}, which cannot move "
            "apart: `mounting: [0, 0, 0]` and `mounting_deg: [0, 0, 0]` of each in `errors.fingers` and `errors.pads`, "
            "or 0 of both in the hand's `uncertainty`, which errors are drawn from."
        )


def _change(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    geometry: GeometryId,
    shape: Shape,
    X_BG: RigidTransform,
) -> None:
    """Changes a collision shape of the hand and its pose; its collision filters stay."""
    inspector = scene_graph.model_inspector()
    passed = [
        other
        for body in map(plant.get_body, plant.GetBodyIndices(hand.model_instance))
        for other in plant.GetCollisionGeometriesForBody(body)
        if inspector.CollisionFiltered(geometry, other)
    ]
    scene_graph.ChangeShape(plant.get_source_id(), geometry, shape, X_BG)
    # ChangeShape drops the shape's collision filters.
    apart = CollisionFilterDeclaration().ExcludeBetween(GeometrySet(geometry), GeometrySet(passed))
    scene_graph.collision_filter_manager().Apply(apart)


def _thicker(shape: Shape, radius: float, scale: float) -> tuple[Shape, bool]:
    """The shape, and whether it was scaled about the fingertip's middle."""
    if isinstance(shape, Sphere):
        return Sphere(shape.radius() + radius), False
    if isinstance(shape, Capsule):
        return Capsule(shape.radius() + radius, shape.length()), False
    if isinstance(shape, Cylinder):
        return Cylinder(shape.radius() + radius, shape.length() + 2.0 * radius), False
    if isinstance(shape, Ellipsoid):
        return Ellipsoid(shape.a() + radius, shape.b() + radius, shape.c() + radius), False
    if isinstance(shape, Box):
        return Box(*(scale * shape.size())), True
    if isinstance(shape, Mesh | Convex):
        return type(shape)(shape.source(), scale * np.asarray(shape.scale3())), True
    return shape, False
