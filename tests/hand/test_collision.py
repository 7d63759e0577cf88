import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.collision import Collisions, HandCollision, check_collisions, keep_clear
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.resources import model_path
from tests.brute_force_collision import brute_force
from tests.hands import write_hand

TOLERANCE = 2e-5  # m, by which depths may be short
CAPSULE = "<capsule><radius>0.009</radius><length>0.03</length></capsule>"
TETRAHEDRON = (
    "v 0 0 0.02\nv 0.02 0 -0.01\nv -0.01 0.02 -0.01\nv -0.01 -0.02 -0.01\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
)
LEANING_BOX = "<mesh><uri>leaning_box.obj</uri></mesh>"


def coarse_model(mesh: trimesh.Trimesh) -> ObjectModel:
    """With a grid of few nodes; the check is as exact as ever."""
    return ObjectModel.from_mesh(mesh, spacing=0.003, samples=100, symmetry="none", cache=False)


def box_model(*extents: float) -> ObjectModel:
    return coarse_model(trimesh.creation.box(extents))


def at(*p: float, R: RotationMatrix | None = None) -> np.ndarray:
    return RigidTransform(R or RotationMatrix(), p).GetAsMatrix34()[None]


@pytest.fixture(scope="module")
def wall() -> ObjectModel:
    """Its top is z = 0 when its pose is the identity but for 20 mm down."""
    return box_model(0.12, 0.12, 0.04)


@pytest.fixture(scope="module")
def plate() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.12, 0.12, 0.001)), cache=False)


@pytest.fixture(scope="module")
def capsule(tmp_path_factory: pytest.TempPathFactory) -> HandConfig:
    return write_hand(tmp_path_factory.mktemp("capsule"), CAPSULE)


@pytest.fixture(scope="module")
def shadow() -> HandConfig:
    return load_hand_config("shadow_like")


@pytest.fixture(scope="module")
def mug() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "mug.obj"))


@pytest.mark.parametrize(
    ("geometry", "reach", "pose"),
    [
        ("<sphere><radius>0.01</radius></sphere>", 0.01, "0 0 0 0 0 0"),
        (CAPSULE, 0.024, "0 0 0 0 0 0"),
        (CAPSULE, 0.009, "0 0 0 1.5707963 0 0"),
        (CAPSULE, 0.009 + 0.015 * np.cos(0.7), "0 0 0 0 0.7 0.3"),
        ("<box><size>0.03 0.02 0.04</size></box>", 0.02, "0 0 0 0 0 0.4"),
        ("<cylinder><radius>0.01</radius><length>0.03</length></cylinder>", 0.015, "0 0 0 0 0 0"),
        ("<cylinder><radius>0.01</radius><length>0.03</length></cylinder>", 0.01, "0 0 0 1.5707963 0 0"),
        ("<ellipsoid><radii>0.008 0.01 0.02</radii></ellipsoid>", 0.02, "0 0 0 0 0 0"),
        ("<ellipsoid><radii>0.008 0.01 0.02</radii></ellipsoid>", 0.01, "0 0 0 1.5707963 0 0"),
        ("<mesh><uri>tetrahedron.obj</uri></mesh>", 0.01, "0 0 0 0 0 0"),
    ],
)
def test_every_shape_is_as_deep_in_a_wall_as_it_is_pushed_into_it(
    tmp_path: Path, wall: ObjectModel, geometry: str, reach: float, pose: str
) -> None:
    (tmp_path / "tetrahedron.obj").write_text(TETRAHEDRON)
    collision = HandCollision(write_hand(tmp_path, geometry, pose), wall)
    for depth in (-3e-4, 3e-4, 0.002):
        found = collision.check([0.0], at(0.003, -0.004, depth - reach - 0.02))
        assert found.depth[0] == pytest.approx(max(depth, 0.0), abs=TOLERANCE)
        assert found.link == ("finger" if depth > 0 else None,)


