"""Pickling of values for other processes that keeps read-only arrays read-only.

Plain pickling makes every array writable. Kernels are compiled separately for read-only and writable arrays and may
round differently, so that the last bits of a result would depend on the process that computes it.
"""

import functools
import io
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Sealed(Generic[Value]):
    """Holds a value; its pickle, which is made only once, keeps read-only arrays read-only.

    Attributes:
        value: anything that can be pickled.
    """

    value: Value

    def __reduce__(self) -> tuple[Callable[[bytes], "Sealed[Any]"], tuple[bytes]]:
        return _unseal, (self._content,)

    @functools.cached_property
    def _content(self) -> bytes:
        buffer = io.BytesIO()
        _Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL).dump(self.value)
        return buffer.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        if type(obj) is np.ndarray and not obj.flags.writeable:
            return _read_only, (obj.copy(order="K"),)
        return NotImplemented


def _unseal(content: bytes) -> Sealed[Any]:
    return Sealed(pickle.loads(content))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
