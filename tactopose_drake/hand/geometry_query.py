"""Access to the shapes of a plant at the positions of a context."""

from pydrake.geometry import QueryObject
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.errors import InvalidInputError


def geometry_query(plant: MultibodyPlant, context: Context) -> QueryObject:
    """Drake's queries about the shapes of a plant.

    Args:
        plant: finalized plant that is connected to a SceneGraph.
        context: the plant's context in that diagram.

    Raises:
        InvalidInputError: if the plant is not finalized, or the context is not the plant's or knows no SceneGraph.
    """
    if not plant.is_finalized():
        raise InvalidInputError("plant must be finalized, and part of a diagram, but is not finalized.")
    try:
        plant.ValidateContext(context)
    except RuntimeError:
        raise InvalidInputError(
            "context must be the plant's, as plant.GetMyContextFromRoot(root) gives it, not another system's."
        ) from None
    port = plant.get_geometry_query_input_port()
    if not port.HasValue(context):
        raise InvalidInputError(
            "context must be the plant's context in a diagram, and connect it to a SceneGraph, which holds the hand's "
            "geometry."
        )
    return port.Eval(context)