@pytest.mark.parametrize("offset", [0.0, 0.0007, 0.004, 0.0088])
@pytest.mark.parametrize("turn", [RotationMatrix(), RotationMatrix.MakeXRotation(np.pi / 2)])
def test_a_thin_plate_is_as_deep_as_it_comes_to_the_middle_of_the_finger(
    capsule: HandConfig, plate: ObjectModel, offset: float, turn: RotationMatrix
) -> None:
    """Though no point of the finger is more than half a millimetre below the plate's surface."""
    crosses = turn.IsExactlyIdentity()
    p = (0.0, 0.0, 0.015 + offset) if crosses else (0.0, offset, 0.0)
    expected = 0.009 - max(0.0, offset - 0.0005)
    assert check_collisions(capsule, plate, [0.0], at(*p, R=turn)).depth[0] == pytest.approx(expected, abs=TOLERANCE)


def test_a_plate_that_ends_within_the_finger_is_found_by_its_rim(capsule: HandConfig, plate: ObjectModel) -> None:
    # In a plane through the capsule's axis, its rim 4 mm above the lower hemisphere's centre, or 3 mm below it.
    upright = RotationMatrix.MakeXRotation(np.pi / 2)
    for height, expected in ((-0.011, 0.009), (-0.018, 0.006)):
        found = check_collisions(capsule, plate, [0.0], at(0, 0, height - 0.06, R=upright))
        assert found.depth[0] == pytest.approx(expected, abs=TOLERANCE)


def test_a_finger_wholly_within_the_object_is_as_deep_as_it_is_thick(capsule: HandConfig) -> None:
    for p in ((0, 0, 0), (0.02, 0.01, 0.005)):
        found = check_collisions(capsule, box_model(0.1, 0.1, 0.1), [0.0], at(*p))
        assert found.depth[0] == pytest.approx(0.009)
        assert found.link == ("finger",)


@pytest.mark.parametrize(
    ("geometry", "thickness"),
    [
        (CAPSULE, 0.009),
        ("<ellipsoid><radii>0.01 0.008 0.02</radii></ellipsoid>", 0.008),
        ("<mesh><uri>tetrahedron.obj</uri></mesh>", 0.007545),
    ],
)
def test_a_shape_is_as_deep_as_it_is_thick_in_a_solid_and_where_a_wall_thinner_than_the_grid_runs_through_its_middle(
    tmp_path: Path, geometry: str, thickness: float
) -> None:
    (tmp_path / "tetrahedron.obj").write_text(TETRAHEDRON)
    hand = write_hand(tmp_path, geometry)
    solid = check_collisions(hand, box_model(0.1, 0.1, 0.1), [0.0], at(0.001, 0.002, 0.003))
    assert (solid.depth[0], solid.link) == (pytest.approx(thickness, abs=1e-5), ("finger",))
    if "mesh" not in geometry:
        upright = at(0.001, 0.0004, 0.003, R=RotationMatrix.MakeXRotation(np.pi / 2))
        wall = check_collisions(hand, box_model(0.1, 0.1, 0.001), [0.0], upright)
        assert wall.depth[0] == pytest.approx(thickness, abs=1e-5)


def test_a_pencil_through_the_length_of_a_finger_is_found(capsule: HandConfig) -> None:
    pencil = coarse_model(trimesh.creation.cylinder(0.004, 0.12, sections=32))
    for offset, expected in ((0.0, 0.009), (0.003, 0.009), (0.006, 0.007), (0.0128, 0.0002), (0.0132, 0.0)):
        found = check_collisions(capsule, pencil, [0.0], at(offset, 0, 0))
        # The pencil's own 32 sides lie up to 0.02 mm below the cylinder.
        assert found.depth[0] == pytest.approx(expected, abs=TOLERANCE + 2e-5)


def test_a_hole_is_no_collision(capsule: HandConfig, mug: ObjectModel) -> None:
    """The convex hull of a mug has neither an inside nor a handle to reach through."""
    up = (mug.vertices[:, 2].min() + mug.vertices[:, 2].max()) / 2
    inside = -mug.vertices.mean(axis=0) * [1, 1, 0] - [0, 0, up + 0.02]
    hull = trimesh.Trimesh(mug.vertices, mug.faces).convex_hull
    filled = coarse_model(hull)
    assert check_collisions(capsule, mug, [0.0], at(*inside)).depth[0] == 0.0
    assert check_collisions(capsule, filled, [0.0], at(*inside)).depth[0] == pytest.approx(0.009)


