import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia
from pydrake.systems.framework import Context, DiagramBuilder

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.geometry import BodySpheres, HandGeometry, corner_spheres

SHAPES = [
    Sphere(0.01),
    Capsule(0.008, 0.03),
    Box(0.02, 0.04, 0.03),
    Cylinder(0.01, 0.05),
    Cylinder(0.03, 0.01),
    Ellipsoid(0.01, 0.02, 0.03),
    Convex(np.array([[0.0, 0.02, 0.0, 0.0], [0.0, 0.0, 0.02, 0.0], [0.0, 0.0, 0.0, 0.02]]), "tetrahedron"),
]
X_PalmG = RigidTransform(RollPitchYaw(0.4, -0.2, 0.9), [0.01, 0.02, -0.03])


def make_hand(shape: Shape, angle: float = 0.0) -> tuple[MultibodyPlant, Context]:
    """A palm in the world with one finger on a hinge, and a shape on the finger; a stone that is not the hand's."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.02)
    hand = plant.AddModelInstance("hand")
    palm, finger = plant.AddRigidBody("palm", hand, inertia), plant.AddRigidBody("finger", hand, inertia)
    stone = plant.AddRigidBody("stone", plant.AddModelInstance("stone"), inertia)
    plant.WeldFrames(plant.world_frame(), palm.body_frame(), RigidTransform(RollPitchYaw(1, 2, 3), [0.5, 0.4, 0.3]))
    plant.WeldFrames(plant.world_frame(), stone.body_frame())
    hinge = plant.AddJoint(RevoluteJoint("hinge", palm.body_frame(), finger.body_frame(), [0, 0, 1]))
    friction = CoulombFriction(1.0, 1.0)
    plant.RegisterCollisionGeometry(finger, X_PalmG, shape, "shape", friction)
    plant.RegisterCollisionGeometry(stone, RigidTransform(), Sphere(1.0), "stone", friction)
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyMutableContextFromRoot(diagram.CreateDefaultContext())
    hinge.set_angle(context, angle)
    return plant, context


def signed_distances(plant: MultibodyPlant, context: Context, p_WQ: np.ndarray) -> float:
    """Drake's own distance from a point to the finger's shape."""
    query = plant.get_geometry_query_input_port().Eval(context)
    shape = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("finger"))[0]
    return next(d.distance for d in query.ComputeSignedDistanceToPoint(p_WQ) if d.id_G == shape)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_every_sphere_lies_within_the_shape_where_the_joints_put_it(shape: Shape) -> None:
    plant, context = make_hand(shape, angle=0.7)
    palm = plant.GetFrameByName("palm")
    geometry = HandGeometry.from_plant(plant, context, palm)
    p_WH = palm.CalcPoseInWorld(context).multiply(geometry.p_PH.T).T
    assert len(geometry) >= 1
    for centre, radius in zip(p_WH, geometry.radius, strict=True):
        assert signed_distances(plant, context, centre) <= -radius + 1e-6


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_the_largest_sphere_is_as_large_as_the_shape_allows(shape: Shape) -> None:
    plant, context = make_hand(shape)
    geometry = HandGeometry.from_plant(plant, context, plant.GetFrameByName("palm"))
    if isinstance(shape, Cylinder):
        deepest = min(shape.radius(), shape.length() / 2)
    else:
        deepest = {"Sphere": 0.01, "Capsule": 0.008, "Box": 0.01, "Ellipsoid": 0.01, "Convex": 0.00423}[
            type(shape).__name__
        ]
    # Centres lie on a grid, which a tetrahedron's corners fit worst.
    assert (0.75 if isinstance(shape, Convex) else 0.97) * deepest <= geometry.radius.max() <= deepest * 1.001


def test_the_spheres_turn_with_the_joint() -> None:
    plant, context = make_hand(Sphere(0.01))
    palm = plant.GetFrameByName("palm")
    before = HandGeometry.from_plant(plant, context, palm).p_PH
    plant.SetPositions(context, [np.pi / 2])
    after = HandGeometry.from_plant(plant, context, palm).p_PH
    np.testing.assert_allclose(after, np.column_stack([-before[:, 1], before[:, 0], before[:, 2]]), atol=1e-12)


@pytest.mark.parametrize(("shape", "count"), [(SHAPES[2], 20), (SHAPES[6], 4), (SHAPES[0], 0)])
def test_corners_and_middles_of_edges_have_small_spheres(shape: Shape, count: int) -> None:
    plant, context = make_hand(shape, angle=0.7)
    inspector = plant.get_geometry_query_input_port().Eval(context).inspector()
    finger = plant.GetBodyByName("finger")
    spheres = corner_spheres(plant, inspector, [int(finger.index())])
    assert len(spheres.radius) == count
    X_WB = plant.get_body_poses_output_port().Eval(context)
    p_WH = spheres.positions(X_WB)
    X_WG = X_WB[int(finger.index())] @ X_PalmG
    if isinstance(shape, Box):
        sides = np.stack(np.meshgrid(*3 * [[-1.0, 0.0, 1.0]], indexing="ij"), axis=-1).reshape(-1, 3)
        edges = X_WG.multiply((0.5 * shape.size() * sides[np.abs(sides).sum(axis=1) >= 2]).T).T
        for centre in p_WH:  # they touch the faces from within
            assert signed_distances(plant, context, centre) == pytest.approx(-0.0005, abs=1e-9)
    else:
        edges = X_WG.multiply(0.02 * np.vstack([np.zeros(3), np.eye(3)])[:count].T).T
    away = np.linalg.norm(edges[:, None] - p_WH, axis=2).min(axis=1, initial=np.inf) if count else np.zeros(0)
    assert np.all(away < 0.001)


def test_of_many_spheres_those_go_that_hardly_stick_out_of_larger_ones_of_their_body() -> None:
    generator = np.random.default_rng(1)
    body = np.repeat([2, 5], 150)
    spheres = BodySpheres(body, 0.01 * generator.normal(size=(300, 3)), generator.uniform(0.003, 0.009, size=300))
    assert len(spheres.thinned(300).radius) == 300
    few = spheres.thinned(200)
    assert 20 < len(few.radius) <= 200
    assert set(few.body) == {2, 5}
    way = np.linalg.norm(spheres.p_BH[:, None] - few.p_BH, axis=2)
    out = np.where(body[:, None] == few.body, way + spheres.radius[:, None] - few.radius, np.inf)
    assert out.min(axis=1).max() <= 0.006  # what is left out does so from one that stays
    # Of those that stay none does so from a larger one.
    way = np.linalg.norm(few.p_BH[:, None] - few.p_BH, axis=2)
    out = way + few.radius[:, None] - few.radius
    of_larger = (few.body[:, None] == few.body) & (few.radius > few.radius[:, None])
    assert out[of_larger].min() > 0.0015


def test_a_hand_without_a_volume_is_refused() -> None:
    plant, context = make_hand(HalfSpace())
    with pytest.raises(InvalidInputError, match="palm_frame must be of a hand with collision geometry, not 'palm'"):
        HandGeometry.from_plant(plant, context, plant.GetFrameByName("palm"))


def test_a_context_without_a_scene_graph_is_refused() -> None:
    plant, _ = make_hand(Sphere(0.01))
    with pytest.raises(
        InvalidInputError, match="context must be the plant's context in a diagram, and connect it to a SceneGraph"
    ):
        HandGeometry.from_plant(plant, plant.CreateDefaultContext(), plant.GetFrameByName("palm"))


def test_a_plant_that_is_not_finalized_is_refused() -> None:
    _, context = make_hand(Sphere(0.01))
    plant = MultibodyPlant(1e-3)
    with pytest.raises(InvalidInputError, match=r"^plant must be finalized"):
        HandGeometry.from_plant(plant, context, plant.world_frame())


def test_a_hand_that_is_no_plant_is_named() -> None:
    plant, context = make_hand(Sphere(0.01))
    palm = plant.GetFrameByName("palm")
    for arguments, name in (
        ((None, context, palm), "plant"),
        ((plant, 3, palm), "context"),
        ((plant, context, "palm"), "palm_frame"),
    ):
        with pytest.raises(InvalidInputError, match=f"^{name} must be .*, not (None|an? )"):
            HandGeometry.from_plant(*arguments)


def test_what_is_of_another_plant_or_system_is_named() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    plant.Finalize()
    root = builder.Build().CreateDefaultContext()
    other, of_other = make_hand(Sphere(0.01))
    palm = other.GetFrameByName("palm")
    with pytest.raises(InvalidInputError, match=r"^palm_frame must be of this plant, but 'palm' is of another"):
        HandGeometry.from_plant(plant, plant.GetMyContextFromRoot(root), palm)
    for context in (root, plant.GetMyContextFromRoot(root)):
        with pytest.raises(InvalidInputError, match=r"^context must be the plant's, .* not another system's"):
            HandGeometry.from_plant(other, context, palm)
    assert len(HandGeometry.from_plant(other, of_other, palm)) > 0


@pytest.mark.parametrize(
    ("p_PH", "radius", "message"),
    [
        ([[0, 0, np.nan]], [1], r"p_PH\[0, 2\] must be .*, not nan"),
        (np.zeros((0, 3)), [], "p_PH must have 1 or more spheres, not 0"),
        ([[0, 0, 0]], [0], r"radius\[0\] must be .*, not 0"),
        ([[0, 0, 0]], [1, 2], "radius must have the shape .*"),
    ],
)
def test_bad_spheres_are_refused(p_PH: list[list[float]], radius: list[float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        HandGeometry(p_PH, radius)
