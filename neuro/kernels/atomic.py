"""Numbers by which threads tell each other how far they are."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def _place(context, builder, kind, array, index):
    view = context.make_array(kind)(context, builder, array)
    return cgutils.get_item_pointer(context, builder, kind, view, [index, context.get_constant(types.intp, 0)])


@intrinsic
def look(typingctx, array, row):
    """The first number of a row of a table of int64; whatever its writer did before is seen, too."""

    def codegen(context, builder, signature, arguments):
        index = context.cast(builder, arguments[1], signature.args[1], types.intp)
        return builder.load_atomic(_place(context, builder, signature.args[0], arguments[0], index), "acquire", 8)

    return types.int64(array, row), codegen


@intrinsic
def tell(typingctx, array, row, value):
    """Write the first number of a row for other threads, after all that was done before."""

    def codegen(context, builder, signature, arguments):
        index = context.cast(builder, arguments[1], signature.args[1], types.intp)
        place = _place(context, builder, signature.args[0], arguments[0], index)
        number = context.cast(builder, arguments[2], signature.args[2], types.int64)
        assert isinstance(number.type, ir.IntType)
        builder.store_atomic(number, place, "release", 8)
        return context.get_dummy_value()

    return types.void(array, row, value), codegen
