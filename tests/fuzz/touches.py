"""Plausible touches of plausible objects: what the fuzzer's calls are given, drawn from one generator."""

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, transform_points
from tests.fuzz.targets import Arguments

Array = NDArray[np.float64]

_OBJECTS = Path(__file__).parents[2] / "models" / "objects"
_create = trimesh.creation
OBJECTS: dict[str, Callable[[], Any]] = {
    **{name: functools.partial(str, _OBJECTS / f"{name}.obj") for name in ("mug", "cube", "pencil", "wine_glass")},
    "tea_box": lambda: str(_OBJECTS / "tea_box.obj"),
    "box": lambda: _create.box((0.05, 0.08, 0.11)),
    "ball": lambda: _create.icosphere(3, 0.03),
    "cylinder": lambda: _create.cylinder(0.02, 0.1),
    "capsule": lambda: _create.capsule(0.06, 0.02),
    "ring": lambda: _create.torus(0.04, 0.012),
    "crumb": lambda: _create.icosphere(2, 0.004),
}


@functools.cache
def model(name: str) -> tp.ObjectModel:
    """One of the objects, with its mass; made once in a process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tp.ObjectModel.from_mesh(OBJECTS[name](), name=name, mass=0.2)


def any_model(rng: np.random.Generator) -> tp.ObjectModel:
    return model(str(rng.choice(list(OBJECTS))))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def maybe(rng: np.random.Generator, share: float, draw: Callable[[], Any]) -> Any:
    return draw() if rng.random() < share else None


def pose(rng: np.random.Generator, reach: float = 0.1) -> Array:
    """Shape (3, 4)."""
    return make_poses(random_rotations(rng, 1), rng.uniform(-reach, reach, (1, 3)))[0]


def sigma(rng: np.random.Generator, low: float, high: float, usual: float, count: int) -> Any:
    """The usual one, another number, or one for each."""
    way = rng.random()
    if way < 0.3:
        return usual
    if way < 0.8:
        return log_uniform(rng, low, high)
    return np.exp(rng.uniform(np.log(low), np.log(high), count))


def contacts(rng: np.random.Generator, touched: tp.ObjectModel, X_PO: Array, count: int | None = None) -> Arguments:
    """Those of `Contacts`: noisy points on the object's surface at a pose, spread or all in one region."""
    count = round(log_uniform(rng, 1.0, 100.0)) if count is None else count
    samples = touched.samples
    rows = rng.integers(len(samples), size=count)
    if count and rng.random() < 0.2:
        middle = samples.points[rows[0]]
        near = np.argsort(np.linalg.norm(samples.points - middle, axis=1))[: max(count, 50)]
        rows = rng.choice(near, size=count)
    n_PC = samples.normals[rows] @ X_PO[:, :3].T
    sigma_position = sigma(rng, 1e-5, 0.1, 0.0009, count)
    noise = rng.choice([0.0, 1.0, 3.0]) * np.minimum(sigma_position, 0.02) * np.ones(count)
    p_PC = transform_points(X_PO, samples.points[rows]) + noise[:, None] * rng.normal(size=(count, 3))
    sigma_normal = sigma(rng, 1e-3, 1.0, 0.0873, count)
    turned = n_PC + np.minimum(np.ones(count) * sigma_normal, 0.5)[:, None] * rng.normal(size=(count, 3))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    force = n_PC * rng.uniform(0.1, 5.0, (count, 1)) + rng.normal(scale=0.2, size=(count, 3))
    return {
        "p_PC": p_PC,
        "n_PC": maybe(rng, 0.6, lambda: turned),
        "f_PC": maybe(rng, 0.5, lambda: force),
        "sigma_position": sigma_position,
        "sigma_normal": sigma_normal,
        "sigma_force": sigma(rng, 1e-3, 1.0, 0.05, count),
    }


