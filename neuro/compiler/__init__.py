"""The compiler from a `Network` to a `Program`: check, then resolve."""

from neuro.compiler.resolve import compile_network

__all__ = ["compile_network"]
