"""Runs that were written to a file: `read` gives what a simulation gives, by the same calls."""

from __future__ import annotations

from neuro.files.results import Results, Trace, Train, Weights, read

__all__ = ["Results", "Trace", "Train", "Weights", "read"]