def prior(rng: np.random.Generator, X_PO: Array) -> Arguments:
    """Those of `PosePrior`: a guess near the true pose, or far from it for what it claims."""
    translation, rotation = log_uniform(rng, 1e-4, 0.2), log_uniform(rng, 1e-3, 3.0)
    off = rng.choice([0.0, 1.0, 3.0])
    turn = exp_so3(off * min(rotation, 1.0) * rng.normal(size=3))
    step = np.concatenate([turn, (off * translation * rng.normal(size=3))[:, None]], axis=1)
    guess = compose(X_PO, step)
    return {"X_PO": guess, "sigma_translation": translation, "sigma_rotation": rotation}


def hand(rng: np.random.Generator, touched: tp.ObjectModel, X_PO: Array) -> Arguments:
    """Those of `HandGeometry`: spheres that touch the object from outside, some anywhere."""
    count = round(log_uniform(rng, 1.0, 60.0))
    radius = rng.uniform(0.004, 0.02, count)
    rows = rng.integers(len(touched.samples), size=count)
    p_OH = touched.samples.points[rows] + radius[:, None] * touched.samples.normals[rows]
    p_PH = transform_points(X_PO, p_OH)
    anywhere = rng.random(count) < 0.2
    p_PH[anywhere] = rng.uniform(-0.15, 0.15, (int(anywhere.sum()), 3))
    return {"p_PH": p_PH, "radius": radius, "sigma": log_uniform(rng, 1e-4, 0.01)}


def pad(rng: np.random.Generator, touched: tp.ObjectModel, X_PO: Array) -> Arguments:
    """Those of `describe_patch`: a flat pad of cells that presses the object somewhere, or misses it."""
    rows, columns, pitch = int(rng.integers(1, 9)), int(rng.integers(1, 6)), 0.0034
    y, x = np.meshgrid(np.arange(rows) * pitch, np.arange(columns) * pitch, indexing="ij")
    cells = np.column_stack([x.ravel(), y.ravel(), np.zeros(rows * columns)])
    cells -= cells.mean(axis=0)
    one = rng.integers(len(touched.samples))
    out = touched.samples.normals[one]
    side = np.cross(out, rng.normal(size=3))
    side /= np.linalg.norm(side)
    R = np.stack([side, np.cross(-out, side), -out], axis=1)
    alpha = 1e-8
    sunk = rng.choice([-0.01, 0.0002, 0.001])
    p_OT = cells @ R.T + touched.samples.points[one] - sunk * out
    depth = np.maximum(0.0, -touched.grid.distance(p_OT)) + 1e-5 * rng.random(len(p_OT)) * (rng.random() < 0.3)
    pressure = depth / alpha
    if rng.random() < 0.2 and len(pressure) > 1:
        pressure[rng.integers(len(pressure))] = np.nan
    return {
        "p_PT": transform_points(X_PO, p_OT),
        "pressure": pressure,
        "alpha": alpha,
        "n_PT": np.tile(X_PO[:, :3] @ -out, (len(p_OT), 1)),
        "threshold": float(rng.choice([0.0, 1e3])),
        "saturation": maybe(rng, 0.3, lambda: 1e5),
        "misplacement": maybe(rng, 0.4, lambda: covariance(rng)),
    }


def covariance(rng: np.random.Generator) -> Array:
    """Of a shift and a small turn, m and rad, some of it along no direction at all."""
    root = rng.normal(size=(6, 6)) * np.repeat([log_uniform(rng, 1e-6, 0.01), log_uniform(rng, 1e-5, 0.3)], 3)
    root[rng.random(6) < 0.2] = 0.0
    return np.asarray(root.T @ root)


def plane(rng: np.random.Generator, touched: tp.ObjectModel, X_PO: Array) -> Arguments:
    """Those of `PlaneContact`: under the object, or anywhere."""
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    points = transform_points(X_PO, touched.samples.points)
    lowest = points[(points @ n).argmin()]
    return {"p_PQ": lowest + rng.choice([0.0, 0.0005, 0.05]) * n, "n_P": n, "sigma": log_uniform(rng, 1e-6, 0.1)}


def gravity(rng: np.random.Generator) -> Arguments:
    """Those of `ForceBalance`."""
    down = rng.normal(size=3)
    return {"gravity_P": 9.81 * down / np.linalg.norm(down), "sigma_torque": log_uniform(rng, 1e-5, 0.1)}
