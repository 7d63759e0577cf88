"""How well a fingertip's surface, of the hand's file, lies on its collision shapes, of the model."""

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
    """How a surface lies on collision shapes.

    Attributes:
        share: of the surface within 1 mm of that of the shapes, 0 to 1.
        above: how far the surface is outside of all shapes at the most, m.
        below: how deep it is in them at the most, m.
    """

    share: float
    above: float
    below: float


def fingertip_fit(
    plant: MultibodyPlant, inspector: SceneGraphInspector, hand: Hand, finger: str
) -> FingertipFit | None:
    """Compares a fingertip's surface with the shapes of its link; None where that has none.

    Args:
        plant: finalized plant that holds the hand.
        inspector: of the geometry.
        hand: the hand.
        finger: its name.
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
