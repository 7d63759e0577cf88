"""The fuzzer's targets `solve_contact`, `solve_contacts` and `describe_patch`."""

from collections.abc import Callable
from typing import Any

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tests.fuzz import touches
from tests.fuzz.targets import Arguments, Target, build


def _axes(rng: np.random.Generator) -> tuple[float, ...]:
    return tuple(rng.uniform(0.004, 0.02, 3).tolist())


SURFACES: dict[str, Callable[[np.random.Generator], Arguments]] = {
    "Sphere": lambda rng: {"radius": float(rng.uniform(0.004, 0.02))},
    "Ellipsoid": lambda rng: {"semi_axes": _axes(rng)},
    "Cylinder": lambda rng: {"radius": float(rng.uniform(0.004, 0.02)), "length": float(rng.uniform(0.004, 0.05))},
    "Capsule": lambda rng: {
        "radius": float(rng.uniform(0.004, 0.02)),
        "length": float(rng.choice([0.0, 0.02])),
        "two_ended": bool(rng.random() < 0.5),
    },
    "Superquadric": lambda rng: {"semi_axes": _axes(rng), "exponents": tuple(rng.uniform(0.1, 1.5, 2).tolist())},
}


def _options(rng: np.random.Generator) -> Arguments:
    kind = str(rng.choice(list(SURFACES)))
    layer = {"thickness": touches.log_uniform(rng, 1e-4, 3e-3), "stiffness": touches.log_uniform(rng, 1e2, 1e5)}
    return {
        "kind": kind,
        "surface": {**SURFACES[kind](rng), "X_SF": touches.pose(rng, 0.02)},
        "layer": touches.maybe(rng, 0.4, lambda: layer),
        "min_force": float(rng.choice([0.0, 0.05])),
        "friction_coefficient": touches.maybe(rng, 0.5, lambda: touches.log_uniform(rng, 0.05, 3.0)),
        "method": str(rng.choice(["auto", "newton"])),
    }


def _wrenches(rng: np.random.Generator, count: int) -> Any:
    """Of pushes near the fingertip, and of anything."""
    force = rng.normal(size=(count, 3)) * touches.log_uniform(rng, 1e-3, 50.0)
    arm = rng.uniform(-0.02, 0.02, (count, 3))
    return np.hstack([np.cross(arm, force) + 1e-3 * rng.normal(size=(count, 3)), force])


def _built(arguments: Arguments) -> Arguments:
    given = dict(arguments)
    given["surface"] = build(getattr(tp, given.pop("kind")), given["surface"])
    given["layer"] = build(SoftLayer, given["layer"])
    return given


def solve_one(arguments: Arguments) -> None:
    solution = tp.solve_contact(**_built(arguments))
    numbers = [getattr(solution, name) for name in ("p_SC", "n_S", "normal_force", "friction_force", "local_torque")]
    if solution.valid:
        assert np.isfinite(numbers).all(), solution
        assert np.isfinite([solution.residual, solution.deformation]).all()
        assert not solution.reason
    else:
        assert np.isnan(numbers).all(), solution
        assert solution.reason


def solve_many(arguments: Arguments) -> None:
    solutions = tp.solve_contacts(**_built(arguments))
    numbers = np.hstack([getattr(solutions, name) for name in ("p_SC", "n_S", "normal_force", "friction_force")])
    assert np.isfinite(numbers[solutions.valid]).all()
    assert np.isnan(numbers[~solutions.valid]).all()
    assert all(bool(reason) != bool(valid) for reason, valid in zip(solutions.reason, solutions.valid, strict=True))


def patch_arguments(rng: np.random.Generator) -> Arguments:
    given = touches.pad(rng, touches.any_model(rng), touches.pose(rng))
    if rng.random() < 0.3:
        given["n_PT"] = None
        given["alpha"] *= rng.choice([-1.0, 1.0])
    return given


def describe(arguments: Arguments) -> None:
    patch = tp.describe_patch(**arguments)
    assert patch.status in ("area", "narrow", "row", "point", "no_contact")
    assert np.isfinite(patch.centroid).all() == patch.is_felt
    if patch.status == "area":
        assert np.isfinite(patch.eigenvectors).all()
        assert np.isfinite(patch.eigenvalues).all()
    assert (patch.points.shape, patch.half_pitch >= 0.0) == ((len(patch.pressure), 3), True)


TARGETS = [
    Target(lambda rng: {"F_S": _wrenches(rng, 1)[0], **_options(rng)}, solve_one),
    Target(lambda rng: {"F_S": _wrenches(rng, int(rng.integers(0, 20))), **_options(rng)}, solve_many),
    Target(patch_arguments, describe),
]
