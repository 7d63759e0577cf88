"""What the package's kernels are made of: parts without machine code, and code that is read when somebody links it."""

import os
import subprocess
import sys
from pathlib import Path

MODULE = """
from tactopose_drake.core.compilation import Floats1, inlined, kernel, part

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
