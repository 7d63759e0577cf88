"""A depth camera in a simulated scene: Drake's renderer, and the noise that a real camera has."""

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.sensors import CameraInfo, ImageDepth16U, ImageDepth32F, RgbdSensor

from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, noisy_depth
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import check_name_is_free, eval_input

_RENDERER = "depth_camera_renderer"
_CLIPPING = 0.01, 10.0  # m
_TOO_FAR = 65535  # Drake's value, in an image of millimetres, of what is beyond the camera's range


class DepthNoise(CollectableSystem):
    """Adds a depth camera's noise to its images.

    .. pydrake_system::

        name: DepthNoise
        input_ports:
        - exact_depth
        - noise
        output_ports:
        - depth_image

    - exact_depth: `ImageDepth32F`, m; infinite or 0 where nothing is seen, as Drake's `RgbdSensor` has it.
    - noise: random input, eight standard normal numbers (`AddRandomInputs` connects it): the seed of an image's noise.
    - depth_image: `ImageDepth32F`, m; 0 where nothing is seen.
    """

    def __init__(self, model: DepthCameraModel) -> None:
        """Declares the ports; `model` describes the camera that takes `exact_depth`."""
        super().__init__()
        model.validate()
        self._model = model
        self._exact = self.DeclareAbstractInputPort("exact_depth", AbstractValue.Make(ImageDepth32F()))
        self._noise = self.DeclareVectorInputPort("noise", 8, RandomDistribution.kGaussian)
        needs = {self._exact.ticket(), self._noise.ticket()}
        self.declare_output("depth_image", ImageDepth32F(), self._noisy, needs)

    def _noisy(self, context: Context) -> ImageDepth32F:
        exact = depth_of(eval_input(self._exact, context, ImageDepth32F))
        generator = np.random.default_rng(np.abs(self._noise.Eval(context)).view(np.uint64))
        return image_of(noisy_depth(exact, self._model, generator))


def AddDepthCamera(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    X_WC: RigidTransform,
    model: DepthCameraModel,
    name: str = "depth_camera",
) -> OutputPort:
    """Adds a depth camera to a scene: Drake's `RgbdSensor`, rendered by VTK off screen, and its noise.

    It sees geometry with Drake's perception role: the visual shapes of parsed models. `AddRandomInputs` connects its
    random input.

    Args:
        builder: receives both systems.
        scene_graph: the scene.
        X_WC: pose of the camera in the world; z forward, y down.
        model: size, range and noise.
        name: name of the sensor.

    Returns:
        The port of the images, `ImageDepth32F`, m; 0 where nothing is seen.

    Raises:
        InvalidInputError: if another system of the builder has the name, or that of the noise.
    """
    check_name_is_free(builder, name, ("noise",))
    if not scene_graph.HasRenderer(_RENDERER):
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams()))
    # Drake's renderers place a pixel's centre half a pixel beyond its index, as `rays` does.
    core = RenderCameraCore(
        _RENDERER,
        CameraInfo(model.width, model.height, model.focal_length, model.focal_length, *model.center),
        ClippingRange(*_CLIPPING),
        RigidTransform(),
    )
    sensor = builder.AddNamedSystem(
        name,
        RgbdSensor(
            scene_graph.world_frame_id(),
            X_WC,
            ColorRenderCamera(core),
            DepthRenderCamera(core, DepthRange(model.nearest, model.farthest)),
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    noise = builder.AddNamedSystem(f"{name}_noise", DepthNoise(model))
    builder.Connect(sensor.depth_image_32F_output_port(), noise.GetInputPort("exact_depth"))
    return noise.GetOutputPort("depth_image")


def depth_of(image: ImageDepth32F | ImageDepth16U) -> np.ndarray:
    """The depths of an image, shape (height, width), m; infinite where nothing is seen.

    Those of an `ImageDepth16U` are millimetres, 0 where it is too near and 65535 where it is too far.
    """
    depth = image.data[:, :, 0].astype(np.float64)
    seen = depth > 0.0
    if isinstance(image, ImageDepth16U):
        seen &= depth < _TOO_FAR
        depth *= 1e-3
    return np.where(seen, depth, np.inf)


def image_of(depth: np.ndarray) -> ImageDepth32F:
    """Drake's image of depths of shape (height, width), m; 0 where they are infinite."""
    image = ImageDepth32F(depth.shape[1], depth.shape[0])
    image.mutable_data[:, :, 0] = np.where(np.isfinite(depth), depth, 0.0)
    return image