def test_the_joints_move_the_hand(capsule: HandConfig, wall: ObjectModel) -> None:
    collision = HandCollision(capsule, wall)
    X_PO = at(0, 0, -0.044)
    depths = [collision.check([q], X_PO).depth[0] for q in (0.0, -0.0015, 0.01)]
    np.testing.assert_allclose(depths, [0.0, 0.0015, 0.0], atol=TOLERANCE)


@pytest.fixture(scope="module")
def of_the_mug(shadow: HandConfig, mug: ObjectModel) -> HandCollision:
    return HandCollision(shadow, mug)


@pytest.fixture(scope="module")
def random_poses() -> np.ndarray:
    """Of the mug in the Shadow-like hand."""
    generator = np.random.default_rng(0)
    p = np.array([0.0, -0.05, 0.1]) + generator.uniform(-0.07, 0.07, (16, 3))
    return np.concatenate([random_rotations(generator, 16), p[:, :, None]], axis=2)


Q = np.full(24, 0.4)


@pytest.mark.parametrize("geometry", [CAPSULE, "<box><size>0.03 0.02 0.04</size></box>", LEANING_BOX])
def test_a_shape_anywhere_about_a_mug_agrees_with_brute_force(tmp_path: Path, mug: ObjectModel, geometry: str) -> None:
    leaning = trimesh.creation.box((0.03, 0.02, 0.04))
    leaning.vertices[:, 0] += 0.3 * leaning.vertices[:, 2]
    leaning.export(tmp_path / "leaning_box.obj")
    hand = write_hand(tmp_path, geometry)
    generator = np.random.default_rng(1)
    near = mug.samples.points[generator.integers(0, 3000, 30)] + generator.uniform(-0.03, 0.03, (30, 3))
    R_PO = random_rotations(generator, 30)
    X_PO = np.concatenate([R_PO, -(R_PO @ near[:, :, None])], axis=2)
    found = HandCollision(hand, mug).check([0.0], X_PO)
    sampled, _ = brute_force(hand, mug, np.zeros(1), X_PO)
    assert np.any(sampled == 0.0)
    assert_agree(found.depth, sampled)


def test_a_mug_in_a_whole_hand_agrees_with_brute_force(
    shadow: HandConfig, mug: ObjectModel, of_the_mug: HandCollision, random_poses: np.ndarray
) -> None:
    found = of_the_mug.check(Q, random_poses[:5])
    sampled, sampled_by_link = brute_force(shadow, mug, Q, random_poses[:5])
    assert_agree(found.depth, sampled)
    for depth, link, by_link in zip(sampled, found.link, sampled_by_link, strict=True):
        assert link is None if depth == 0.0 else by_link[link] >= depth - 2e-3


def assert_agree(found: np.ndarray, sampled: np.ndarray) -> None:
    """Samples leave gaps of up to 2 mm and so miss some of a depth, but seldom much."""
    assert np.all(found >= sampled - TOLERANCE)
    assert np.all(found <= sampled + 2e-3)
    assert np.median(found - sampled) < 1e-4


def test_what_is_deep_enough_is_only_bounded(of_the_mug: HandCollision, random_poses: np.ndarray) -> None:
    exact = of_the_mug.check(Q, random_poses)
    bounded = of_the_mug.check(Q, random_poses, enough=0.002)
    np.testing.assert_array_equal(bounded.depth > 0.002, exact.depth > 0.002)
    shallow = exact.depth <= 0.002
    np.testing.assert_allclose(bounded.depth[shallow], exact.depth[shallow], atol=1e-9)
    assert np.all(bounded.depth <= exact.depth + TOLERANCE)
    assert np.any(bounded.depth < exact.depth - 0.001)


