"""`neuro backends`."""

from __future__ import annotations


def backends() -> None:
    """List what networks can run on."""
    from neuro.core.tables import console, table
    from neuro.program.backend import installed

    rows = [(name, backend.description) for name, backend in installed().items()]
    console().print(table(("backend", "what it is"), rows))
