"""Compiled kernels: one step after the other, on arrays alone."""
