import math

import numpy as np
import pytest
import trimesh
from scipy.optimize import minimize

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.objective import SumObjective
from tactopose_drake.core.objectives.patch_contact import PatchCells, PatchContact
from tactopose_drake.core.objectives.patch_mixture import PatchMixture
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, increments_between, inverse, make_poses, retract, transform_points
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tests.core.objectives.pads import ALPHA, IDENTITY, NOISE, OUT, pads_on, random_pose


def depths(patch: Patch) -> np.ndarray:
    return ALPHA * np.nan_to_num(np.maximum(patch.pressure, patch.threshold))


def misplaced(patch: Patch, u: np.ndarray) -> np.ndarray:
    """The points of a pad's cells, in P, when the pad is turned and shifted by u (6,) standard deviations."""
    middle = patch.p_PT.mean(axis=0)
    arms = patch.p_PT - depths(patch)[:, None] * patch.n_PT - middle
    return middle + arms + NOISE["sigma_rotation"] * np.cross(u[:3], arms) + NOISE["sigma_position"] * u[3:]


def cost_by_the_formula(model: ObjectModel, patch: Patch, X_PO: np.ndarray) -> float:
    sigma = np.hypot(NOISE["sigma_depth"], NOISE["share"] * depths(patch))

    def cost(u: np.ndarray) -> float:
        d = model.grid.distance(transform_points(inverse(X_PO), misplaced(patch, u)))
        d = np.where(patch.saturated, np.maximum(d, 0.0), np.where(patch.active, d, np.minimum(d, 0.0)))
        return 0.5 * float(u @ u + np.sum((d / sigma)[~patch.dead] ** 2))

    return float(minimize(cost, np.zeros(6), method="BFGS", options={"gtol": 1e-5}).fun)


def test_the_cost_is_the_formula(blob: ObjectModel) -> None:
    X_PO, patches = pads_on(blob, 1)
    poses = retract(X_PO[None], np.random.default_rng(1).normal(size=(6, 6)) * ([0.05] * 3 + [0.003] * 3))
    kinds = np.concatenate([[p.active & ~p.saturated, p.saturated, p.dead, ~p.active & ~p.dead] for p in patches], 1)
    assert np.all(kinds.sum(axis=1) > 0)
    for patch in patches:
        costs = PatchCells(blob.grid, [patch], **NOISE).cost(poses)
        expected = np.array([cost_by_the_formula(blob, patch, X) for X in poses])
        plausible = expected < 25.0
        assert plausible.sum() > 2
        np.testing.assert_allclose(costs[plausible], expected[plausible], rtol=1e-3, atol=2e-3)
        # Elsewhere the misplacement is not sought to the end.
        assert np.all(costs > 0.99 * expected)
    together = PatchCells(blob.grid, patches, **NOISE).cost(poses)
    apart = [PatchCells(blob.grid, [patch], **NOISE).cost(poses) for patch in patches]
    np.testing.assert_allclose(together, np.sum(apart, axis=0), rtol=1e-12)


def test_on_a_flat_surface_the_misplacement_is_integrated_out(slab: ObjectModel) -> None:
    pressure = np.random.default_rng(2).uniform(5e3, 2e4, 24)
    patch = describe_patch(flat_pad(), pressure, alpha=ALPHA, n_PT=-OUT)
    X_PO = make_poses(exp_so3(np.array([[0.05, -0.1, 0.3]])), np.array([[0.0, 0.0, 0.001]]))

    def phi(u: np.ndarray) -> np.ndarray:
        return slab.grid.distance(transform_points(inverse(X_PO[0]), misplaced(patch, u)))

    d = phi(np.zeros(6))
    by_u = np.stack([phi(u) - d for u in np.eye(6)], axis=1)
    covariance = np.diag(NOISE["sigma_depth"] ** 2 + (NOISE["share"] * depths(patch)) ** 2) + by_u @ by_u.T
    expected = 0.5 * d @ np.linalg.solve(covariance, d)
    assert PatchCells(slab.grid, [patch], **NOISE).cost(X_PO)[0] == pytest.approx(expected, rel=1e-5)


