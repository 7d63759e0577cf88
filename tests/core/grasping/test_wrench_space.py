import itertools
import math

import numpy as np
import pytest
from pydrake.solvers import MathematicalProgram, Solve
from scipy.optimize import minimize

from tactopose_drake.core.grasping.wrench_space import HullGrowthParams, WrenchSpace, cone_wrenches, convex_hull

DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])


def ring(count: int) -> np.ndarray:
    """Outward normals, evenly around the equator."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def random_grasp(generator: np.random.Generator, fingers: int, friction: float = 0.8, edges: int = 6) -> np.ndarray:
    """Primitives of a force closure grasp of an ellipsoid."""
    while True:
        n = generator.normal(size=(fingers, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        p = n * [0.03, 0.04, 0.07]
        n = p / np.square([0.03, 0.04, 0.07])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        primitives = cone_wrenches(p, n, friction, edges, 0.07)
        if WrenchSpace(primitives).is_force_closure:
            return primitives


def program_support_shape(space: WrenchSpace, program: MathematicalProgram) -> np.ndarray:
    """Shares of the primitives as the norm bounds them, flat; the wrench is their sum."""
    contacts, edges = space.primitives.shape[:2]
    shares = program.NewContinuousVariables(contacts * edges)
    program.AddBoundingBoxConstraint(0.0, np.inf, shares)
    groups = [shares] if space.norm == "L1" else np.split(shares, contacts)
    for group in groups:
        program.AddLinearConstraint(np.ones((1, len(group))), [-np.inf], [1.0], group)
    return shares


def reach_by_program(space: WrenchSpace, direction: np.ndarray) -> float:
    """The largest multiple of a wrench in the space, by a linear program over the primitives' shares."""
    program = MathematicalProgram()
    shares = program_support_shape(space, program)
    scale = program.NewContinuousVariables(1)
    A = np.column_stack([space.primitives.reshape(-1, 6).T, -direction])
    program.AddLinearEqualityConstraint(A, np.zeros(6), np.concatenate([shares, scale]))
    program.AddLinearCost(-scale[0])
    result = Solve(program)
    assert result.is_success()
    return float(result.GetSolution(scale)[0])


def radius_by_programs(space: WrenchSpace, generator: np.random.Generator, starts: int) -> float:
    """The least support over all directions, by linear programs: of directions with a part of 1 along the last one.

    Each program's answer is no worse than its start, and the fixed points are local minima; many starts find the least.
    """
    best = np.inf
    for direction in generator.normal(size=(starts, 6)):
        last, direction = np.inf, direction / np.linalg.norm(direction)
        while True:
            program = MathematicalProgram()
            d = program.NewContinuousVariables(6)
            contacts = len(space.primitives)
            h = program.NewContinuousVariables(1 if space.norm == "L1" else contacts)
            program.AddBoundingBoxConstraint(0.0, np.inf, h)
            for i, edges in enumerate(space.primitives):
                bound = h[0] if space.norm == "L1" else h[i]
                for wrench in edges:
                    program.AddLinearConstraint(np.append(wrench, -1.0)[None], [-np.inf], [0.0], np.append(d, bound))
            program.AddLinearConstraint(direction[None], [1.0], [1.0], d)
            program.AddLinearCost(np.ones(len(h)), 0.0, h)
            result = Solve(program)
            assert result.is_success()
            found = result.GetSolution(d)
            value = result.get_optimal_cost() / np.linalg.norm(found)
            direction = found / np.linalg.norm(found)
            best = min(best, value)
            if value > last - 1e-9:
                break
            last = value
    return float(best)


@pytest.mark.parametrize(("norm", "starts"), [("L1", 25), ("Linf", 25)])
def test_the_radius_is_what_convex_programs_find(norm: str, starts: int) -> None:
    generator = np.random.default_rng(5)
    for fingers in (3, 4):
        space = WrenchSpace(random_grasp(generator, fingers, edges=4), norm)
        found = radius_by_programs(space, generator, starts)
        assert space.radius == pytest.approx(found, rel=1e-6), "neither an inexact facet nor one that was missed"


def test_however_the_hull_grows_the_radius_is_the_same() -> None:
    primitives = random_grasp(np.random.default_rng(5), 4, edges=4)
    slow = WrenchSpace(primitives, "Linf", HullGrowthParams(first_facets=4, facets_per_round=2))
    assert slow.radius == pytest.approx(WrenchSpace(primitives, "Linf").radius, rel=1e-7)


