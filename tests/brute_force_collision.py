"""How deep a hand is in an object, by brute force."""

import numpy as np
import trimesh
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Mesh, Role, Shape, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.hull_vertices import hull_vertices
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import add_hand


def brute_force(
    hand: HandConfig, model: ObjectModel, q: np.ndarray, X_PO: np.ndarray
) -> tuple[np.ndarray, list[dict[str, float]]]:
    """By points all over and within the object, each against each shape; the greatest depth, and that in each link."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    palm = add_hand(plant, hand, RigidTransform()).palm_frame
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    inspector = scene_graph.model_inspector()
    shapes: list[tuple[str, RigidTransform, Shape]] = []
    for body in (plant.get_body(index) for index in plant.GetBodyIndices(palm.model_instance())):
        X_PB = plant.CalcRelativeTransform(context, palm, body.body_frame())
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
            shapes.append((body.name(), X_PB @ inspector.GetPoseInFrame(geometry), inspector.GetShape(geometry)))
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    points = trimesh.sample.sample_surface_even(mesh, 60000, seed=0)[0]
    within = np.random.default_rng(1).uniform(mesh.bounds[0], mesh.bounds[1], (80000, 3))
    points = np.concatenate([points, within[model.grid.distance(within) < 0]])
    by_link: list[dict[str, float]] = []
    for X in X_PO:
        p_PQ = points @ X[:, :3].T + X[:, 3]
        deepest: dict[str, float] = {}
        for link, X_PG, shape in shapes:
            depth = float(depths(shape, X_PG.inverse().multiply(p_PQ.T).T).max())
            deepest[link] = max(deepest.get(link, 0.0), depth)
        by_link.append(deepest)
    return np.array([max(deepest.values()) for deepest in by_link]), by_link


def depths(shape: Shape, p_GQ: np.ndarray) -> np.ndarray:
    if isinstance(shape, Mesh | Convex):
        planes = ConvexHull(hull_vertices(shape.GetConvexHull())).equations  # n^T p + d <= 0 within
        return -np.max(p_GQ @ planes[:, :3].T + planes[:, 3], axis=1)
    if isinstance(shape, Box):
        return np.min(shape.size() / 2 - np.abs(p_GQ), axis=1)
    across, along = np.linalg.norm(p_GQ[:, :2], axis=1), np.abs(p_GQ[:, 2])
    if isinstance(shape, Cylinder):
        return np.minimum(shape.radius() - across, shape.length() / 2 - along)
    if not isinstance(shape, Capsule | Sphere):
        raise NotImplementedError(f"depths in a {type(shape).__name__}")
    half = shape.length() / 2 if isinstance(shape, Capsule) else 0.0
    return shape.radius() - np.hypot(across, np.maximum(along - half, 0.0))
