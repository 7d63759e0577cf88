import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia
from pydrake.systems.framework import Context, DiagramBuilder

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.visualization.body_meshes import BodyMeshes, Triangles, sphere_triangles

X_BG = RigidTransform(RollPitchYaw(0.4, -0.2, 0.9), [0.01, 0.02, -0.03])
CORNERS = np.array([[0.0, 0.02, 0.0, 0.0], [0.0, 0.0, 0.02, 0.0], [0.0, 0.0, 0.0, 0.02]])


def make_hand(
    shape: Shape, *, shown: bool = True, angle: float = 0.0, ball: float | None = None
) -> tuple[MultibodyPlant, Context]:
    """A palm and a finger on a hinge; a shape on the finger, and perhaps a ball on the palm."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.02)
    palm, finger = plant.AddRigidBody("palm", inertia), plant.AddRigidBody("finger", inertia)
    plant.WeldFrames(plant.world_frame(), palm.body_frame(), RigidTransform(RollPitchYaw(1, 2, 3), [0.5, 0.4, 0.3]))
    hinge = plant.AddJoint(RevoluteJoint("hinge", palm.body_frame(), finger.body_frame(), [0, 0, 1]))
    friction = CoulombFriction(1.0, 1.0)
    plant.RegisterCollisionGeometry(finger, X_BG, shape, "shape", friction)
    if shown:
        plant.RegisterVisualGeometry(finger, X_BG, shape, "shape", np.array([0.1, 0.2, 0.3, 1.0]))
    if ball is not None:
        plant.RegisterVisualGeometry(palm, RigidTransform(), Sphere(ball), "ball", np.ones(4))
    plant.Finalize()
    context = plant.GetMyMutableContextFromRoot(builder.Build().CreateDefaultContext())
    hinge.set_angle(context, angle)
    return plant, context


def area(shape: Shape) -> float:
    if isinstance(shape, Sphere):
        return 4 * np.pi * shape.radius() ** 2
    if isinstance(shape, Capsule):
        return 4 * np.pi * shape.radius() ** 2 + 2 * np.pi * shape.radius() * shape.length()
    if isinstance(shape, Cylinder):
        return 2 * np.pi * shape.radius() * (shape.radius() + shape.length())
    if isinstance(shape, Box):
        a, b, c = shape.size()
        return 2 * (a * b + b * c + c * a)
    if isinstance(shape, Convex):
        return (1.5 + np.sqrt(3) / 2) * 0.02**2
    p = 1.6075  # Thomsen's formula, within 1 %
    ab, ac, bc = ((x * y) ** p for x, y in ((shape.a(), shape.b()), (shape.a(), shape.c()), (shape.b(), shape.c())))
    return 4 * np.pi * ((ab + ac + bc) / 3) ** (1 / p)


def surface_area(triangles: Triangles) -> float:
    corners = triangles.vertices[triangles.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(cross, axis=1).sum() / 2)


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(0.01),
        Capsule(0.008, 0.03),
        Box(0.02, 0.04, 0.03),
        Cylinder(0.01, 0.05),
        Ellipsoid(0.01, 0.02, 0.03),
        Convex(CORNERS, "tetrahedron"),
    ],
    ids=lambda shape: type(shape).__name__,
)
def test_the_mesh_is_the_shapes_surface_where_the_joints_put_it(shape: Shape) -> None:
    plant, context = make_hand(shape, angle=0.7)
    palm = plant.GetFrameByName("palm")
    triangles = BodyMeshes.in_palm(plant, context, palm)
    p_WV = palm.CalcPoseInWorld(context).multiply(triangles.vertices.T).T
    query = plant.get_geometry_query_input_port().Eval(context)
    for vertex in p_WV[:: max(1, len(p_WV) // 30)]:
        (distance,) = (d.distance for d in query.ComputeSignedDistanceToPoint(vertex))
        assert abs(distance) < 2e-4
    assert surface_area(triangles) == pytest.approx(area(shape), rel=0.02)
    np.testing.assert_allclose(triangles.colour, np.tile([0.1, 0.2, 0.3], (len(p_WV), 1)), atol=1e-6)


def test_what_is_not_shown_is_drawn_as_it_collides() -> None:
    plant, context = make_hand(Sphere(0.01), shown=False)
    triangles = BodyMeshes.in_palm(plant, context, plant.GetFrameByName("palm"))
    np.testing.assert_allclose(np.ptp(triangles.vertices, axis=0), 0.02, rtol=0.02)


def test_two_meshes_are_both_there() -> None:
    plant, context = make_hand(Box(0.02, 0.04, 0.03), ball=0.01)
    triangles = BodyMeshes.in_palm(plant, context, plant.GetFrameByName("palm"))
    assert surface_area(triangles) == pytest.approx(area(Box(0.02, 0.04, 0.03)) + area(Sphere(0.01)), rel=0.02)


def test_a_shape_without_end_is_left_out() -> None:
    plant, context = make_hand(HalfSpace())
    triangles = BodyMeshes.in_palm(plant, context, plant.GetFrameByName("palm"))
    assert triangles.vertices.shape == triangles.faces.shape == triangles.colour.shape == (0, 3)


def test_a_context_without_a_scene_graph_is_refused() -> None:
    plant, _ = make_hand(Sphere(0.01))
    with pytest.raises(InvalidInputError, match="context must be of a plant that is connected to a SceneGraph"):
        BodyMeshes.in_palm(plant, plant.CreateDefaultContext(), plant.GetFrameByName("palm"))


def test_spheres_are_where_they_are_said_to_be() -> None:
    centers, radii = np.array([[0.0, 0.0, 0.1], [0.05, 0.0, 0.0]]), np.array([0.01, 0.02])
    surface = sphere_triangles(centers, radii)
    first, second = np.split(surface.vertices, 2)
    np.testing.assert_allclose(np.linalg.norm(first - centers[0], axis=1), radii[0])
    np.testing.assert_allclose(np.linalg.norm(second - centers[1], axis=1), radii[1])
    assert np.all(surface.faces[: len(surface.faces) // 2] < len(first))
    assert surface.faces[len(surface.faces) // 2 :].min() == len(first)
    assert surface.colour.shape == surface.vertices.shape
