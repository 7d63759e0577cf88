"""Compiled loops: one version each, and bits that depend on the numbers alone."""

import ast
import gc
import importlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import _nrt_python, rtsys

import tactopose_drake
from tactopose_drake.core import compilation
from tactopose_drake.core.compilation import Inlined, Kernel, read_only
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats2, numba_type
from tactopose_drake.core.kernels.descent_kernels import descend
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.kernels.pose_kernels import retract, retract_one
from tactopose_drake.core.kernels.prior_kernels import Prior, prior_costs
from tactopose_drake.core.shape.point_grid import build_point_grid

CORE = Path(tactopose_drake.__file__).parent / "core"
MODULES = [
    "tactopose_drake." + ".".join(path.relative_to(CORE.parent).with_suffix("").parts)
    for path in sorted(CORE.rglob("*_kernels.py"))
]
FOR_ANNOTATIONS = {"tactopose_drake.core.validation.FloatArray"}
NUMBA_ELSEWHERE = {"compilation.py", "kernel_cache.py", "kernel_types.py", "linked_code.py", "prefetch.py"}


def kernels(module: str) -> list[Kernel]:
    found = vars(importlib.import_module(module)).values()
    return [value for value in found if isinstance(value, Kernel) and value.py_func.__module__ == module]


def test_the_kernels_were_found() -> None:
    assert sum(len(kernels(module)) for module in MODULES) > 100


@pytest.mark.parametrize("module", MODULES)
def test_each_kernel_is_compiled_for_one_signature(module: str) -> None:
    for kernel in kernels(module):
        kernel.make_ready()
        assert len(kernel.signatures) == 1, f"{module}.{kernel.py_func.__name__}"
        assert not kernel.targetoptions.get("fastmath"), f"{module}.{kernel.py_func.__name__}"


@pytest.mark.parametrize("module", MODULES)
def test_what_is_compiled_otherwise_is_inlined(module: str) -> None:
    for name, value in vars(importlib.import_module(module)).items():
        if isinstance(value, Dispatcher) and not isinstance(value, Kernel):
            assert isinstance(value, Inlined), f"{module}.{name}"
            assert value.targetoptions.get("forceinline"), f"{module}.{name}"
            assert not value.targetoptions.get("fastmath"), f"{module}.{name}"


def test_a_part_of_kernels_may_be_called_by_itself() -> None:
    X = np.eye(3, 4)[None]
    expected, found = np.empty_like(X), np.empty_like(X)
    increment = np.array([0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    retract(X, increment[None], expected)
    retract_one(X[0], increment, found[0])
    np.testing.assert_array_equal(found, expected)


def test_nothing_else_is_compiled() -> None:
    for path in CORE.parent.rglob("*.py"):
        if path.stem.endswith("_kernels") or path.name in NUMBA_ELSEWHERE:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] == "numba"], path


def test_kernels_take_arrays_that_may_be_written_and_others_alike() -> None:
    generator = np.random.default_rng(0)
    X = np.concatenate([np.tile(np.eye(3), (50, 1, 1)), generator.normal(size=(50, 3, 1))], axis=2)
    increments = generator.normal(size=(50, 6))
    expected, found = np.empty_like(X), np.empty_like(X)
    retract(X, increments, expected)
    retract(read_only(X), read_only(increments), found)
    np.testing.assert_array_equal(found, expected)
    assert len(retract.signatures) == 1  # type: ignore[attr-defined]
    unaligned = np.zeros(X.nbytes + 1, dtype=np.uint8)[1:].view(np.float64).reshape(X.shape)
    unaligned[...] = X
    retract(unaligned, increments, found)
    np.testing.assert_array_equal(found, expected)
    assert len(retract.signatures) == 1  # type: ignore[attr-defined]
    for other in (np.asfortranarray(X), np.repeat(X, 2, axis=0)[::2], X.astype(np.float32)):
        with pytest.raises(TypeError, match="No matching definition"):
            retract(other, increments, found)
    with pytest.raises(TypeError, match="No matching definition"):
        retract(X, increments, read_only(found))


def test_named_tuples_are_taken_by_the_types_of_their_fields() -> None:
    generator = np.random.default_rng(0)
    prior = Prior(read_only(np.eye(3, 4)), read_only(generator.uniform(size=6)))
    X, cost, again = np.empty((5, 3, 4)), np.empty(5), np.empty(5)
    retract(np.tile(np.eye(3, 4), (5, 1, 1)), increments := generator.normal(size=(5, 6)), X)
    prior_costs(prior, X, cost)
    expected = 0.5 * np.sum((increments * prior.weights) ** 2, axis=1)
    np.testing.assert_allclose(cost, expected, rtol=1e-12)
    prior_costs(prior, read_only(X), again)
    np.testing.assert_array_equal(again, cost)
    for other in (
        prior._replace(X=prior.X.astype(np.float32)),
        prior._replace(weights=np.ones(6, dtype=np.int64)),
        prior._replace(X=read_only(np.eye(3, 4)[None])),
        prior._replace(X=prior.X.copy(order="F")),
        (*prior, prior.weights),
        prior.X,
    ):
        with pytest.raises(TypeError, match="No matching definition"):
            prior_costs(other, X, cost)  # type: ignore[arg-type]
    assert len(prior_costs.signatures) == 1  # type: ignore[attr-defined]


