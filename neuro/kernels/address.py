"""Compiled functions that are called by address, so that a compiled caller can call any function of a type.

Arrays are also passed by address, in a table of arrays.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,attr-defined,override,misc"
from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import types
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model
from numpy.typing import NDArray

from neuro.core.errors import ModelError, Where
from neuro.kernels.numba_internals import AttributeTemplate, NumbaError, cgutils, ir, populate_array

Field = tuple[str, str, int]
"""Name, type and number of dimensions of an array."""

_TYPES = {
    **{"i8": "int64", "f8": "float64", "i4": "int32", "i2": "int16", "f4": "float32"},
    **{"u1": "uint8", "u2": "uint16", "u4": "uint32", "u8": "uint64"},
}


def fields_of(text: str) -> list[Field]:
    """Return the fields in a text that has a line for each: name, NumPy's short type, number of dimensions, remarks."""
    columns = [line.split(maxsplit=3) for line in text.strip().splitlines()]
    return [(name, kind, int(ndim)) for name, kind, ndim, *_ in columns]


@dataclass(frozen=True, slots=True)
class Declared:
    """The declaration of an array.

    Attributes:
        name: name of the array in kernels.
        kind: type of the elements, by NumPy's short name.
        shape: a number or the name of a size, for each dimension.
        line: cache line of a page at which the array begins; None for any line.
        life: lifetime of the content, e.g. "run", see `declared`.
        account: heading above the declaration in the text.
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
    """Return the arrays in a text that has a line for each: name, type, shape@cache line, lifetime, remarks.

    Example: `state f8 states,row@4 run` has the sizes `states` and `row`, and begins at cache line 4 of a page.
    """
    arrays, account = [], ""
    for line in text.strip().splitlines():
        name, kind, *columns = line.split(maxsplit=4)
        if name == "#":
            account = kind
            continue
        shape, _, begin = columns[0].partition("@")
        arrays.append(Declared(name, kind, tuple(shape.split(",")), int(begin) if begin else None, columns[1], account))
    return arrays


def table_of(*parts: tuple[Sequence[Field], Mapping[str, NDArray[Any]]]) -> NDArray[np.int64]:
    """Return a table of arrays with a row for each field, in order: address and shape.

    The caller must keep the arrays alive.

    Args:
        parts: fields, and the arrays by the names of the fields.
    """
    return np.array([row_of(field, arrays[field[0]]) for fields, arrays in parts for field in fields], dtype=np.int64)


def row_of(field: Field, array: NDArray[Any]) -> list[int]:
    """Return the row of an array in a table of arrays: address and shape."""
    name, kind, ndim = field
    assert array.dtype == np.dtype(_TYPES[kind]), name
    assert array.ndim == ndim, name
    assert array.flags.c_contiguous, name
    return [array.ctypes.data, *array.shape, *[0] * (3 - ndim)]


class Views(types.Type):
    """Numba type of a table of arrays. A value of this type is the address of the table.

    A kernel only loads the arrays that it names. Most of the compile time was spent when each function loaded all.

    Args:
        name: name of the type.
        first: row of the first field in the table.
        fields: fields of the table, of which each is an attribute in kernels.
    """

    def __init__(self, name, first, fields):
        digest = hashlib.sha256(repr((first, fields)).encode()).hexdigest()[:12]  # other fields give another type
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
    """Generate code for the array of a field. A row never changes while a kernel runs, so one early read is enough."""

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
    """Generate code for the pointer to a table. The first argument of the intrinsic is the table or its address."""
    if isinstance(signature.args[0], types.Integer):
        return builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
    return context.make_array(signature.args[0])(context, builder, arguments[0]).data


def viewer(views):
    """Return a compiled function (table or address) that returns the arrays of a table, for a type `Views`."""

    @intrinsic
    def view(typingctx, table):
        return views(table), pointer

    return view


_KEPT: list[Any] = []
"""Compiled functions called by address. This list keeps their machine code from being freed."""


@dataclass(frozen=True)
class Entry:
    """A kernel that is called by its address.

    Attributes:
        kernel: result of `neuro.kernels.jit.kernel`.
        signature: numba's signature, of integers and floats.
        model: class with the functions that the kernel calls, or None. Its `arithmetic` is the module of the functions.
    """

    kernel: Any
    signature: Any
    model: Any = None

    @property
    def is_compiled(self) -> bool:
        """Return True if the machine code is in memory or on disk."""
        kernel = self.kernel
        return self.signature.args in kernel.overloads or kernel._cache.has(self.signature, kernel.targetctx)

    def address(self) -> int:
        """Return the address of the machine code. The kernel is compiled first, or its code is loaded from disk.

        Raises:
            ModelError: numba cannot compile the model's functions. The message has numba's reason.
        """
        try:
            self.kernel.compile(self.signature)
        except NumbaError as error:
            if self.model is None:
                raise
            raise _refused(self.model, str(error)) from None
        result = self.kernel.overloads[self.signature.args]
        _KEPT.append(result)
        address: int = result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)
        return address


def _refused(model: Any, message: str) -> ModelError:
    """Return an error with numba's reason and the line of the model's file, without the call stack."""
    file = inspect.getfile(model.arithmetic)
    reasons = [line for line in message.splitlines() if line.strip() and not line.startswith("Failed in")]
    function = re.search(r"<function (?:\w+\.)*?(\w+)\.[0-9a-f]{32}", message)
    line = re.search(re.escape(file.rpartition("/")[2]) + r'(?:", line |:| \()(\d+)', message)
    reason = f"{function[1]}: {reasons[0].strip(' -')}" if function else reasons[0].strip(" -")
    return ModelError(
        f"{model.kind} '{model.__name__}' cannot be compiled: {reason}",
        where=Where(file, int(line[1]) if line else 0),
        hint="write its functions with arithmetic on floats, math, and calls of plain functions in the same module",
    )


def caller(result: Any, *arguments: Any) -> Any:
    """Return a compiled function (address, tuple of arguments) that calls the function at an address.

    `result` and `arguments` are numba's types of numbers.
    """

    @intrinsic
    def call(typingctx, address, values_of_call):
        def codegen(context, builder, signature, values):
            kinds = [context.get_value_type(kind) for kind in arguments]
            kind = ir.FunctionType(context.get_value_type(result), kinds)
            triples = zip(cgutils.unpack_tuple(builder, values[1]), signature.args[1], arguments, strict=True)
            passed = [context.cast(builder, value, kind, target) for value, kind, target in triples]
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), passed)

        return result(types.int64, values_of_call), codegen

    return call
