"""Self-collision checks of a hand, with its model's collision shapes."""

from collections.abc import Mapping

from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.contact_properties import leave_friction_out, let_overlap, self_collisions
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import add_fixed_hand
from tactopose_drake.hand.hand_reach import rest_posture


class SelfCollision:
    """Checks with Drake whether links of a hand overlap; a mesh counts as its convex hull.

    Pairs of shapes that overlap at zero joint positions are ignored, as in the simulation.
    """

    def __init__(self, config: HandConfig) -> None:
        """Builds a diagram of the hand alone."""
        builder = DiagramBuilder()
        # Given a time step in place of a plant, Drake 1.51 never frees what it makes: half a megabyte for a hand.
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, plant=MultibodyPlant(time_step=0.001))
        leave_friction_out(scene_graph)
        self._hand = add_fixed_hand(self._plant, config)
        self._plant.Finalize()
        self._diagram = builder.Build()
        posture = self._plant.GetMyContextFromRoot(self._diagram.CreateDefaultContext())
        let_overlap(self._plant, scene_graph, posture, self._hand.model_instance)
        self._context = self._plant.GetMyContextFromRoot(self._diagram.CreateDefaultContext())

    def __call__(self, positions: Mapping[str, FloatArray]) -> bool:
        """Whether any two links overlap.

        Args:
            positions: positions of some fingers' actuated joints, shape (m,), rad or m, by finger; other fingers are
                at rest, and coupled joints follow.
        """
        q = rest_posture(self._plant, self._hand, positions)
        self._plant.SetPositions(self._context, self._hand.model_instance, q)
        return bool(self_collisions(self._plant, self._context, self._hand.model_instance))