def test_a_view_for_kernels_is_read_only_and_leaves_the_array_as_it_is() -> None:
    array = np.zeros((4, 6))[:, ::2]
    view = read_only(array)
    assert view.flags.c_contiguous
    assert not view.flags.writeable
    assert array.flags.writeable
    cloud = build_point_grid(np.random.default_rng(0).normal(size=(20, 3))).kernel_view
    assert not cloud.points.flags.writeable


@pytest.mark.parametrize("enabled", [True, False])
def test_no_garbage_is_looked_for_while_a_kernel_is_compiled(enabled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def double(values: OutFloats1) -> None:
        for i in range(len(values)):
            values[i] *= 2.0

    compiled, seen = Kernel(py_func=double, targetoptions={"nopython": True}), list[bool]()
    compile_it = compiled.compile

    def watched(declared: Any) -> Any:
        seen.append(gc.isenabled())
        return compile_it(declared)

    monkeypatch.setattr(compiled, "compile", watched)
    before, values = gc.isenabled(), np.ones(3)
    (gc.enable if enabled else gc.disable)()
    try:
        compiled(values)
        after = gc.isenabled()
    finally:
        (gc.enable if before else gc.disable)()
    assert (seen, after) == ([False], enabled)
    np.testing.assert_array_equal(values, [2.0, 2.0, 2.0])


def test_arrays_are_counted_only_where_some_are_made() -> None:
    def same(values: OutFloats2) -> OutFloats2:
        return values

    def own_row(values: OutFloats2) -> OutFloats1:
        row = np.empty(values.shape[1])
        for k in range(values.shape[1]):
            row[k] = values[0, k]
        return row

    own, borrowed = (Kernel(py_func=function, targetoptions={"nopython": True}) for function in (own_row, same))
    np.testing.assert_array_equal(own(np.eye(3)), [1.0, 0.0, 0.0])
    with pytest.raises(TypeError, match="must return an array of its own"):
        borrowed(np.eye(3))
    assert not _counts(retract)
    assert _counts(descend)


def _counts(function: Any) -> bool:
    function.make_ready()
    return bool(function.targetoptions["_nrt"])


def test_no_kernel_keeps_what_it_makes() -> None:
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        X, increments = np.tile(np.eye(3, 4), (40, 1, 1)), np.zeros((40, 6))
        for _ in range(3):
            retract(X, increments, X.copy())
            inverses(np.tile(np.eye(6), (5, 1, 1)))
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert after.mi_alloc > before.mi_alloc
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free


class Pair(NamedTuple):
    values: Floats2
    scale: float


def test_annotations_say_the_types() -> None:
    assert str(numba_type(Floats1)) == "readonly array(float64, 1d, C)"
    assert str(numba_type(OutFloats1)) == "array(float64, 1d, C)"
    assert str(numba_type(tuple[int, int])) == "UniTuple(int64 x 2)"
    assert str(numba_type(Pair)) == "Pair(readonly array(float64, 2d, C), float64)"
    with pytest.raises(TypeError, match="must stand for the type"):
        numba_type(str)


def test_the_cache_notices_changes_of_all_that_is_compiled_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {name: tmp_path / f"{name}.py" for name in ("a_kernels", "b_kernels", "c_kernels", "d_kernels")}
    texts = ("from x import b_kernels", "from x.c_kernels import f", "LIMIT = 1", "")
    monkeypatch.setattr(compilation, "_kernel_files", lambda: files)

    def fingerprint() -> bytes:
        compilation._fingerprint.cache_clear()
        return compilation._fingerprint("a_kernels")

    try:
        for path, text in zip(files.values(), texts, strict=True):
            path.write_text(text)
        before = fingerprint()
        files["d_kernels"].write_text("f = 1")  # which a does not name
        assert fingerprint() == before
        files["c_kernels"].write_text("LIMIT = 2")  # which it does through b
        assert fingerprint() != before
    finally:
        compilation._fingerprint.cache_clear()


def test_files_of_kernels_take_nothing_else_that_is_compiled_in() -> None:
    """A constant of another file would be compiled in, and its change go unnoticed."""
    for module in MODULES:
        path = CORE.parent.parent / Path(*module.split(".")).with_suffix(".py")
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactopose_drake"):
                taken = {f"{node.module}.{name.name}" for name in node.names}
                part = (node.module or "").rsplit(".", 1)[-1]
                are_kernels = part.endswith("_kernels") or all(name.endswith("_kernels") for name in taken)
                of_compiling = part in ("compilation", "kernel_types", "prefetch")
                assert are_kernels or of_compiling or taken <= FOR_ANNOTATIONS, f"{module}: {taken}"
