"""How kernels see many arrays: as one table of addresses and shapes.

A kernel that takes seventy arrays spends more time on receiving them, and on counting references to them, than
on a small network. So the engine passes one integer table, and each function makes the views that it needs.
The engine keeps the arrays alive.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,attr-defined,override,misc"
from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import types
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model
from numpy.typing import NDArray

from neuro.kernels.numba_internals import AttributeTemplate, ir, populate_array

Field = tuple[str, str, int]
"""Name, type and number of dimensions of an array."""

_TYPES = {
    **{"i8": "int64", "f8": "float64", "i4": "int32", "i2": "int16", "f4": "float32"},
    **{"u1": "uint8", "u2": "uint16", "u4": "uint32", "u8": "uint64"},
}


def fields_of(text: str) -> list[Field]:
    """The fields that a text lists, one a line: name, type as in NumPy's short names, dimensions, remarks."""
    words = [line.split(maxsplit=3) for line in text.strip().splitlines()]
    return [(name, kind, int(ndim)) for name, kind, ndim, *_ in words]


@dataclass(frozen=True, slots=True)
class Declared:
    """An array as a text declares it.

    Attributes:
        name: by which kernels see it.
        kind: its type, as in NumPy's short names.
        shape: a number or the name of a size for each dimension.
        line: the cache line of its page at which it begins, None where that does not matter.
        life: how long what it holds lives, in the words of the text.
        account: the heading above it.
    """

    name: str
    kind: str
    shape: tuple[str, ...]
    line: int | None
    life: str
    account: str

    @property
    def field(self) -> Field:
        """Name, type and number of dimensions."""
        return self.name, self.kind, len(self.shape)


def declared(text: str) -> list[Declared]:
    """The arrays that a text declares, one a line: name, type, shape and after @ its line, life, remarks.

    `state f8 states,row@4 run` has the sizes `states` and `row`, and begins at the fourth cache line of a page.
    """
    arrays, account = [], ""
    for line in text.strip().splitlines():
        name, kind, *words = line.split(maxsplit=4)
        if name == "#":
            account = kind
            continue
        shape, _, begin = words[0].partition("@")
        arrays.append(Declared(name, kind, tuple(shape.split(",")), int(begin) if begin else None, words[1], account))
    return arrays


def table_of(*parts: tuple[Sequence[Field], Mapping[str, NDArray[Any]]]) -> NDArray[np.int64]:
    """The table for some arrays by name, of each list of fields in turn. The caller keeps the arrays alive."""
    return np.array([row_of(field, arrays[field[0]]) for fields, arrays in parts for field in fields], dtype=np.int64)


def row_of(field: Field, array: NDArray[Any]) -> list[int]:
    """The row of a table for an array: its address and its shape."""
    name, kind, ndim = field
    assert array.dtype == np.dtype(_TYPES[kind]), name
    assert array.ndim == ndim, name
    assert array.flags.c_contiguous, name
    return [array.ctypes.data, *array.shape, *[0] * (3 - ndim)]


class Views(types.Type):
    """All arrays of one table, from row `first` on: the address of the table. An array is made where it is named.

    Making all of them in every function took most of the time of compiling.
    """

    def __init__(self, name, first, fields):
        digest = hashlib.sha256(repr((first, fields)).encode()).hexdigest()[:12]  # other fields are another type
        super().__init__(f"{name} {digest}")
        self.rows = {field: first + k for k, (field, _, _) in enumerate(fields)}
        self.arrays = {field: types.Array(getattr(types, _TYPES[kind]), ndim, "C") for field, kind, ndim in fields}


@register_model(Views)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.IntType(64).as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Views

    def generic_resolve(self, views, name):
        return views.arrays.get(name)


@lower_getattr_generic(Views)
def _array(context, builder, views, table, name):
    """The array of a field. Its row never changes while a kernel runs, so it may be read once and early."""

    def entry(column):
        word = builder.load(builder.gep(table, [context.get_constant(types.intp, 4 * views.rows[name] + column)]))
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    array = views.arrays[name]
    view = context.make_array(array)(context, builder)
    data = builder.inttoptr(entry(0), context.get_data_type(array.dtype).as_pointer())
    shape = [entry(1 + d) for d in range(array.ndim)]
    size = context.get_constant(types.intp, array.dtype.bitwidth // 8)
    strides = [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    populate_array(view, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return view._getvalue()


def pointer(context, builder, signature, arguments):
    """What an intrinsic that makes `Views` of its first argument, a table or its address, generates."""
    if isinstance(signature.args[0], types.Integer):
        return builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
    return context.make_array(signature.args[0])(context, builder, arguments[0]).data


def viewer(views):
    """A compiled function from a table to its arrays."""

    @intrinsic
    def view(typingctx, table):
        return views(table), pointer

    return view
