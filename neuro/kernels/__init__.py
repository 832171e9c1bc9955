"""Compilation of kernels and keyed random numbers, for all compiled backends."""
