"""The fuzzer's kind `bits`: equal numbers give equal estimates to the last bit, however they lie in memory.

One touch is estimated from its arrays as they are, and again from the same numbers elsewhere: read-only, strided, in
Fortran's order, misaligned, of the other byte order, in lists, copied, pickled, and in threads. The test of this kind
adds other processes.
"""

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

import tactopose_drake as tp
from tests.fuzz import touches
from tests.fuzz.estimation import estimate_arguments, several
from tests.fuzz.targets import Arguments, build

Array = touches.Array


def _read_only(array: Array) -> Array:
    array = array.copy()
    array.setflags(write=False)
    return array


def _strided(array: Array) -> Array:
    wide = np.zeros(tuple(2 * n for n in array.shape))
    view = wide[tuple(slice(None, None, 2) for _ in array.shape)]
    view[...] = array
    return view


def _backwards(array: Array) -> Array:
    return array[::-1].copy()[::-1]


def _misaligned(array: Array) -> Array:
    buffer = np.zeros(array.nbytes + 1, dtype=np.uint8)
    view = buffer[1:].view(np.float64).reshape(array.shape) if array.nbytes else array
    view[...] = array
    return view


LAYOUTS: dict[str, Callable[[Array], Any]] = {
    "as it is": lambda array: array,
    "read-only": _read_only,
    "strided": _strided,
    "backwards": _backwards,
    "misaligned": _misaligned,
    "Fortran": np.asfortranarray,
    "byte order": lambda array: array.astype(array.dtype.newbyteorder("S")),
    "float32": lambda array: array.astype(np.float32),
    "list": lambda array: array.tolist(),
    "masked": lambda array: np.ma.masked_array(array),
    "deep copy": copy.deepcopy,
}


def _map_arrays(change: Callable[[Array], Any], value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _map_arrays(change, entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_map_arrays(change, entry) for entry in value]
    return change(value) if isinstance(value, np.ndarray) and value.ndim else value


def single(array: Array) -> Array:
    """Numbers that float32 can represent, near the given ones."""
    return array.astype(np.float32).astype(np.float64)


def arguments(rng: np.random.Generator) -> Arguments:
    """Of an estimate that ends by itself; numbers other than poses and normals are those of float32."""
    given = estimate_arguments(rng)
    given["time_limit"] = None
    if given["method"] != "levenberg_marquardt":
        given["method"] = "pair_search"
    given["contacts"] = _map_arrays(single, given["contacts"])
    return given


def built(given: Arguments) -> Arguments:
    """The arguments of `estimate_pose`."""
    kinds = {
        "contacts": tp.Contacts,
        "prior": tp.PosePrior,
        "hand": tp.HandGeometry,
        "untouched": tp.HandGeometry,
        "balance": tp.ForceBalance,
    }
    return {
        **given,
        "patches": several(tp.describe_patch, given["patches"]),
        "planes": several(tp.PlaneContact, given["planes"]),
        **{name: build(kind, given[name]) for name, kind in kinds.items()},
    }


def digest(given: Arguments) -> bytes:
    """All numbers of the estimate but its duration."""
    estimate = tp.estimate_pose(**built(given))
    parts = [estimate.status.encode(), np.float64(estimate.log_evidence).tobytes()]
    for hypothesis in estimate.hypotheses:
        parts.append(np.array([hypothesis.cost, hypothesis.probability]).tobytes())
        parts.append(hypothesis.X_PO.GetAsMatrix34().tobytes() + np.array(hypothesis.covariance).tobytes())
        parts.append(np.ascontiguousarray(hypothesis.free_directions).tobytes())
    return b"".join(parts)


def laid_out(layout: str, given: Arguments) -> Arguments:
    """The same numbers in another layout; those that float32 cannot represent stay as they are."""
    change = LAYOUTS[layout]

    def exact(array: Array) -> Any:
        changed = change(array)
        return changed if np.array_equal(np.asarray(changed, dtype=np.float64), array, equal_nan=True) else array

    return {name: _map_arrays(exact, value) for name, value in given.items()}


def bits(rng: np.random.Generator) -> None:
    """One touch in all layouts, pickled, and in threads."""
    given = arguments(rng)
    expected = digest(given)
    for layout in LAYOUTS:
        assert digest(laid_out(layout, given)) == expected, layout
    model = given.pop("model")
    assert digest({**pickle.loads(pickle.dumps(given)), "model": model}) == expected, "pickled"
    again = {**given, "model": model}
    with ThreadPoolExecutor(3) as executor:
        assert list(executor.map(digest, [again] * 3)) == [expected] * 3, "threads"
