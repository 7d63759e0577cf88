"""What a simulated camera looks at, and from where."""

import dataclasses

from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody

from tactopose_drake.core.shape.object_model import ObjectModel


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class CameraView:
    """An object in a hand, before a camera.

    Attributes:
        plant: finalized plant that holds the hand and the object.
        inspector: of the SceneGraph that holds their geometry (`scene_graph.model_inspector()`).
        object_body: the object; its body frame is the frame O of the model's mesh.
        object_model: the object's surface.
        palm_frame: P; the hand is its model instance.
        X_WC: pose of the camera in the world; z forward, y down.
    """

    plant: MultibodyPlant
    inspector: SceneGraphInspector
    object_body: RigidBody
    object_model: ObjectModel
    palm_frame: Frame
    X_WC: RigidTransform