def test_cells_that_feel_nothing_saturated_and_dead_ones(slab: ObjectModel) -> None:
    alone = NOISE | {"sigma_position": 0.0, "sigma_rotation": 0.0, "share": 0.0}

    def cost(pressure: float, z: float, **limits: float) -> float:
        """Of one cell at the height z over the slab; its neighbour is dead."""
        cells = np.array([[0.0, 0.0, z], [0.0, 0.01, z]])
        patch = describe_patch(cells, [pressure, math.nan], alpha=ALPHA, n_PT=-OUT[:2], **limits)
        return float(PatchCells(slab.grid, [patch], **alone).cost(IDENTITY)[0])

    two_sigma = 2 * NOISE["sigma_depth"]
    np.testing.assert_allclose(cost(0.0, 0.003), 0.0)
    np.testing.assert_allclose(cost(0.0, -two_sigma), 2.0, rtol=1e-3)
    np.testing.assert_allclose(cost(0.0, -two_sigma, threshold=1e3), 0.5 * (2 - 0.25) ** 2, rtol=1e-3)
    # 1 mm deep.
    np.testing.assert_allclose(cost(1e4, -0.001 + two_sigma), 2.0, rtol=1e-3)
    np.testing.assert_allclose(cost(1e4, -0.001 - two_sigma), 2.0, rtol=1e-3)
    np.testing.assert_allclose(cost(1e4, -0.001 + two_sigma, saturation=1e4), 2.0, rtol=1e-3)
    np.testing.assert_allclose(cost(1e4, -0.001 - two_sigma, saturation=1e4), 0.0)


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_cell_that_is_touched_in_part_says_less_of_where_its_middle_is(slab: ObjectModel, turn: float) -> None:
    """A cell 10 mm wide beside the slab, and over it."""
    alone = NOISE | {"sigma_position": 0.0, "sigma_rotation": 0.0}
    sigma, half, depth = math.hypot(NOISE["sigma_depth"], NOISE["share"] * 3e-4), 0.005, 3e-4
    X_PO = make_poses(exp_so3(np.array([[0.0, 0.0, turn]])), np.array([[0.01, 0.02, 0.03]]))

    def cost(p_OT: list[float], n_OT: list[float]) -> float:
        """Of one cell that shows the depth; its neighbour is dead."""
        points = np.array([p_OT, [p_OT[0], p_OT[1] + 2 * half, p_OT[2]]])
        patch = describe_patch(
            transform_points(X_PO[0], points),
            [depth / ALPHA, math.nan],
            alpha=ALPHA,
            n_PT=np.array([n_OT, n_OT]) @ X_PO[0, :, :3].T,
        )
        return float(PatchCells(slab.grid, [patch], **alone).cost(X_PO)[0])

    def expected(phi: float, slack: float) -> float:
        return float(0.5 * phi**2 / (sigma**2 + slack**2 / 3))

    # Beside the slab: its side may be anywhere on the cell.
    beside = [cost([0.1 + way, 0.0, -0.010], [0.0, 0.0, -1.0]) for way in (0.001, 0.004, 0.02)]
    np.testing.assert_allclose(beside, [expected(way, half) for way in (0.001, 0.004, 0.02)], rtol=0.02)
    # Over the face nothing is lost, though it is as far away; on a pad that leans, what the formula says.
    assert cost([0.0, 0.0, 0.001 - depth], [0.0, 0.0, -1.0]) == pytest.approx(expected(0.001, 0.0), rel=1e-3)
    for lean, is_covered in ((0.04, True), (0.2, False)):
        out = np.array([math.sin(lean), 0.0, -math.cos(lean)])
        slack = (math.sqrt(half * math.sin(lean)) - math.sqrt(depth * math.cos(lean))) ** 2
        middle = list(np.array([0.0, 0.0, 0.001]) + depth * out)
        assert cost(middle, list(out)) == pytest.approx(expected(0.001, 0.0 if is_covered else slack), rel=1e-3)


