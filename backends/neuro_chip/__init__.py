"""Emulated chips: the arithmetic of Loihi 1 and SpiNNaker in integers, compiled."""

from neuro_chip.backend import loihi, spinnaker

__all__ = ["loihi", "spinnaker"]
