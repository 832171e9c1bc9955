"""Compiled functions that are called by their address, so that the caller need not be compiled anew for them."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import re
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from neuro.core.errors import ModelError, Where

_KEPT: list[Any] = []
"""Whose machine code is called by address stays for good."""


def address_of(kernel: Any, signature: Any) -> int:
    """Compile a kernel for some types, numbers only, or take it from what is kept; and tell where it lies.

    Args:
        kernel: of `neuro.kernels.jit.kernel`.
        signature: numba's, of integers and floats.
    """
    kernel.compile(signature)
    result = kernel.overloads[signature.args]
    _KEPT.append(result)
    address: int = result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)
    return address


def entry_of(model: Any, kernel: Any, signature: Any) -> int:
    """The address of a kernel that calls the functions of a stranger's model.

    Args:
        model: its class, which has an `arithmetic`.
        kernel: see `address_of`.
        signature: likewise.

    Raises:
        ModelError: numba cannot compile them; it says why, and where if numba does.
    """
    try:
        return address_of(kernel, signature)
    except NumbaError as error:
        raise _refused(model, str(error)) from None


def _refused(model: Any, said: str) -> ModelError:
    """What numba says of a model, without the way by which it came there."""
    file = str(model.arithmetic.__file__)
    reasons = [line for line in said.splitlines() if line.strip() and not line.startswith("Failed in")]
    function = re.search(r"<function (\w+)\.", said)
    line = re.search(re.escape(file.rpartition("/")[2]) + r'(?:", line |:| \()(\d+)', said)
    why = f"{function[1]}: {reasons[0].strip(' -')}" if function else reasons[0].strip(" -")
    return ModelError(
        f"{model.kind} '{model.__name__}' cannot be compiled: {why}",
        where=Where(file, int(line[1]) if line else 0),
        hint="its functions have arithmetic on floats and math, and call plain functions of their module's names",
    )


def caller(result: Any, *arguments: Any) -> Any:
    """A compiled function (address, tuple of arguments) that calls what lies there; all types are of numbers."""

    @intrinsic
    def call(typingctx, address, given):
        def codegen(context, builder, signature, values):
            kinds = [context.get_value_type(kind) for kind in arguments]
            kind = ir.FunctionType(context.get_value_type(result), kinds)
            found = zip(cgutils.unpack_tuple(builder, values[1]), signature.args[1], arguments, strict=True)
            told = [context.cast(builder, value, is_a, wanted) for value, is_a, wanted in found]
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), told)

        return result(types.int64, given), codegen

    return call
