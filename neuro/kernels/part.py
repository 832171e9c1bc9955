"""Functions that only other kernels call: lowered once, optimised and made machine code within their callers.

Numba would optimise each one alone, and again in every caller of a caller, and make machine code that nobody runs.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
from __future__ import annotations

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _NoAddress:
    """Where numba puts the Python constants of a function: machine code reads none, as kernels make no objects."""

    @staticmethod
    def set_env(name, environment):
        pass


class _Part(JITCodeLibrary):
    """Code to link into that of others."""

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
