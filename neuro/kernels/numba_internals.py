"""All private names of numba and llvmlite that this project uses; no other module imports any.

A minor release of numba may rename private names. So `pyproject.toml` excludes versions above the last tested one, and
`missing` returns the names that have disappeared. Modules that take long to import are imported on use, since a start
with all machine code on disk needs none of them.
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
"""What is used of each module, attributes of classes behind a dot."""

OF_KERNELS = ("_cache", "overloads", "py_func", "targetctx", "targetoptions")
"""What is used of a compiled function."""

OF_RESULTS = ("library", "fndesc.llvm_cfunc_wrapper_name", "target_context")
"""What is used of each of its overloads."""


def missing(kernel: Any) -> list[str]:
    """The names of `OF_MODULES`, `OF_KERNELS` and `OF_RESULTS` that the installed versions do not have.

    Args:
        kernel: a compiled function, called at least once.
    """
    parts = [(name, import_module(name), names) for name, names in OF_MODULES.items()]
    parts.append(("Dispatcher", kernel, OF_KERNELS))
    parts += [("CompileResult", result, OF_RESULTS) for result in list(getattr(kernel, "overloads", {}).values())[:1]]
    return [f"{where}.{name}" for where, part, names in parts for name in names if not _has(part, name)]


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
    """NumPy's ziggurat of the normal distribution: fi, ki and wi of each level, the tail's begin and its inverse."""
    from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

    return fi_double, ki_double, wi_double, ziggurat_nor_r, ziggurat_nor_inv_r


STRICT_BOUNDS = 2
"""What numba's own check, 1, is not: part of the key under which kernels are kept."""


def check_bounds() -> None:
    """Compile with checks from now on: an index beyond an array's end, or below 0, raises IndexError.

    Call it before any kernel compiles; kernels are several times slower then. Numba's own check lets -1 stand for the
    last item; no kernel here means that.
    """
    from numba.np import arrayobj

    config: Any = numba.config
    config.BOUNDSCHECK = STRICT_BOUNDS
    arrayobj.fix_integer_index = _as_it_is


def _as_it_is(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
    """The index as a signed word, whatever the size of the array; huge unsigned ones are below 0, too."""
    return context.cast(builder, index, kind, types.intp)


class _NoAddress:
    """Numba's place for the Python constants of a function; kernels make no objects, so machine code reads none."""

    @staticmethod
    def set_env(name, environment):
        pass


class _Part(JITCodeLibrary):
    """Code to link into that of others.

    Numba would optimise each function alone, and again in every caller of a caller, and make machine code that nobody
    runs. A function that only kernels call is lowered once, and optimised within its callers; with arrays of the table
    made where they are named, that saves two thirds of the time of compiling.
    """

    codegen = _NoAddress

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name):
        """None: it is not called from outside."""
        self._ensure_finalized()
        return 0


class PartCompiler(Compiler):
    """Numba's compiler with another kind of library at its end."""

    def __init__(self, typing, target, library, *rest):
        super().__init__(typing, target, _Part(target.codegen(), "part") if library is None else library, *rest)
