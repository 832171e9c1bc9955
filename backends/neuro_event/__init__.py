"""The float simulator: event-driven, compiled by numba."""

from neuro_event.backend import EventBackend

backend = EventBackend()

__all__ = ["EventBackend", "backend"]
