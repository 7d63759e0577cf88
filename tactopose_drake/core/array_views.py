"""The type that kernels' arrays have in compiled code: where the numbers are, and how many along each axis.

Numba's own arrays hold strides, counts and references to an owner besides, which are counted at each use; compiled code
of small loops over many arrays is mostly that. A view counts nothing: whoever calls a kernel holds the array meanwhile.
Views are contiguous in C's order. They behave as arrays do, negative indices included, but are never returned.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.boxing import unbox_tuple
from numba.core.datamodel.models import StructModel, TupleModel
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.extending import NativeValue, lower_builtin, lower_cast, lower_getattr, register_model, unbox


class View(types.Array):
    """Numbers of one type along some axes, which may be written or not."""

    def __init__(self, dtype: types.Type, dimensions: int, readonly: bool) -> None:
        name = f"{'readonly ' if readonly else ''}view({dtype}, {dimensions}d)"
        super().__init__(dtype, dimensions, "C", readonly=readonly, name=name)

    def copy(self, dtype: Any = None, ndim: Any = None, layout: Any = None, readonly: Any = None) -> types.Array:
        """The type of what comes of it by indexing; one of numba's where that is not contiguous."""
        dtype, ndim = dtype or self.dtype, self.ndim if ndim is None else ndim
        readonly = not self.mutable if readonly is None else readonly
        if layout in (None, "C"):
            return View(dtype, ndim, readonly)
        return types.Array(dtype, ndim, layout, readonly=readonly)

    def unify(self, typingctx: Any, other: Any) -> types.Array | None:
        """The type of what is either of two."""
        if isinstance(other, types.Array) and (other.ndim, other.dtype, other.layout) == (self.ndim, self.dtype, "C"):
            return View(self.dtype, self.ndim, not (self.mutable and other.mutable))
        return None

    @property
    def iterator_type(self) -> types.Type:
        """What runs along the first axis: numba's."""
        return types.ArrayIterator(self.owned)

    @property
    def owned(self) -> types.Array:
        """Numba's type of the same array."""
        return types.Array(self.dtype, self.ndim, "C", readonly=not self.mutable)


class Fields(types.NamedTuple):
    """A named tuple of numbers and views."""

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """From a named tuple of the same class whose fields become these."""
        if not isinstance(other, types.BaseNamedTuple) or other.instance_class is not self.instance_class:
            return None
        each = [typingctx.can_convert(had, wanted) for had, wanted in zip(other, self, strict=True)]
        return None if None in each else max(Conversion.safe, *each)


def named_tuple(kinds: list[types.Type], python_class: type) -> types.BaseNamedTuple:
    """The type of a named tuple in compiled code."""
    if any(isinstance(kind, View | Fields) for kind in kinds):
        return Fields(kinds, python_class)
    return types.BaseTuple.from_types(kinds, python_class)


def borrowed(kind: types.Type) -> types.Type:
    """What an argument of this type becomes in the function that is called."""
    if isinstance(kind, types.Array) and kind.layout == "C":
        return View(kind.dtype, kind.ndim, not kind.mutable)
    if isinstance(kind, types.BaseNamedTuple):
        return named_tuple([borrowed(each) for each in kind], kind.instance_class)
    return kind


@register_model(View)
class _ViewModel(StructModel):
    def __init__(self, dmm: Any, fe_type: View) -> None:
        members = [("data", types.CPointer(fe_type.dtype)), ("shape", types.UniTuple(types.intp, fe_type.ndim))]
        super().__init__(dmm, fe_type, members)

    def traverse(self, builder: Any) -> list[Any]:
        """Nothing in it has references that are counted."""
        return []


@register_model(Fields)
class _FieldsModel(TupleModel):
    def traverse(self, builder: Any) -> list[Any]:
        """As of a view."""
        return []


def _make(context: Any, builder: Any, kind: View, data: Any, shape: list[Any]) -> Any:
    value = builder.insert_value(ir.Constant(context.get_value_type(kind), ir.Undefined), data, 0)
    for axis, length in enumerate(shape):
        value = builder.insert_value(value, length, [1, axis])
    return value


def _index(builder: Any, kind: types.Type, index: Any, view: Any, axis: int) -> Any:
    """An index as an offset, counted from the end if it is negative."""
    if isinstance(kind, types.IntegerLiteral) and kind.literal_value >= 0:
        return ir.Constant(cgutils.intp_t, kind.literal_value)
    if index.type.width < cgutils.intp_t.width:
        index = (builder.sext if kind.signed else builder.zext)(index, cgutils.intp_t)
    if not kind.signed:
        return index
    from_end = builder.add(index, builder.extract_value(view, [1, axis]))
    return builder.select(builder.icmp_signed("<", index, index.type(0)), from_end, index)


def _pointer(builder: Any, view: Any, kinds: list[Any], indices: list[Any], dimensions: int) -> Any:
    """Where an element is, or the first of what the indices leave open."""
    offset = _index(builder, kinds[0], indices[0], view, 0)
    for axis in range(1, dimensions):
        offset = builder.mul(offset, builder.extract_value(view, [1, axis]), flags=["nsw"])
        if axis < len(indices):
            offset = builder.add(offset, _index(builder, kinds[axis], indices[axis], view, axis), flags=["nsw"])
    return builder.gep(builder.extract_value(view, 0), [offset], inbounds=True)


