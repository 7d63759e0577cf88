"""Check of a hand's model: its links, their collision shapes, and its palm."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex

from tactopose_drake.hand.findings import Finding
from tactopose_drake.hand.finger_chain import joints_towards
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_in_plant import Hand, pose_by_model
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.resources import complaint_kind

_FARTHEST = 1.0  # largest distance of a hand's collision shapes from the palm, m


def check_model(
    plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, complaints: tuple[str, ...]
) -> Iterator[Finding]:
    """Yields findings on the links, their collision shapes and the palm.

    Args:
        plant: finalized plant with the hand, its base fixed.
        scene_graph: the plant's SceneGraph.
        hand: the hand in it.
        complaints: Drake's warnings from parsing the model.
    """
    inspector, instance = scene_graph.model_inspector(), hand.model_instance
    shapes = [
        (
            plant.get_body(index).name(),
            len(inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity)),
        )
        for index in plant.GetBodyIndices(instance)
    ]
    count = sum(number for _, number in shapes)
    yield Finding("model", f"{len(shapes)} links with {count} collision shapes", "ok" if count else "fault")
    yield from _too_far(plant, scene_graph, hand)
    bare = [name for name, number in shapes if not number]
    if bare and count:
        yield Finding("model", f"no collision shape, so no part of the hand's volume: {', '.join(bare)}", "note")
    kinds = Counter(map(complaint_kind, complaints))
    firsts = {complaint_kind(message): message for message in reversed(complaints)}
    for kind, count in kinds.items():
        # Shorten paths to the model's files to their names.
        text = " ".join(firsts[kind].replace(f"{Path(hand.config.model).parent}/", "").split()).removesuffix(".")
        yield Finding("model", f"Drake says{_times(count)}: {text}", "note")
    P = hand.palm_frame
    yield Finding(
        "palm", f"frame {P.name()!r} on link {P.body().name()!r}; the link {hand.config.base_link!r} carries it"
    )
    if pose_by_model(hand.config) is not None:
        text = (
            f"the model itself fixes {hand.config.base_link!r} to the world; a scenario's X_WBase must be that pose, "
            "and an arm cannot carry it"
        )
        yield Finding("palm", text, "note")
    moved = joints_towards(plant, hand, P, hand.config.base_link)
    if moved:
        yield Finding(
            "palm", f"is moved by {', '.join(moved)}: joints beside the fingers' must be measured too", "note"
        )


def _too_far(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> Iterator[Finding]:
    """Findings on links whose shapes reach farther than any hand does, as in millimetres."""
    spheres = BodySpheres.from_inspector(plant, scene_graph.model_inspector(), hand.model_instance)
    reach = np.linalg.norm(HandKinematics(plant, hand.palm_frame).positions(spheres), axis=1) + spheres.radius
    for body in np.unique(spheres.body[reach > _FARTHEST]):
        name = plant.get_body(BodyIndex(body)).name()
        text = f"the collision shapes of {name!r} reach {reach[spheres.body == body].max():.3g} m from the palm"
        yield Finding("model", f"{text}, which must be at most {_FARTHEST:g} m", "fault")


def _times(count: int) -> str:
    return f" of {count} places" if count > 1 else ""
