"""The tracker of depth images in a diagram: what hides the object, and what goes wrong on the way."""

import math
import sys
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs, ConstantValueSource

from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.camera_view import CameraView
from tactopose_drake.systems.depth_camera import DepthNoise, image_of
from tactopose_drake.systems.depth_tracker import DepthTracker, DepthTrackerParams
from tactopose_drake.systems.random_sources import seed_random_sources
from tests.core.models import brick
from tests.core.vision.seen_scenes import depth_of_scene

X_WPalm = RigidTransform(RollPitchYaw(0.2, 0.1, 0.5), [0.1, 0.1, 0.1])
X_PalmP = RigidTransform(RollPitchYaw(0.0, 0.7, 0.0), [0.0, 0.02, 0.05])
X_WO = RigidTransform(RollPitchYaw(0.5, -0.3, 1.2), [0.0, 0.05, 0.5])
# Straight above, looking down; turned, so that the camera's pose is not its own inverse.
X_WC = RigidTransform(RollPitchYaw(math.pi, 0.0, 0.3), [0.0, 0.05, 1.3])
X_WSlab = RigidTransform([0.0, 0.05, 0.7])
X_PO = ((X_WPalm @ X_PalmP).inverse() @ X_WO).GetAsMatrix34()


@pytest.fixture(scope="module")
def object_model() -> ObjectModel:
    return brick(0.06, 0.09, 0.13)


class Bench:
    """A palm with a slab in the world, images of it and of an object, and the tracker."""

    def __init__(self, object_model: ObjectModel, width: float = 0.02, seed: int = 0, **params: float) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
        inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.02)
        slab = trimesh.creation.box([0.4, width, 0.01], X_WSlab.GetAsMatrix4())
        in_camera = X_WC.inverse().multiply(np.array(slab.vertices).T).T, np.array(slab.faces, dtype=np.int32)
        depth = depth_of_scene(object_model, (X_WC.inverse() @ X_WO).GetAsMatrix34(), in_camera, DepthCameraModel())
        palm = plant.AddRigidBody("palm", plant.AddModelInstance("hand"), inertia)
        thing = plant.AddRigidBody("object", plant.AddModelInstance("object"), inertia)
        palm_frame = plant.AddFrame(FixedOffsetFrame("palm_frame", palm.body_frame(), X_PalmP))
        plant.WeldFrames(plant.world_frame(), palm.body_frame(), X_WPalm)
        # The object's own pose in the plant is wrong: the tracker must not look at it.
        plant.WeldFrames(plant.world_frame(), thing.body_frame(), RigidTransform([1.0, 2.0, 3.0]))
        X_PalmG = X_WPalm.inverse() @ X_WSlab
        plant.RegisterCollisionGeometry(palm, X_PalmG, Box(0.4, width, 0.01), "slab", CoulombFriction(1.0, 1.0))
        plant.Finalize()
        self.tracker = builder.AddNamedSystem(
            "tracker",
            DepthTracker(
                CameraView(
                    plant=plant,
                    inspector=scene_graph.model_inspector(),
                    object_body=thing,
                    object_model=object_model,
                    palm_frame=palm_frame,
                    X_WC=X_WC,
                ),
                params=DepthTrackerParams(**params),
            ),
        )
        builder.Connect(plant.get_body_poses_output_port(), self.tracker.GetInputPort("body_poses"))
        image = builder.AddSystem(ConstantValueSource(AbstractValue.Make(image_of(depth))))
        noise = builder.AddNamedSystem("camera_noise", DepthNoise(DepthCameraModel()))
        builder.Connect(image.get_output_port(), noise.GetInputPort("exact_depth"))
        builder.Connect(noise.GetOutputPort("depth_image"), self.tracker.GetInputPort("depth_image"))
        AddRandomInputs(0.1, builder)
        diagram = builder.Build()
        self.simulator = Simulator(diagram)
        seed_random_sources(diagram, self.simulator.get_mutable_context(), seed)
        self.simulator.Initialize()

    def run(self, until: float) -> "Bench":
        self.simulator.AdvanceTo(until)
        return self

    @property
    def context(self) -> Context:
        return self.tracker.GetMyContextFromRoot(self.simulator.get_context())

    @property
    def vision(self) -> PoseMeasurement | None:
        answer: PoseMeasurement | None = self.tracker.GetOutputPort("vision").Eval(self.context)
        return answer


class Tracked(NamedTuple):
    """What a tracker without faults says at 0.35 s, and its pose at 0.55 s."""

    vision: PoseMeasurement | None
    prior: PosePrior | None
    pose_in_world: RigidTransform
    later: PoseMeasurement | None


@pytest.fixture(scope="module")
def tracked(object_model: ObjectModel) -> Tracked:
    bench = Bench(object_model).run(0.35)
    prior, seen = (bench.tracker.GetOutputPort(name).Eval(bench.context) for name in ("prior", "pose_in_world"))
    return Tracked(bench.vision, prior, seen, bench.run(0.55).vision)


