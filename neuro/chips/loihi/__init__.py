"""Loihi 1's arithmetic: registers, weight words, and rules of its learning engine."""
