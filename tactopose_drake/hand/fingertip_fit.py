"""The fit of a fingertip's surface in the hand's file to its collision shapes in the model."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.shape_depth import body_depths

_POINTS = 400
_NEAR = 0.001  # m


@dataclass(frozen=True)
class FingertipFit:
    """The fit of a surface to collision shapes.

    Attributes:
        share: share of the surface within 1 mm of the shapes' surface, 0 to 1.
        above: largest distance of the surface outside all shapes, m.
        below: largest depth of the surface inside them, m.
    """

    share: float
    above: float
    below: float


def fingertip_fit(
    plant: MultibodyPlant, inspector: SceneGraphInspector, hand: Hand, finger: str
) -> FingertipFit | None:
    """Compares a fingertip's surface with the collision shapes of its link; None if the link has none.

    Args:
        plant: finalized plant that holds the hand.
        inspector: inspector of its geometry.
        hand: the hand.
        finger: the finger's name.
    """
    tip, surface = hand.welds[finger].child_body(), hand.surfaces[finger]
    context = plant.CreateDefaultContext()
    X_TipS = plant.CalcRelativeTransform(context, tip.body_frame(), hand.sensor_frames[finger])
    p_TipQ = X_TipS.multiply(surface.sample(np.random.default_rng(0), _POINTS).T).T
    deepest = body_depths(plant, inspector, tip, p_TipQ)
    if deepest is None:
        return None
    share = float(np.mean(np.abs(deepest) < _NEAR))
    return FingertipFit(share, float(max(0.0, -deepest.min())), float(max(0.0, deepest.max())))
