"""All private names of numba and llvmlite that this project uses. No other module imports such names.

A minor release of numba may rename private names. So `pyproject.toml` excludes versions above the last tested one, and
`missing` returns the names that have disappeared. Modules that take long to import are imported on use, because a
run with all machine code on disk needs none of them.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from importlib import import_module
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.core.extending import _Intrinsic as Intrinsic
from numba.core.serialize import dumps
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global

__all__ = [
    "AbstractTemplate",
    "AttributeTemplate",
    "CompileResult",
    "Dispatcher",
    "Intrinsic",
    "NumbaError",
    "PartCompiler",
    "cgutils",
    "check_bounds",
    "dumps",
    "infer_global",
    "ir",
    "missing",
    "normal_tables",
    "populate_array",
]

OF_MODULES = {
    "llvmlite.ir": ("IRBuilder.load_atomic", "IRBuilder.store_atomic", "VectorType", "Constant"),
    "numba.core.cgutils": ("get_item_pointer", "get_or_insert_function", "unpack_tuple"),
    "numba.core.codegen": (
        "JITCodeLibrary._optimize_final_module",
        "JITCodeLibrary._finalize_final_module",
        "JITCodeLibrary._finalize_dynamic_globals",
        "JITCodeLibrary._ensure_finalized",
        "JITCodeLibrary.get_pointer_to_function",
    ),
    "numba.core.compiler": ("Compiler", "CompileResult._rebuild", "CompileResult._reduce"),
    "numba.core.dispatcher": ("Dispatcher.compile",),
    "numba.core.errors": ("NumbaError",),
    "numba.core.extending": ("_Intrinsic",),
    "numba.core.serialize": ("dumps",),
    "numba.core.typing.templates": ("AbstractTemplate", "AttributeTemplate", "infer_global"),
    "numba.np.arrayobj": ("fix_integer_index", "populate_array"),
    "numba.np.random._constants": (
        "fi_double",
        "ki_double",
        "wi_double",
        "ziggurat_nor_inv_r",
        "ziggurat_nor_r",
    ),
}
"""Names that are used of each module. An attribute of a class follows a dot."""

OF_KERNELS = ("_cache", "overloads", "py_func", "targetctx", "targetoptions")
"""Attributes that are used of a compiled function."""

OF_RESULTS = ("library", "fndesc.llvm_cfunc_wrapper_name", "target_context")
"""Attributes that are used of each overload of a compiled function."""


def missing(kernel: Any) -> list[str]:
    """Return the names of `OF_MODULES`, `OF_KERNELS` and `OF_RESULTS` that the installed versions lack.

    Args:
        kernel: a compiled function, called at least once.
    """
    parts = [(name, import_module(name), names) for name, names in OF_MODULES.items()]
    parts.append(("Dispatcher", kernel, OF_KERNELS))
    parts += [("CompileResult", result, OF_RESULTS) for result in list(getattr(kernel, "overloads", {}).values())[:1]]
    return [f"{module}.{name}" for module, part, names in parts for name in names if not _has(part, name)]


def _has(part: Any, path: str) -> bool:
    for name in path.split("."):
        if not hasattr(part, name):
            return False
        part = getattr(part, name)
    return True


def populate_array(array: Any, **parts: Any) -> None:
    """Fill the fields of an array in the code of an intrinsic."""
    from numba.np import arrayobj

    arrayobj.populate_array(array, **parts)


def normal_tables() -> tuple[Any, ...]:
    """Return NumPy's ziggurat tables of the normal distribution: fi, ki, wi, the start of the tail, and 1 / start."""
    from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

    return fi_double, ki_double, wi_double, ziggurat_nor_r, ziggurat_nor_inv_r


STRICT_BOUNDS = 2
"""Value of numba's BOUNDSCHECK for `check_bounds`, different from 1 for numba's own check.

Names of cached machine code depend on the value.
"""


def check_bounds() -> None:
    """Compile kernels with checks from now on: an index below 0 or beyond an array's end raises IndexError.

    Call this function before any kernel is compiled. Checked kernels are several times slower. Numba's own check
    accepts -1 as the last item, but no kernel uses -1 in this sense.
    """
    from numba.np import arrayobj

    config: Any = numba.config
    config.BOUNDSCHECK = STRICT_BOUNDS
    arrayobj.fix_integer_index = _as_it_is


def _as_it_is(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
    """Return an index as a signed word, without numba's wrap-around. Huge unsigned indices become negative."""
    return context.cast(builder, index, kind, types.intp)


class _NoAddress:
    """Replacement of numba's address of a function's Python constants. Kernels never read the constants."""

    @staticmethod
    def set_env(name, environment):
        pass


class _Part(JITCodeLibrary):
    """Code that is only linked into the code of callers.

    Numba would optimise each function alone and again in each direct and indirect caller, and generate machine code
    that never runs. Here a function that only kernels call is lowered once, and optimised within its callers. Together
    with `neuro.kernels.address.Views` this saves two thirds of the compile time.
    """

    codegen = _NoAddress

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """Return 0, because the function is never called from outside."""
        self._ensure_finalized()
        return 0


class PartCompiler(Compiler):
    """Numba's compiler with `_Part` as the library of its result."""

    def __init__(self, typing, target, library, *rest):
        super().__init__(typing, target, _Part(target.codegen(), "part") if library is None else library, *rest)
