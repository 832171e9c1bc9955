"""Machine instructions that Python lacks, as functions for kernels.

There are operations on eight neighbouring numbers or on 64 marks at once, loads and stores that threads use to publish
their progress, addresses of arrays, and prefetches.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from neuro.kernels.numba_internals import cgutils, ir, populate_array

LANES = 8
"""Number of neighbouring numbers on which an instruction operates."""

_WORD, _BYTE = ir.IntType(64), ir.IntType(8)


def _at(context, builder, kind, array, first, lanes):
    """Generate code for the address of `lanes` neighbouring items of a flat array. Return address and type."""
    items = ir.VectorType(context.get_data_type(kind.dtype), lanes)
    view = context.make_array(kind)(context, builder, array)
    return builder.bitcast(builder.gep(view.data, [first]), items.as_pointer()), items


def load(context, builder, kind, array, first):
    """Generate code that loads eight neighbouring items of a flat array, from item `first` on."""
    place, _ = _at(context, builder, kind, array, first, LANES)
    return _load(builder, place, kind.dtype.bitwidth // 8)


def _load(builder, place, align):
    value = builder.load(place)
    value.align = align
    return value


def _store(builder, value, place, align):
    builder.store(value, place).align = align


def _function(builder, name, result, *arguments):
    return cgutils.get_or_insert_function(builder.module, ir.FunctionType(result, arguments), name)


@intrinsic
def marked(typingctx, bytes_, first):
    """Return 64 bytes from byte `first` on as bits: 1 where a byte is not 0."""

    def codegen(context, builder, signature, arguments):
        place, items = _at(context, builder, signature.args[0], arguments[0], arguments[1], 64)
        is_marked = builder.icmp_unsigned("!=", _load(builder, place, 1), ir.Constant(items, None))
        return builder.bitcast(is_marked, _WORD)

    return types.uint64(bytes_, types.intp), codegen


@intrinsic
def take(typingctx, states, inputs, first):
    """Add eight inputs to eight states, and set the inputs to -0.0, which means no input.

    Return eight bits, 1 where there was an input.
    """

    def codegen(context, builder, signature, arguments):
        state, items = _at(context, builder, signature.args[0], arguments[0], arguments[2], LANES)
        came, _ = _at(context, builder, signature.args[1], arguments[1], arguments[2], LANES)
        words = ir.VectorType(_WORD, LANES)
        none = ir.Constant(words, [1 << 63] * LANES)
        new = _load(builder, came, 8)
        has_input = builder.icmp_unsigned("!=", builder.bitcast(new, words), none)
        _store(builder, builder.fadd(_load(builder, state, 8), new), state, 8)
        _store(builder, builder.bitcast(none, items), came, 8)
        return builder.zext(builder.bitcast(has_input, _BYTE), _WORD)

    return types.uint64(states, inputs, types.intp), codegen


@intrinsic
def lowest(typingctx, word):
    """Return the index of the lowest 1 bit of a word other than 0."""

    def codegen(context, builder, signature, arguments):
        bit = ir.IntType(1)
        return builder.call(_function(builder, "llvm.cttz.i64", _WORD, _WORD, bit), [arguments[0], bit(1)])

    return types.int64(types.uint64), codegen


@intrinsic
def bits_of(typingctx, word):
    """Return the number of 1 bits in a word."""

    def codegen(context, builder, signature, arguments):
        return builder.call(_function(builder, "llvm.ctpop.i64", _WORD, _WORD), [arguments[0]])

    return types.int64(types.uint64), codegen


def _first_of_row(context, builder, kind, array, index):
    view = context.make_array(kind)(context, builder, array)
    return cgutils.get_item_pointer(context, builder, kind, view, [index, context.get_constant(types.intp, 0)])


@intrinsic
def load_acquire(typingctx, array, row):
    """Return the first number of a row of an int64 table.

    Everything that its writer wrote before this number is then visible.
    """

    def codegen(context, builder, signature, arguments):
        index = context.cast(builder, arguments[1], signature.args[1], types.intp)
        return builder.load_atomic(
            _first_of_row(context, builder, signature.args[0], arguments[0], index), "acquire", 8
        )

    return types.int64(array, row), codegen


@intrinsic
def store_release(typingctx, array, row, value):
    """Write the first number of a row of an int64 table. Other threads see the number after all earlier writes."""

    def codegen(context, builder, signature, arguments):
        index = context.cast(builder, arguments[1], signature.args[1], types.intp)
        place = _first_of_row(context, builder, signature.args[0], arguments[0], index)
        number = context.cast(builder, arguments[2], signature.args[2], types.int64)
        assert isinstance(number.type, ir.IntType)
        builder.store_atomic(number, place, "release", 8)
        return context.get_dummy_value()

    return types.void(array, row, value), codegen


@intrinsic
def address(typingctx, array):
    """Return the address of an array."""

    def codegen(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, ir.IntType(64))

    return types.int64(array), codegen


@intrinsic
def moved(typingctx, array, first):
    """Return a view of a flat array whose index `first` is the first item of the array. Lower indices are invalid."""

    def codegen(context, builder, signature, arguments):
        kind, start = signature.args[0], context.cast(builder, arguments[1], signature.args[1], types.intp)
        source = context.make_array(kind)(context, builder, arguments[0])
        view = context.make_array(kind)(context, builder)
        size = builder.add(builder.extract_value(source.shape, 0), start)
        stride = builder.extract_value(source.strides, 0)
        populate_array(
            view,
            data=builder.gep(source.data, [builder.neg(start)]),
            shape=[size],
            strides=[stride],
            itemsize=source.itemsize,
            meminfo=None,
        )
        return view._getvalue()

    return array(array, first), codegen


@intrinsic
def prefetch(typingctx, address):
    """Prefetch the cache line at an address."""

    def codegen(context, builder, signature, arguments):
        pointer = ir.PointerType(ir.IntType(8))
        kind = ir.IntType(32)
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [pointer, kind, kind, kind]), "llvm.prefetch.p0"
        )
        place = builder.inttoptr(arguments[0], pointer)
        builder.call(function, [place, kind(0), kind(3), kind(1)])
        return context.get_dummy_value()

    return types.void(types.int64), codegen
