"""The meaning of kernels' argument annotations: arrays by element type, dimensions and access; scalars; and tuples."""

import typing
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numba.core import types
from numpy.typing import NDArray


class _Array(NamedTuple):
    """The properties of an array annotation beyond its type in Python."""

    dtype: types.Number
    dimensions: int
    written: bool

    def type(self) -> types.Array:
        return types.Array(self.dtype, self.dimensions, "C", readonly=not self.written)


_Doubles: TypeAlias = NDArray[np.float64]
_Singles: TypeAlias = NDArray[np.float32]
_Longs: TypeAlias = NDArray[np.int64]

# Arrays that a kernel reads, by element type and number of dimensions ...
Floats1: TypeAlias = Annotated[_Doubles, _Array(types.float64, 1, False)]
Floats2: TypeAlias = Annotated[_Doubles, _Array(types.float64, 2, False)]
Floats3: TypeAlias = Annotated[_Doubles, _Array(types.float64, 3, False)]
Floats4: TypeAlias = Annotated[_Doubles, _Array(types.float64, 4, False)]
Singles1: TypeAlias = Annotated[_Singles, _Array(types.float32, 1, False)]
Singles2: TypeAlias = Annotated[_Singles, _Array(types.float32, 2, False)]
Singles3: TypeAlias = Annotated[_Singles, _Array(types.float32, 3, False)]
Singles4: TypeAlias = Annotated[_Singles, _Array(types.float32, 4, False)]
Longs1: TypeAlias = Annotated[_Longs, _Array(types.int64, 1, False)]
Longs2: TypeAlias = Annotated[_Longs, _Array(types.int64, 2, False)]
Ints1: TypeAlias = Annotated[NDArray[np.int32], _Array(types.int32, 1, False)]
Ints2: TypeAlias = Annotated[NDArray[np.int32], _Array(types.int32, 2, False)]
Ints3: TypeAlias = Annotated[NDArray[np.int32], _Array(types.int32, 3, False)]
Shorts2: TypeAlias = Annotated[NDArray[np.int16], _Array(types.int16, 2, False)]
Shorts3: TypeAlias = Annotated[NDArray[np.int16], _Array(types.int16, 3, False)]
UnsignedShorts1: TypeAlias = Annotated[NDArray[np.uint16], _Array(types.uint16, 1, False)]
UnsignedLongs1: TypeAlias = Annotated[NDArray[np.uint64], _Array(types.uint64, 1, False)]
UnsignedBytes2: TypeAlias = Annotated[NDArray[np.uint8], _Array(types.uint8, 2, False)]
Flags1: TypeAlias = Annotated[NDArray[np.bool_], _Array(types.boolean, 1, False)]
# ... and those that it writes.
OutFloats1: TypeAlias = Annotated[_Doubles, _Array(types.float64, 1, True)]
OutFloats2: TypeAlias = Annotated[_Doubles, _Array(types.float64, 2, True)]
OutFloats3: TypeAlias = Annotated[_Doubles, _Array(types.float64, 3, True)]
OutFloats4: TypeAlias = Annotated[_Doubles, _Array(types.float64, 4, True)]
OutSingles1: TypeAlias = Annotated[_Singles, _Array(types.float32, 1, True)]
OutSingles2: TypeAlias = Annotated[_Singles, _Array(types.float32, 2, True)]
OutSingles4: TypeAlias = Annotated[_Singles, _Array(types.float32, 4, True)]
OutLongs1: TypeAlias = Annotated[_Longs, _Array(types.int64, 1, True)]
OutLongs2: TypeAlias = Annotated[_Longs, _Array(types.int64, 2, True)]
OutInts1: TypeAlias = Annotated[NDArray[np.int32], _Array(types.int32, 1, True)]
OutInts3: TypeAlias = Annotated[NDArray[np.int32], _Array(types.int32, 3, True)]
OutShorts2: TypeAlias = Annotated[NDArray[np.int16], _Array(types.int16, 2, True)]
OutUnsignedBytes2: TypeAlias = Annotated[NDArray[np.uint8], _Array(types.uint8, 2, True)]
OutFlags1: TypeAlias = Annotated[NDArray[np.bool_], _Array(types.boolean, 1, True)]
OutFlags2: TypeAlias = Annotated[NDArray[np.bool_], _Array(types.boolean, 2, True)]
# Small fixed-size tuples.
Triple: TypeAlias = tuple[float, float, float]
Shape3: TypeAlias = tuple[int, int, int]
# An unsigned integer: an index offset needs no check of its sign.
Unsigned: TypeAlias = Annotated[int, types.uint64]


def numba_type(annotation: Any) -> types.Type:
    """The numba type that an annotation stands for.

    Raises:
        TypeError: an annotation without a numba type.
    """
    for said in getattr(annotation, "__metadata__", ()):
        if isinstance(said, _Array):
            return said.type()
        if isinstance(said, types.Type):
            return said
    plain = {float: types.float64, int: types.int64, bool: types.boolean}
    if annotation in plain:
        return plain[annotation]
    if typing.get_origin(annotation) is tuple:
        return types.Tuple([numba_type(item) for item in typing.get_args(annotation)])
    if is_named_tuple(annotation):
        hints = typing.get_type_hints(annotation, include_extras=True)
        return types.BaseTuple.from_types([numba_type(hints[name]) for name in annotation._fields], annotation)
    raise TypeError(f"{annotation} must stand for the type of a kernel's argument.")


def is_named_tuple(annotation: Any) -> bool:
    """Whether an annotation is a class of named tuples."""
    return isinstance(annotation, type) and issubclass(annotation, tuple) and hasattr(annotation, "_fields")