@pytest.mark.parametrize("turn", [0.0, 0.5 * math.pi])
def test_a_long_cell_that_is_touched_in_part_says_little_of_where_its_end_is(slab: ObjectModel, turn: float) -> None:
    """Two rows of cells of 2 x 6 mm; the only live one is pressed, and its middle stands beyond the slab's side."""
    alone = NOISE | {"sigma_position": 0.0, "sigma_rotation": 0.0}
    depth, beyond = 3e-4, 0.001
    sigma = math.hypot(NOISE["sigma_depth"], NOISE["share"] * depth)
    cells = np.array([[0.002 * i, 0.006 * j, 0.0] for i in range(5) for j in range(2)])
    pressure = np.full(10, math.nan)
    pressure[4] = depth / ALPHA
    placed = (cells - cells[4]) @ exp_so3(np.array([0.0, 0.0, turn])).T + [0.1 + beyond, 0.0, -0.01]
    patch = describe_patch(placed, pressure, alpha=ALPHA, n_PT=-OUT[:10])
    cost = float(PatchCells(slab.grid, [patch], **alone).cost(IDENTITY)[0])
    half = 0.001 if turn == 0.0 else 0.003
    assert cost == pytest.approx(0.5 * beyond**2 / (sigma**2 + half**2 / 3), rel=0.02)


