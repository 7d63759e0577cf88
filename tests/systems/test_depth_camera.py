"""Drake's depth camera, rendered off screen, and its noise."""

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs
from pydrake.systems.sensors import ImageDepth16U

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.depth_camera import AddDepthCamera, DepthNoise, depth_of, image_of
from tactopose_drake.systems.random_sources import seed_random_sources
from tests.core.vision.seen_scenes import NO_HAND, depth_of_scene

SIZE = [0.06, 0.09, 0.13]
X_WC = RigidTransform(RollPitchYaw(2.6, 0.3, 0.4), [0.1, 0.2, 0.6])
X_WO = X_WC @ RigidTransform(RollPitchYaw(0.4, 0.7, 0.2), [0.02, -0.01, 0.5])


def see(depth_noise: float, seed: int = 0, **center: float) -> np.ndarray:
    """A box in the world, seen once."""
    camera = DepthCameraModel(width=120, height=90, focal_length=110.0, depth_noise=depth_noise, **center)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    body = plant.AddRigidBody("box", SpatialInertia.SolidSphereWithMass(0.1, 0.02))
    plant.RegisterVisualGeometry(body, RigidTransform(), Box(SIZE), "visual", np.array([0.5, 0.5, 0.5, 1.0]))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WO)
    plant.Finalize()
    builder.ExportOutput(AddDepthCamera(builder, scene_graph, X_WC, camera), "depth")
    AddRandomInputs(0.1, builder)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    seed_random_sources(diagram, context, seed)
    return depth_of(diagram.GetOutputPort("depth").Eval(context))


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return see(0.0)


def test_its_pixels_are_where_the_tracker_has_them(exact: np.ndarray) -> None:
    model = ObjectModel.from_mesh(trimesh.creation.box(SIZE), cache=False)
    camera = DepthCameraModel(width=120, height=90, focal_length=110.0)
    expected = depth_of_scene(model, (X_WC.inverse() @ X_WO).GetAsMatrix34(), NO_HAND, camera)
    seen = np.isfinite(exact)
    assert np.sum(seen != np.isfinite(expected)) < 0.03 * seen.sum()  # at most some at the rim
    both = seen & np.isfinite(expected)
    assert both.sum() > 300
    assert np.median(np.abs(exact[both] - expected[both])) < 1e-4
    assert np.mean(exact[both] - expected[both]) == pytest.approx(0.0, abs=2e-4)


def test_its_axis_meets_the_image_where_it_is_told_to(exact: np.ndarray) -> None:
    """Seven pixels farther right and four farther up than in the middle, it shows all that much farther."""
    moved = see(0.0, center_x=66.5, center_y=40.5)
    np.testing.assert_allclose(moved[:-4, 7:], exact[4:, :-7], atol=1e-4)


def test_its_noise_is_as_told_and_by_the_seed(exact: np.ndarray) -> None:
    noisy = see(1.43e-3, seed=3)
    seen = np.isfinite(exact)
    np.testing.assert_array_equal(np.isfinite(noisy), seen)
    off = (noisy[seen] - exact[seen]) / (1.43e-3 * exact[seen] ** 2)
    assert 0.6 < np.std(off) < 1.2
    np.testing.assert_array_equal(see(1.43e-3, seed=3), noisy)
    assert not np.array_equal(see(1.43e-3, seed=4), noisy)


def test_an_image_changes_with_what_is_seen_and_with_its_noise() -> None:
    system = DepthNoise(DepthCameraModel(width=50, height=40, depth_noise=0.01))
    context = system.CreateDefaultContext()
    near, far = (AbstractValue.Make(image_of(np.full((40, 50), depth))) for depth in (1.0, 2.0))
    system.GetInputPort("exact_depth").FixValue(context, near)
    images = []
    # Each time one input alone changes.
    for name, value in (("noise", np.full(8, 0.5)), ("noise", np.full(8, 0.6)), ("exact_depth", far)):
        system.GetInputPort(name).FixValue(context, value)
        images.append(depth_of(system.GetOutputPort("depth_image").Eval(context)))
    assert not np.array_equal(images[0], images[1])
    assert np.median(images[1]) == pytest.approx(1.0, abs=0.02)
    assert np.median(images[2]) == pytest.approx(2.0, abs=0.08)


def test_a_camera_that_cannot_be_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"DepthCameraModel\.depth_noise must be .*, not -1"):
        DepthNoise(DepthCameraModel(depth_noise=-1.0))


def test_an_image_of_another_size_is_refused() -> None:
    system = DepthNoise(DepthCameraModel(width=50, height=40))
    context = system.CreateDefaultContext()
    system.GetInputPort("exact_depth").FixValue(context, AbstractValue.Make(image_of(np.ones((50, 40)))))
    system.GetInputPort("noise").FixValue(context, np.zeros(8))
    with pytest.raises(InvalidInputError, match=r"depth must have the camera's shape, \(40, 50\), not \(50, 40\)"):
        system.GetOutputPort("depth_image").Eval(context)


def test_an_image_keeps_its_depths() -> None:
    depth = np.array([[0.5, np.inf, 1.25], [np.inf, 2.0, 0.75]])
    np.testing.assert_array_equal(depth_of(image_of(depth)), depth)


def test_an_image_of_16_bits_is_in_millimetres() -> None:
    """As the one that Drake's own sensor makes beside the image of floats."""
    image = ImageDepth16U(4, 1)
    image.mutable_data[0, :, 0] = [0, 1, 1250, 65535]
    np.testing.assert_allclose(depth_of(image), [[np.inf, 0.001, 1.25, np.inf]])
