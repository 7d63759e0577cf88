"""Initial poses of objects in an open hand with its palm up, without penetration."""

import numpy as np
import pydrake.all as drake

import tactopose_drake as tp


def lay(model: tp.ObjectModel, generator: np.random.Generator) -> drake.RigidTransform:
    """A random pose across the open hand, with the object's middle near a fixed point above the palm."""
    across = drake.RotationMatrix(drake.RollPitchYaw(np.pi / 2, 0, np.pi / 2))
    turned = drake.RotationMatrix.MakeXRotation(np.pi * generator.integers(2))
    spun = drake.RotationMatrix.MakeZRotation(generator.uniform(-np.pi, np.pi))
    tilt = drake.RotationMatrix(drake.RollPitchYaw(0.2 * generator.normal(size=3)))
    R = tilt @ across @ turned @ spun
    return drake.RigidTransform(R, [0.02, -0.05, 0.065] + 0.012 * generator.normal(size=3) - R @ model.middle)


def clear_of_the_hand(
    plant: drake.MultibodyPlant,
    context: drake.Context,
    body: drake.RigidBody,
    X_WP: drake.RigidTransform,
    X_PO: drake.RigidTransform,
) -> drake.RigidTransform:
    """Raises the pose until the object penetrates no part of the hand, and sets it in the context."""
    own = plant.GetCollisionGeometriesForBody(body)
    for _ in range(60):
        plant.SetFreeBodyPose(context, body, X_WP @ X_PO)
        pairs = plant.get_geometry_query_input_port().Eval(context).ComputePointPairPenetration()
        if not any(pair.id_A in own or pair.id_B in own for pair in pairs):
            break
        up_P = X_WP.rotation().inverse() @ np.array([0.0, 0.0, 0.002])
        X_PO = drake.RigidTransform(X_PO.rotation(), X_PO.translation() + up_P)
    return X_PO
