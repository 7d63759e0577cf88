"""What the package's kernels are made of: parts without machine code, and code that is read when somebody links it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding as llvm

from tactopose_drake.core import linked_code

MODULE = """
from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1

@inlined
def square(x):
    return x * x

@part
def total(x: Floats1) -> float:
    sum = 0.0
    for i in range(x.shape[0]):
        sum += square(x[i])
    return sum

@kernel
def twice(x: Floats1) -> float:
    return 2.0 * total(x)

@kernel
def thrice(x: Floats1) -> float:
    return twice(x) + total(x)

def library(function):
    return function.overloads[function.declared].library
"""
FIRST = """
import numpy as np, some_kernels as k
print(k.twice(np.array([3.0, 4.0])), k.library(k.total).get_pointer_to_function(k.total.py_func.__name__))
print(len(k.library(k.twice)._get_compiled_object()) > 0, hasattr(k.library(k.total), "_compiled_object"))
"""
SECOND = """
import numpy as np, some_kernels as k
k.twice.make_ready()
print(sum(k.twice.stats.cache_hits.values()), k.library(k.twice)._shared_module)
print(k.thrice(np.array([3.0, 4.0])), k.library(k.twice)._shared_module is not None)
print(sum(k.total.stats.cache_hits.values()), sum(k.thrice.stats.cache_hits.values()))
"""
THIRD = """
import numpy as np, some_kernels as k
print(k.thrice(np.array([3.0, 4.0])), len(k.total.overloads), len(k.twice.overloads))
"""
LOOP = """
define void @double(ptr noalias %x, ptr noalias %y, i64 %n) {
entry:
  br label %loop
loop:
  %i = phi i64 [ 0, %entry ], [ %next, %loop ]
  %here = getelementptr float, ptr %x, i64 %i
  %there = getelementptr float, ptr %y, i64 %i
  %value = load float, ptr %here
  %twice = fadd float %value, %value
  store float %twice, ptr %there
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %n
  br i1 %more, label %loop, label %done
done:
  ret void
}
"""


def run(code: str, folder: Path) -> list[str]:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")}
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_parts_are_linked_and_kernels_loaded_from_the_cache(tmp_path: Path) -> None:
    (tmp_path / "some_kernels.py").write_text(MODULE)
    # A part has neither an address nor machine code.
    assert run(FIRST, tmp_path) == ["50.0 0", "True False"]
    # From the cache what others link is read only when one of them is compiled, which links the part from there too.
    assert run(SECOND, tmp_path) == ["1 None", "75.0 True", "1 0"]
    # And what is kept of that needs nothing else.
    assert run(THIRD, tmp_path) == ["75.0 0 0"]


class Codegen:
    """As numba's, for a processor with these features."""

    def __init__(self, features: str) -> None:
        self.features, self._tm, self._engine = features, object(), object()

    def _customize_tm_options(self, options: dict[str, str]) -> None:
        options.update(cpu="x86-64-v3", features=self.features)


@pytest.mark.skipif(not llvm.get_process_triple().startswith("x86_64"), reason="asks for features of x86-64")
def test_only_loops_of_512_bits_are_kept_from_being_made() -> None:
    plain, wide = Codegen("+avx2"), Codegen("+avx2,+avx512f,+avx512vl")
    assert linked_code._for_256_bits(plain) is plain
    narrow = linked_code._for_256_bits(wide)
    # LLVM is told for kernels alone, and makes them in the same engine as all else.
    assert narrow._engine is wide._engine
    assert narrow._tm is not wide._tm
    module = llvm.parse_assembly(LOOP)
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = True
    builder = llvm.create_pass_builder(narrow._tm, tuning)
    builder.getModulePassManager().run(module, builder)
    assert "<8 x float>" in str(module)
    assert "<16 x float>" not in str(module)
