"""Compiled functions that are called by their address, so that the caller need not be compiled anew for them."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

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
