"""A ball pressed by 2 mm onto the palm's pad of the Barrett-like hand, whose open fingers do not reach it."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tests.core.models import globe

RADIUS = 0.04
SILENT = "; ".join(f"finger_{i}: no contact" for i in (1, 2, 3))  # what the statuses say of the other pads


def make_ball() -> ObjectModel:
    return globe(RADIUS)


def press(diagram: Diagram, context: Context, vision: str) -> NDArray[np.float64]:
    """Fixes the inputs of an estimation or a tracking, the prior on the port of that name; returns the ball's p_PO."""
    hand = load_hand_config("barrett_like")
    plant, parts = make_hand_plant(hand)
    layouts = {pad.name: load_tactile_pad(pad.array).layout for pad in hand.pads}
    alpha = {pad.name: pad.alpha for pad in hand.pads}
    X_PT = plant.CalcRelativeTransform(plant.CreateDefaultContext(), parts.palm_frame, parts.pad_frames["palm"])
    p_PT, n_PT = X_PT.multiply(layouts["palm"].p_TC.T).T, layouts["palm"].n_T @ X_PT.rotation().matrix().T
    p_PO = p_PT.mean(axis=0) + (RADIUS - 0.002) * n_PT[0]

    diagram.GetInputPort("joint_positions").FixValue(context, np.zeros(plant.num_positions()))
    for name, layout in layouts.items():
        diagram.GetInputPort(f"pressures_{name}").FixValue(context, np.zeros(len(layout)))
    # How far the way into the pad leads through the ball from each cell.
    off = p_PT - p_PO
    along = np.einsum("ij,ij->i", off, n_PT)
    depth = along + np.sqrt(along**2 + np.maximum(RADIUS**2 - np.sum(off**2, axis=1), 0.0))
    diagram.GetInputPort("pressures_palm").FixValue(context, depth / alpha["palm"])
    prior = PosePrior(RigidTransform(p_PO + 0.006 * n_PT[0]), sigma_translation=0.01)
    diagram.GetInputPort(vision).FixValue(context, AbstractValue.Make(prior))
    return np.asarray(p_PO)