@pytest.mark.parametrize("norm", ["L1", "Linf"])
def test_what_is_resisted_is_what_a_linear_program_finds(norm: str) -> None:
    generator = np.random.default_rng(6)
    space = WrenchSpace(random_grasp(generator, 4), norm)
    wrenches = generator.normal(size=(6, 6))
    scales = [space.scale(wrench[None]) for wrench in wrenches]
    np.testing.assert_allclose(scales, [reach_by_program(space, -wrench) for wrench in wrenches], rtol=1e-6)
    assert space.scale(wrenches) == pytest.approx(min(scales), rel=1e-9)
    assert min(scales) * np.linalg.norm(wrenches, axis=1).max() >= space.radius
    assert space.scale(np.zeros((2, 6))) == space.scale(np.zeros((0, 6))) == np.inf


def test_three_frictional_fingers_on_a_sphere() -> None:
    # Fingers at u_i around the equator of a sphere of radius R, torques over the length l >= R, rho = R / l. With
    # tangents t_i and z, a direction (torque, force) = (q + c z, g + b z) has the support of finger i
    #   a_i + mu |y_i|,  a_i = -u_i.g,  y_i = (t_i.g + rho c, b - rho t_i.q),
    # and the sum's is h = sum max(0, a_i + mu |y_i|) >= mu sum |y_i|, since the a_i sum to 0. By Minkowski's inequality
    # sum |y_i| >= |(sum |y_i1|, sum |y_i2|)|, and each is at least the least 1-norm of an invertible map of (g, c), and
    # of (b, q): its inverse is largest at a corner of the cross-polytope, where one y is 1 and the others 0. There
    # b = 1/3 and |q| = 2/(3 rho), so the least is 3 / sqrt(1 + 4 / rho^2); of (g, c), 3 / sqrt(4 + 1 / rho^2) is no
    # less. At that corner g = 0, every a_i is 0, and equality holds.
    friction, u = 0.6, ring(3)
    for rho in (1.0, 0.5):
        exact = 3 * friction / math.sqrt(1 + 4 / rho**2)
        space = WrenchSpace(cone_wrenches(rho * u, u, friction, 12, 1.0), "Linf")
        assert space.radius == pytest.approx(exact, rel=0.01)
        if rho < 1.0:
            continue
        # The least of "L1" is no corner: it is looked for among the round cones' supports, the greatest finger's.
        t = np.cross([0, 0, 1.0], u)

        def support(d: np.ndarray, rho: float = rho, t: np.ndarray = t) -> float:
            d = d / np.linalg.norm(d)
            y = np.hypot(t @ d[3:] + rho * d[2], d[5] - rho * (t @ d[:3]))
            return float(np.max(friction * y - u @ d[3:]))

        starts = np.random.default_rng(0).normal(size=(8, 6))
        least = min(minimize(support, d, method="Nelder-Mead", options={"maxiter": 3000}).fun for d in starts)
        assert WrenchSpace(cone_wrenches(rho * u, u, friction, 32, 1.0)).radius == pytest.approx(least, rel=0.01)


@pytest.mark.parametrize("norm", ["L1", "Linf"])
def test_two_fingers_without_friction_hold_nothing(norm: str) -> None:
    u = DIRECTIONS[[0, 3]]
    space = WrenchSpace(cone_wrenches(u, u, 0.0, 8, 1.0), norm)
    assert space.primitives.shape == (2, 1, 6)
    assert not space.is_force_closure
    assert space.radius == space.volume == 0.0
    assert space.scale(np.eye(6)) == space.scale(np.zeros((1, 6))) == 0.0


@pytest.mark.parametrize("norm", ["L1", "Linf"])
@pytest.mark.parametrize("fingers", [1, 2, 3])
def test_without_force_closure_some_wrenches_are_resisted(norm: str, fingers: int) -> None:
    generator = np.random.default_rng(fingers)
    p = generator.normal(size=(fingers, 3))
    space = WrenchSpace(cone_wrenches(p, np.tile([0.0, 0.0, -1.0], (fingers, 1)), 0.6, 6, 1.0), norm)
    assert not space.is_force_closure
    assert space.radius == 0.0
    shares = generator.uniform(size=(4, 6 * fingers)) * np.array([[1e-3], [1.0], [1.0], [1e3]])
    resisted = -shares @ space.primitives.reshape(-1, 6)
    scales = [space.scale(wrench[None]) for wrench in resisted]
    np.testing.assert_allclose(scales, [reach_by_program(space, -wrench) for wrench in resisted], rtol=1e-5)
    assert space.scale(np.concatenate([resisted, np.zeros((1, 6))])) == pytest.approx(min(scales))
    assert min(scales) > 0.0
    # Fingers from below resist no pull upwards, however weak, nor all wrenches of a set with one.
    pull = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1e-6]])
    assert space.scale(pull) == space.scale(np.concatenate([resisted, pull])) == 0.0