def _indices(builder: Any, kind: types.Type, index: Any) -> tuple[list[Any], list[Any]]:
    if isinstance(kind, types.BaseTuple):
        return list(kind), cgutils.unpack_tuple(builder, index, len(kind))
    return [kind], [index]


@lower_builtin(operator.getitem, View, types.Integer)
@lower_builtin(operator.getitem, View, types.SliceType)
@lower_builtin(operator.getitem, View, types.BaseTuple)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, index_type = sig.args
    view, index = args
    kinds, indices = _indices(builder, index_type, index)
    if not all(isinstance(each, types.Integer) for each in kinds):
        array = context.cast(builder, view, kind, kind.owned)
        found = kind.owned.copy(ndim=sig.return_type.ndim, layout=sig.return_type.layout)
        inner = signature(found, kind.owned, index_type)
        value = context.get_function(operator.getitem, inner)(builder, (array, index))
        return context.cast(builder, value, found, sig.return_type)
    pointer = _pointer(builder, view, kinds, indices, kind.ndim)
    if len(indices) == kind.ndim:
        return context.unpack_value(builder, kind.dtype, pointer)
    rest = [builder.extract_value(view, [1, axis]) for axis in range(len(indices), kind.ndim)]
    return _make(context, builder, sig.return_type, pointer, rest)


@lower_builtin(operator.setitem, View, types.Any, types.Any)
def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, index_type, value_type = sig.args
    view, index, value = args
    kinds, indices = _indices(builder, index_type, index)
    if len(indices) < kind.ndim or not all(isinstance(each, types.Integer) for each in kinds):
        array = context.cast(builder, view, kind, kind.owned)
        if isinstance(value_type, View):
            value, value_type = context.cast(builder, value, value_type, value_type.owned), value_type.owned
        inner = signature(types.none, kind.owned, index_type, value_type)
        return context.get_function(operator.setitem, inner)(builder, (array, index, value))
    pointer = _pointer(builder, view, kinds, indices, kind.ndim)
    context.pack_value(builder, kind.dtype, context.cast(builder, value, value_type, kind.dtype), pointer)
    return context.get_dummy_value()


@lower_getattr(View, "shape")
def _shape(context: Any, builder: Any, kind: View, view: Any) -> Any:
    return builder.extract_value(view, 1)


@lower_getattr(View, "size")
def _size(context: Any, builder: Any, kind: View, view: Any) -> Any:
    return _count(builder, kind, view)


def _count(builder: Any, kind: View, view: Any) -> Any:
    count = builder.extract_value(view, [1, 0])
    for axis in range(1, kind.ndim):
        count = builder.mul(count, builder.extract_value(view, [1, axis]))
    return count


@lower_builtin(len, View)
def _len(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.extract_value(args[0], [1, 0])


@lower_builtin("getiter", View)
def _iterate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    (kind,), (view,) = sig.args, args
    iterate = context.get_function("getiter", signature(sig.return_type, kind.owned))
    return iterate(builder, (context.cast(builder, view, kind, kind.owned),))


@lower_builtin("array.reshape", View, types.Integer)
def _flatten(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """All numbers in a row: the only other shape that kernels take."""
    (kind, _), (view, _) = sig.args, args
    return _make(context, builder, sig.return_type, builder.extract_value(view, 0), [_count(builder, kind, view)])


@lower_cast(View, View)
def _same(context: Any, builder: Any, fromty: View, toty: View, value: Any) -> Any:
    return value


@lower_cast(types.Array, View)
def _borrow(context: Any, builder: Any, fromty: types.Array, toty: View, value: Any) -> Any:
    array = context.make_array(fromty)(context, builder, value)
    return _make(context, builder, toty, array.data, cgutils.unpack_tuple(builder, array.shape, toty.ndim))


@lower_cast(View, types.Array)
def _lend(context: Any, builder: Any, fromty: View, toty: types.Array, value: Any) -> Any:
    """As one of numba's arrays, without an owner."""
    from numba.np.arrayobj import populate_array

    array = context.make_array(toty)(context, builder)
    itemsize = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(fromty.dtype)))
    shape = [builder.extract_value(value, [1, axis]) for axis in range(fromty.ndim)]
    strides = [itemsize]
    for length in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.extract_value(value, 0)
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=itemsize, meminfo=None, parent=None)
    return array._getvalue()


@lower_cast(types.BaseNamedTuple, Fields)
def _borrow_fields(context: Any, builder: Any, fromty: Any, toty: Fields, value: Any) -> Any:
    had = cgutils.unpack_tuple(builder, value, len(fromty))
    each = [context.cast(builder, *field) for field in zip(had, fromty, toty, strict=True)]
    return context.make_tuple(builder, toty, each)


unbox(Fields)(unbox_tuple)


@unbox(View)
def _unbox(kind: View, obj: Any, c: Any) -> NativeValue:
    native = c.unbox(kind.owned, obj)
    value = c.context.cast(c.builder, native.value, kind.owned, kind)
    release = lambda: c.context.nrt.decref(c.builder, kind.owned, native.value)  # noqa: E731
    return NativeValue(value, is_error=native.is_error, cleanup=release)
