"""Reading and copying a few bytes at any address, in one instruction each, for kernels that go through packed data.

Nothing is checked here: the caller makes sure that the bytes are its own. Numbers are in the order of the processor,
which is that of the files (little-endian) wherever this runs.
"""

# mypy: ignore-errors
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from neuro.kernels.jit import inner


def _pointer(builder, address, bits):
    return builder.inttoptr(address, ir.IntType(bits).as_pointer())


def _load(bits):
    """A function that gives the number at an address, as int64."""

    @intrinsic
    def load(typing, address):
        def build(context, builder, signature, arguments):
            value = builder.load(_pointer(builder, arguments[0], bits), align=1)
            return builder.zext(value, ir.IntType(64)) if bits < 64 else value

        return types.int64(types.intp), build

    return load


def _copy(bits):
    """A function that copies bytes to one address from another; they are all read before one is written."""

    @intrinsic
    def copy(typing, to, start):
        def build(context, builder, signature, arguments):
            value = builder.load(_pointer(builder, arguments[1], bits), align=1)
            builder.store(value, _pointer(builder, arguments[0], bits), align=1)
            return context.get_dummy_value()

        return types.void(types.intp, types.intp), build

    return copy


load1, load2, load4, load8 = (_load(8 * count) for count in (1, 2, 4, 8))
copy1, copy4, copy8, copy16 = (_copy(8 * count) for count in (1, 4, 8, 16))


@inner
def address(array):
    """The address of the first item, as int64."""
    return np.int64(array.ctypes.data)


@intrinsic
def apart(typing):
    """Compile the function in which this stands by itself, not within its callers, whose fast path it would slow."""

    def build(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), build
