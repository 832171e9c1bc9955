"""Tables as all that prints in a terminal shows them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any


def console() -> Any:
    """Standard output; wide enough for tables when it is not a terminal."""
    from rich.console import Console

    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=120)


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], title: str = "") -> Any:
    """A table; columns whose name begins with ">" are numbers, set to the right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    out = Table(box=box.SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", pad_edge=False)
    for name in columns:
        out.add_column(Text(name.lstrip(">")), justify="right" if name.startswith(">") else "left", overflow="fold")
    for row in rows:
        out.add_row(*(Text(str(cell)) for cell in row))
    return out