def test_each_pose_is_judged_for_itself(of_the_mug: HandCollision, random_poses: np.ndarray) -> None:
    together = of_the_mug.check(Q, random_poses[:6])
    scratch = of_the_mug.make_scratch()
    of_the_mug.check(np.zeros(24), random_poses[6:8], scratch=scratch)
    for i in range(6):
        alone = of_the_mug.check(Q, random_poses[i : i + 1], scratch=scratch)
        assert (alone.depth[0], alone.link[0]) == (together.depth[i], together.link[i])


def test_a_mesh_with_folded_edges_can_be_checked(capsule: HandConfig) -> None:
    """Drake's distance to such a mesh is an error."""
    edge, back = 0.04, 2e-6
    wedge = trimesh.Trimesh(
        [[-edge, 0, 0], [edge, 0, 0], [edge, 0.06, 0], [-edge, 0.06, 0], [-edge, 0.06, back], [edge, 0.06, back]],
        [[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4], [0, 4, 3], [1, 2, 5], [3, 4, 5], [3, 5, 2]],
    )
    model = coarse_model(wedge)
    found = check_collisions(capsule, model, [0.0], at(0, -0.03, 0.02))
    assert found.depth[0] == pytest.approx(0.004, abs=TOLERANCE)


@pytest.mark.parametrize(
    ("q", "X_PO", "message"),
    [
        ([np.nan], np.eye(3, 4)[None], r"q\[0\] must be .*, not nan"),
        ([0.0, 0.0], np.eye(3, 4)[None], r"q must have the shape \(1,\), not \(2,\)"),
        ([0.0], np.eye(3, 4), r"X_PO must have the shape .*, not \(3, 4\)"),
        ([0.0], np.full((1, 3, 4), np.inf), r"X_PO\[0, 0, 0\] must be .*, not inf"),
    ],
)
def test_bad_input_is_named(
    capsule: HandConfig, plate: ObjectModel, q: list[float], X_PO: np.ndarray, message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        HandCollision(capsule, plate).check(q, X_PO)


@pytest.mark.parametrize("geometry", ["", "<plane><normal>0 0 1</normal></plane>"])
def test_a_hand_without_a_volume_is_refused(tmp_path: Path, plate: ObjectModel, geometry: str) -> None:
    with pytest.raises(InvalidInputError, match=r"hand must have collision geometry, but .*tiny\.sdf has none"):
        HandCollision(write_hand(tmp_path, geometry), plate)


def estimate_of(*explains: bool) -> PoseEstimate:
    share = 1.0 / len(explains)
    return PoseEstimate(
        tuple(PoseHypothesis(RigidTransform(), 0.0, share, np.eye(6), np.zeros((0, 6)), e) for e in explains), "ok", 0.0
    )


@pytest.mark.parametrize(
    ("depths", "explains", "left", "status", "is_clear"),
    [
        ((0.001, 0.0), (True, True), 2, "ok", True),
        ((0.003, 0.002), (True, True), 1, "ok", True),
        ((0.0, 0.003), (True, True), 1, "ok", True),
        ((0.003, 0.004), (True, True), 2, "ambiguous", False),
        # What is left must explain the touch, too.
        ((0.003, 0.0), (True, False), 2, "ambiguous", False),
    ],
)
def test_an_estimate_keeps_clear_of_the_hand_where_it_can(
    depths: tuple[float, ...], explains: tuple[bool, ...], left: int, status: str, is_clear: bool
) -> None:
    collisions = Collisions(np.array(depths), (None,) * len(depths))
    kept, told = keep_clear(estimate_of(*explains), collisions, 0.002)
    assert (len(kept.hypotheses), kept.status, told) == (left, status, is_clear)
    assert sum(h.probability for h in kept.hypotheses) == pytest.approx(1.0)


@pytest.mark.parametrize("depth", [0.0, 0.005])
def test_an_estimate_that_explains_nothing_stays_as_it_is(depth: float) -> None:
    nothing = dataclasses.replace(estimate_of(False), status="no_solution")
    kept, is_clear = keep_clear(nothing, Collisions(np.array([depth]), (None,)), 0.002)
    assert kept is nothing
    assert is_clear == (depth == 0.0)
