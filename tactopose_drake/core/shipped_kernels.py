"""Compiled kernels that are shipped with the package's wheels for Linux on x86-64.

They are for any processor of level x86-64-v3 (AVX2 and FMA: Intel's since 2013, AMD's since 2017), for one version of
Python and one of numba. They are used if these match and the source is unchanged, unless numba is configured for a
specific processor. They execute the same instructions on every machine.
"""

import functools
from pathlib import Path
from typing import Any

from llvmlite import binding as llvm
from numba.core import config
from numba.core.caching import IndexDataCacheFile

FOLDER = Path(__file__).parent / "compiled"
# Numba's configuration when it compiles them: the processor's name and further features.
PROCESSOR, FEATURES = "x86-64-v3", ""
_TOLD: Any = config  # from the user's environment; has no types
_NEEDED = ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sahf", "sse4.2", "xsave")


@functools.cache
def are_there() -> bool:
    """Whether compiled kernels were shipped with the package."""
    return FOLDER.is_dir()


@functools.cache
def run_here() -> bool:
    """Whether there are any, and this processor can execute them."""
    if not are_there() or _TOLD.CPU_NAME is not None or _TOLD.CPU_FEATURES is not None or not _TOLD.ENABLE_AVX:
        return False
    return is_level_3()


def is_level_3() -> bool:
    """Whether this processor is of level x86-64-v3."""
    if not llvm.get_process_triple().startswith("x86_64"):
        return False
    features = llvm.get_host_cpu_features()
    return all(features.get(name) for name in _NEEDED)


def shipped_file(filename_base: str, source_stamp: Any) -> IndexDataCacheFile:
    """The shipped file of a kernel, which is empty if its source or numba has changed."""
    return IndexDataCacheFile(str(FOLDER), filename_base, source_stamp)


def shipped_key(key: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    """A key of numba's cache, changed to the processor that the shipped kernels are for."""
    signature, (triple, *_), content = key
    return signature, (triple, PROCESSOR, FEATURES), content