def test_the_pose_is_the_objects_in_the_palm(object_model: ObjectModel, tracked: Tracked) -> None:
    vision = tracked.vision
    assert vision is not None
    assert vision.time == pytest.approx(0.3)
    errors = increments_between(compose(vision.X_PO[None], object_model.symmetry_poses), X_PO)
    error = errors[np.argmin(np.linalg.norm(errors[:, :3], axis=1))]
    assert np.linalg.norm(error[3:]) < 0.006
    assert np.linalg.norm(error[:3]) < 0.06
    assert error @ np.linalg.solve(vision.covariance, error) < 30.0
    assert isinstance(tracked.prior, PosePrior)
    np.testing.assert_array_equal(tracked.prior.X_PO.GetAsMatrix34(), vision.X_PO)
    assert tracked.pose_in_world.IsNearlyEqualTo(X_WPalm @ X_PalmP @ RigidTransform(vision.X_PO), 1e-9)


def test_answers_from_before_the_clock_was_set_back_are_not_given_after_it(object_model: ObjectModel) -> None:
    bench = Bench(object_model, latency=0.25).run(0.45)
    assert bench.vision is not None
    bench.simulator.get_mutable_context().SetTime(0.0)
    bench.simulator.Initialize()
    assert bench.vision is None
    bench.run(0.24)
    assert bench.vision is None
    times = []
    for until in (0.3, 0.4, 0.5, 0.6):
        vision = bench.run(until).vision
        assert vision is not None
        times.append(vision.time)
    np.testing.assert_allclose(times, [0.0, 0.1, 0.2, 0.3], atol=1e-9)


def test_what_is_unsure_is_so_along_the_same_ways_however_the_palm_is_turned(
    object_model: ObjectModel, tracked: Tracked, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = RigidTransform(RollPitchYaw(1.1, -0.4, 2.0), X_PalmP.translation())
    seen = {X_PalmP: tracked.vision}
    monkeypatch.setattr(sys.modules[__name__], "X_PalmP", other)
    seen[other] = Bench(object_model).run(0.35).vision
    in_world = []
    for X, vision in seen.items():
        assert vision is not None
        turn = scipy.linalg.block_diag(np.eye(3), (X_WPalm @ X).rotation().matrix())
        in_world.append(turn @ vision.covariance @ turn.T)
    widths = np.sqrt(np.diag(in_world[0]))
    np.testing.assert_allclose((in_world[1] - in_world[0]) / np.outer(widths, widths), 0.0, atol=0.05)
    assert widths[3:].max() > 1.2 * widths[3:].min()


def test_a_hidden_object_has_no_pose(object_model: ObjectModel) -> None:
    bench = Bench(object_model, width=0.5).run(0.05)
    assert bench.vision is None
    assert bench.tracker.GetOutputPort("prior").Eval(bench.context) is None
    assert bench.tracker.GetOutputPort("hidden_share").Eval(bench.context)[0] > 0.9


def test_it_is_late_by_the_latency_but_stamped_with_its_pictures_time(object_model: ObjectModel) -> None:
    bench = Bench(object_model, latency=0.25)
    assert bench.run(0.249).vision is None
    for until, stamp in ((0.251, 0.0), (0.34, 0.0), (0.36, 0.1), (0.56, 0.3)):
        vision = bench.run(until).vision
        assert vision is not None
        assert vision.time == pytest.approx(stamp)


def test_no_answer_is_late_by_another_picture_where_the_plant_steps_at_its_time(object_model: ObjectModel) -> None:
    """Drake skips an event at 0.3 s + 0.03 s if the plant steps at 0.33 s, which differs by rounding."""
    vision = Bench(object_model, latency=0.03).run(0.35).vision
    assert vision is not None
    assert vision.time == pytest.approx(0.3)


def test_a_latency_of_whole_periods_keeps_what_was_tracked(object_model: ObjectModel, tracked: Tracked) -> None:
    prompt, late = tracked.vision, Bench(object_model, latency=0.2).run(0.55).vision
    assert prompt is not None
    assert late is not None
    assert late.time == pytest.approx(prompt.time)
    np.testing.assert_array_equal(late.X_PO, prompt.X_PO)


def test_a_frozen_picture_gives_the_last_pose(object_model: ObjectModel, tracked: Tracked) -> None:
    bench = Bench(object_model, frozen_from=0.15)
    last = bench.run(0.12).vision
    frozen = bench.run(0.55).vision
    assert last is not None
    assert frozen is not None
    np.testing.assert_allclose(frozen.X_PO, last.X_PO)
    assert frozen.time == pytest.approx(0.5)
    assert tracked.later is not None
    assert not np.allclose(tracked.later.X_PO, last.X_PO)


def test_some_answers_are_wrong_and_some_missing(object_model: ObjectModel) -> None:
    wrong = Bench(object_model, wrong_share=1.0).run(0.05).vision
    assert wrong is not None
    assert np.linalg.norm(wrong.X_PO[:, 3] - X_PO[:, 3]) > 0.05
    assert Bench(object_model, missing_share=1.0).run(0.35).vision is None


def test_the_same_seed_sees_the_same(object_model: ObjectModel) -> None:
    seen = [Bench(object_model, seed=seed).run(0.05).vision for seed in (3, 3, 4)]
    poses = [vision.X_PO for vision in seen if vision is not None]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert not np.allclose(poses[0], poses[2])


def test_a_bad_parameter_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"DepthTrackerParams\.wrong_share must be .*, not 2"):
        DepthTrackerParams(wrong_share=2.0).validate()
