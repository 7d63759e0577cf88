"""What asking the processor early for the distance grid's nodes buys: a descent with and without, the same poses.

`pytest -n 0 -s tests/benchmarks/test_prefetch.py` prints the ratio of their medians: five contacts, 100 poses under a
guess, one core, in turn. Where the grid (32 MB) lies in the processor's cache it buys nothing.
"""

import statistics
import time
import types
from typing import Any

import numba
import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.kernels import descent_kernels, lane_kernels, surface_contact_kernels
from tactopose_drake.core.kernels.descent_kernels import Ends
from tactopose_drake.core.kernels.hand_sphere_kernels import NO_SPHERES
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.objectives.compiled_descent import NO_DOUBTS
from tactopose_drake.core.objectives.pose_prior import NO_PRIOR
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path

ROUNDS, POSES = 200, 100


def compiled_with(kernel: Any, **names: Any) -> Any:
    """A kernel compiled anew, where these names stand for something else."""
    function = kernel.py_func
    others = types.FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)
    return numba.njit(others, error_model="numpy", nogil=True)


def without_prefetch() -> Any:
    """The same kernel, compiled with a prefetch that does nothing."""
    nothing = numba.njit(lambda flat, index: None, inline="always")
    read_grid = compiled_with(lane_kernels.read_grid, prefetch=nothing)
    add_up = compiled_with(surface_contact_kernels.add_up, read_grid=read_grid)
    return compiled_with(descent_kernels.descend, add_up=add_up)


def test_prefetch() -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    rng = np.random.default_rng(0)
    rule = DescentRule(4, 1e-6, 1e-2, 1e6, 0.1)
    kernels = {"with": descent_kernels.descend, "without": without_prefetch()}
    taken: dict[str, list[float]] = {name: [] for name in kernels}
    costs = {}
    for round_ in range(ROUNDS + 2):
        contacts = touch_surface(model, np.eye(3, 4), 5, rng)
        increments = rng.normal(size=(POSES, 6)) * np.repeat([0.28, 0.033], 3)
        X_start = retract(np.tile(np.eye(3, 4), (POSES, 1, 1)), increments)
        objective = SurfaceContact(model.grid, contacts)
        # In turn, for the second one finds what the first has fetched.
        for name in sorted(kernels, reverse=bool(round_ % 2)):
            X_PO, cost = X_start.copy(), np.empty(POSES)
            ends = Ends(
                cost,
                np.empty((POSES, 6)),
                np.empty((POSES, 6, 6)),
                np.empty(POSES, dtype=np.int64),
                np.empty(POSES, dtype=np.bool_),
            )
            started = time.process_time()
            kernels[name](objective.grid, objective.touch, NO_DOUBTS, NO_PRIOR, NO_SPHERES, rule, False, X_PO, ends)
            taken[name].append(time.process_time() - started)
            costs[name] = cost
        np.testing.assert_array_equal(costs["with"], costs["without"])
    medians = {name: statistics.median(times[2:]) for name, times in taken.items()}
    ratio = medians["without"] / medians["with"]
    print(f"\nprefetch: {1e6 * medians['with'] / POSES:.2f} us a pose; without {ratio:.2f} times that")  # noqa: T201