@pytest.mark.parametrize("norm", ["L1", "Linf"])
@pytest.mark.parametrize("fingers", [0, 1, 2, 7])
def test_flat_wrench_spaces_have_no_content(norm: str, fingers: int) -> None:
    # However many normals pass through the centre: no torque without friction.
    friction = 0.0 if fingers == 7 else 0.9
    u = ring(max(fingers, 1))[:fingers]
    space = WrenchSpace(cone_wrenches(u, u, friction, 8, 1.0), norm)
    assert not space.is_force_closure
    assert space.radius == space.volume == 0.0


@pytest.mark.parametrize("norm", ["L1", "Linf"])
def test_without_contacts_the_space_extends_nowhere(norm: str) -> None:
    reach, points = WrenchSpace(np.zeros((0, 8, 6)), norm).support(np.eye(6))
    np.testing.assert_array_equal(reach, np.zeros(6))
    np.testing.assert_array_equal(points, np.zeros((6, 6)))


def test_the_polytopes_of_the_axes_are_known() -> None:
    axes = np.concatenate([np.eye(6), -np.eye(6)])
    corner = np.ones((1, 6))
    cross = WrenchSpace(axes[:, None])
    assert cross.radius == pytest.approx(1 / math.sqrt(6), rel=1e-7)
    assert cross.volume == pytest.approx(2**6 / math.factorial(6), rel=1e-6)
    assert cross.scale(corner) == pytest.approx(1 / 6, rel=1e-7)
    # The sum of three squares that stand on their corners, in planes of their own.
    squares = WrenchSpace(axes.reshape(2, 3, 2, 6).transpose(1, 0, 2, 3).reshape(3, 4, 6), "Linf")
    assert squares.radius == pytest.approx(1 / math.sqrt(2), rel=1e-7)
    assert squares.volume == pytest.approx(2.0**3, rel=1e-6)
    assert squares.scale(corner) == pytest.approx(1 / 2, rel=1e-7)


def test_coplanar_and_coinciding_wrenches_do_not_upset_it() -> None:
    generator = np.random.default_rng(0)
    closures = 0
    for _ in range(60):
        n = DIRECTIONS[generator.integers(0, 6, 4)]
        p = n + 0.2 * generator.integers(-2, 3, (4, 3)) * (n == 0)
        space = WrenchSpace(cone_wrenches(p, n, 0.5, 8, 1.0))
        assert (space.radius > 0.0) == space.is_force_closure
        closures += space.is_force_closure
    assert 10 < closures < 50


def test_a_ball_of_the_radius_is_inside_and_no_larger_one() -> None:
    generator = np.random.default_rng(3)
    directions = generator.normal(size=(20000, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for norm in ("L1", "Linf"):
        space = WrenchSpace(random_grasp(generator, 3, edges=4), norm)
        assert space.support(directions)[0].min() >= space.radius
        hull = convex_hull(space.vertices)
        assert hull is not None
        assert np.sort(hull.offsets)[0] == pytest.approx(space.radius, rel=1e-6)


def test_each_finger_at_its_limit_does_more_than_all_together() -> None:
    generator = np.random.default_rng(9)
    for fingers in (3, 4):
        primitives = random_grasp(generator, fingers)
        together, each = WrenchSpace(primitives), WrenchSpace(primitives, "Linf")
        assert together.radius <= each.radius <= fingers * together.radius
    assert each.support(np.eye(6))[0] == pytest.approx(
        [max(sum(w, start=np.zeros(6)) @ d for w in _choices(primitives)) for d in np.eye(6)]
    )


def _choices(primitives: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Every choice of one wrench or none of each contact."""
    return list(itertools.product(*[[np.zeros(6), *edges] for edges in primitives]))


def test_edges_lie_on_the_friction_cone() -> None:
    generator = np.random.default_rng(1)
    n = generator.normal(size=(5, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    p = generator.normal(size=(5, 3))
    wrenches = cone_wrenches(p, n, 0.7, 12, 2.0)
    force = wrenches[..., 3:]
    normal = np.einsum("kei,ki->ke", force, -n)
    np.testing.assert_allclose(normal, 1.0)
    np.testing.assert_allclose(np.linalg.norm(force + normal[..., None] * n[:, None], axis=-1), 0.7)
    np.testing.assert_allclose(2.0 * wrenches[..., :3], np.cross(p[:, None], force), atol=1e-12)
