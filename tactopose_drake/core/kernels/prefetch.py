"""Prefetching: tells the processor early what will be read, so that transfers from memory overlap.

A distance grid is larger than a processor's cache. Contacts that are looked up one after the other each wait for the
memory; prefetched, they wait together.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

# Arguments of the instruction: for reading, to be kept in all cache levels, data rather than code.
_READ, _KEEP, _DATA = 0, 3, 1


def _prefetch(context: Any, array: Any, index: Any) -> Any:
    """Prefetches the cache line of a flat array's item, from compiled code; see llvm.prefetch in LLVM's manual."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        byte = ir.IntType(8).as_pointer()
        numbers = [ir.IntType(32)(number) for number in (_READ, _KEEP, _DATA)]
        kind = ir.FunctionType(ir.VoidType(), [byte, *(number.type for number in numbers)])
        instruction = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")  # type: ignore[no-untyped-call]
        builder.call(instruction, [builder.bitcast(builder.gep(data, [arguments[1]]), byte), *numbers])
        return context.get_dummy_value()

    return types.void(array, index), generate


prefetch: Any = intrinsic(_prefetch)