def test_the_cost_is_half_the_sum_of_squares(angular: ObjectModel) -> None:
    X_PO, patches = pads_on(angular, 3)
    objective = PatchContact(angular.grid, patches)
    poses = retract(X_PO[None], np.random.default_rng(3).normal(size=(30, 6)) * 0.02)
    half_squares = 0.5 * np.sum(objective.residuals(poses) ** 2, axis=1)
    np.testing.assert_allclose(objective.cost(poses), half_squares, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(objective.normal_equations(poses).cost, half_squares, rtol=1e-6, atol=1e-6)


def test_moving_the_palm_frame_moves_the_answer(blob: ObjectModel) -> None:
    X_PO, X_QP = random_pose(7), random_pose(8)
    patches = touch_with_pads(blob, X_PO, 3, np.random.default_rng(7))
    moved = [
        describe_patch(transform_points(X_QP, p.p_PT), p.pressure, alpha=p.alpha, n_PT=p.n_PT @ X_QP[:, :3].T)
        for p in patches
    ]
    poses = retract(X_PO[None], np.random.default_rng(9).normal(size=(10, 6)) * 0.01)
    X_QO = make_poses(X_QP[:, :3] @ poses[..., :3], transform_points(X_QP, poses[..., 3]))
    costs = PatchContact(blob.grid, patches).cost(poses)
    np.testing.assert_allclose(PatchContact(blob.grid, moved).cost(X_QO), costs, rtol=1e-6)
    np.testing.assert_allclose(PatchContact(blob.grid, patches[::-1]).cost(poses), costs, rtol=1e-12)


def test_a_pad_on_the_wrong_side_of_a_thin_wall_costs_more() -> None:
    plate = ObjectModel.from_mesh(trimesh.creation.box((0.1, 0.1, 0.0015)))

    def cost(z: float, out: float) -> float:
        """Of a pad at the height z that faces up or down, pressed in by half a millimetre."""
        pad = flat_pad() + np.array([0.0, 0.0, z])
        patch = describe_patch(pad, np.full(24, 5e3), alpha=ALPHA, n_PT=out * OUT)
        return float(PatchContact(plate.grid, [patch]).cost(IDENTITY)[0])

    # The cells' points lie on the plate's upper side, then on its lower.
    costs = [cost(0.00025, -1.0), cost(-0.00025, 1.0), cost(-0.00125, -1.0), cost(0.00125, 1.0)]
    assert max(costs[:2]) < 1.0
    assert min(costs[2:]) > max(costs[:2]) + 5.0


def test_the_cost_is_the_sum_of_what_each_pad_costs_alone(angular: ObjectModel) -> None:
    X_PO, patches = pads_on(angular, 11)
    silent = describe_patch(patches[0].p_PT, np.zeros(24), alpha=ALPHA, n_PT=patches[0].n_PT)
    patches = [patches[0], silent, *patches[1:]]
    poses = retract(X_PO[None], np.random.default_rng(11).normal(size=(30, 6)) * 0.02)
    objective = PatchContact(angular.grid, patches)
    alone = np.stack([PatchContact(angular.grid, [patch]).cost(poses) for patch in patches], axis=1)
    np.testing.assert_allclose(objective.pad_costs(poses), alone, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(objective.cost(poses), alone.sum(axis=1), rtol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_cells_that_look_every_way_face_nothing(slab: ObjectModel, turn: float) -> None:
    """Those on both sides of a finger in a slot count by their distances alone."""
    side, R = flat_pad(3, 3) + np.array([0.0, 0.0, 0.004]), exp_so3(np.array([turn, 0.0, 0.0]))
    cells, n_PT = np.vstack([side, side * [1, 1, -1]]), np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 9, axis=0)
    around = describe_patch(cells @ R.T, np.full(18, 0.001 / ALPHA), alpha=ALPHA, n_PT=n_PT @ R.T)
    _, others = pads_on(slab, 4, count=1)
    poses = retract(IDENTITY, np.random.default_rng(4).normal(size=(30, 6)) * 0.02)
    found = PatchContact(slab.grid, [around, *others]).pad_costs(poses)
    cells_alone = {"sigma_depth": 0.0005, "share": 0.2, "sigma_position": 0.0009, "sigma_rotation": math.radians(5.0)}
    np.testing.assert_array_equal(found[:, 0], PatchCells(slab.grid, [around], **cells_alone).cost(poses))
    np.testing.assert_array_equal(found[:, 1:], PatchContact(slab.grid, others).pad_costs(poses))
    assert np.isfinite(PatchMixture(slab, [around, *others], 0.02).cost(poses)).all()


def test_pads_that_feel_nothing_keep_the_object_out(slab: ObjectModel) -> None:
    free = [
        describe_patch(flat_pad() + np.array([0.0, 0.0, z]), np.zeros(24), alpha=ALPHA, n_PT=-OUT)
        for z in (0.002, -0.01)
    ]
    assert PatchContact(slab.grid, free[:1]).cost(IDENTITY)[0] == 0.0
    assert PatchContact(slab.grid, free[1:]).cost(IDENTITY)[0] > 40.0
    assert PatchContact(slab.grid, free).residuals(IDENTITY).shape == (1, 2 * 24 + 2 * 6)
    assert PatchContact(slab.grid, []).cost(IDENTITY)[0] == 0.0


def test_patches_and_contacts_make_one_estimate(angular: ObjectModel) -> None:
    X_PO, generator = random_pose(10), np.random.default_rng(10)
    exact = {"sigma_position": 0.0, "sigma_rotation": 0.0, "sigma_depth": 0.0}
    patches = touch_with_pads(angular, X_PO, 3, generator, **exact)
    points, normals = angular.samples.points[[10, 900]], angular.samples.normals[[10, 900]]
    contacts = Contacts(transform_points(X_PO, points), normals @ X_PO[:, :3].T)
    touch = SumObjective([PatchContact(angular.grid, patches), SurfaceContact(angular.grid, contacts)])
    start = retract(X_PO[None], generator.normal(size=(20, 6)) * ([0.1] * 3 + [0.005] * 3))
    found = LevenbergMarquardt().refine(touch, start)
    off = increments_between(found.X_PO[:1], X_PO[None])[0]
    assert np.degrees(np.linalg.norm(off[:3])) < 1.0
    assert np.linalg.norm(off[3:]) < 0.001


def test_costs_are_log_likelihoods(blob: ObjectModel) -> None:
    """With the noise that they assume, the truth costs on average half of six degrees of freedom more than the best."""
    excess = []
    for seed in range(40):
        X_PO, generator = random_pose(seed), np.random.default_rng(seed)
        patches = touch_with_pads(blob, X_PO, 4, generator, sigma_depth=0.0005)
        objective = PatchContact(blob.grid, patches)
        found = LevenbergMarquardt().refine(objective, X_PO[None])
        excess.append(objective.cost(X_PO[None])[0] - found.cost[0])
    assert np.mean(excess) == pytest.approx(3.0, abs=1.0)


@pytest.mark.parametrize("option", ["sigma_depth", "share", "sigma_position", "sigma_rotation", "sigma_lean"])
def test_bad_options_are_named(slab: ObjectModel, option: str) -> None:
    patch = describe_patch(flat_pad(), np.ones(24), alpha=ALPHA)
    with pytest.raises(InvalidInputError, match=f"{option} must be a number >.*, not -1"):
        PatchContact(slab.grid, [patch], **{option: -1.0})  # type: ignore[arg-type]
