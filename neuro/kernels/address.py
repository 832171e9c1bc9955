"""Compiled functions that are called by their address, so that the caller need not be compiled anew for them."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import inspect
import re
from dataclasses import dataclass
from typing import Any

from numba import types
from numba.extending import intrinsic

from neuro.core.errors import ModelError, Where
from neuro.kernels.numba_internals import NumbaError, cgutils, ir

_KEPT: list[Any] = []
"""Whose machine code is called by address stays for good."""


@dataclass(frozen=True)
class Entry:
    """A kernel that is called by its address.

    Attributes:
        kernel: of `neuro.kernels.jit.kernel`.
        signature: numba's, of integers and floats.
        model: the class of which it calls the functions, if it does; its `arithmetic` is their module.
    """

    kernel: Any
    signature: Any
    model: Any = None

    @property
    def kept(self) -> bool:
        """Whether its machine code need not be compiled: it is there, or on disk."""
        kernel = self.kernel
        return self.signature.args in kernel.overloads or kernel._cache.has(self.signature, kernel.targetctx)

    def address(self) -> int:
        """Where its machine code lies, which is compiled or taken from what is kept.

        Raises:
            ModelError: numba cannot compile the model's functions; it says why, and where if numba does.
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


def _refused(model: Any, said: str) -> ModelError:
    """What numba says of a model, without the way by which it came there."""
    file = inspect.getfile(model.arithmetic)
    reasons = [line for line in said.splitlines() if line.strip() and not line.startswith("Failed in")]
    function = re.search(r"<function (?:\w+\.)*?(\w+)\.[0-9a-f]{32}", said)
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
            passed = [context.cast(builder, value, is_a, wanted) for value, is_a, wanted in found]
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), passed)

        return result(types.int64, given), codegen

    return call
