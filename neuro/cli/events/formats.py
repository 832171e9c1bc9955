"""`neuro events formats`."""

from __future__ import annotations


def formats() -> None:
    """List the file formats, and whether they were tried on real recordings."""
    from neuro.core.tables import console, table
    from neuro.events.formats import FORMATS

    rows = [
        (f.name, f.title, " ".join(f.suffixes), "yes" if f.write else "no", f.untested or "on real files")
        for f in FORMATS.values()
    ]
    console().print(table(("format", "title", "endings", "written", "tested"), rows))
