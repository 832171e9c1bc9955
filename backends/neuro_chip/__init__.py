"""Emulated chips: the arithmetic of Loihi 1, Loihi 2 and SpiNNaker in integers, compiled."""

from neuro_chip.backend import loihi, loihi2, spinnaker

__all__ = ["loihi", "loihi2", "spinnaker"]
