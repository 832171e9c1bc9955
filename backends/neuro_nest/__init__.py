"""The backend `nest`: networks run in NEST itself, whose models ours follow. So it is the judge of the other backends.

NEST is imported when a network is built, not before: that takes a second. It is GPL and optional.
"""

from neuro_nest.backend import NestBackend

backend = NestBackend()
__all__ = ["backend"]
