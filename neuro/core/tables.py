"""Tables as all that is printed shows them, in a terminal, as plain text and in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    Attributes:
        title: what the rows are.
        head: names of the columns; those that begin with ">" are numbers, set to the right.
        rows: one text for each column.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def as_text(heading: str, tables: Iterable[Table]) -> str:
    """A heading and tables as plain text; tables without rows are left out."""
    return "\n\n".join([heading, *("\n".join(_lines(each)) for each in tables if each.rows)])


def _lines(table: Table) -> Iterator[str]:
    names = [name.lstrip(">") for name in table.head]
    widths = [max(map(len, column)) for column in zip(names, *table.rows, strict=True)]
    right = [name.startswith(">") for name in table.head]
    if table.title:
        yield table.title
    for row in (names, ["-" * width for width in widths], *table.rows):
        cells = (cell.rjust(w) if r else cell.ljust(w) for cell, w, r in zip(row, widths, right, strict=True))
        yield ("  " + "  ".join(cells)).rstrip()


def as_html(heading: str, tables: Iterable[Table]) -> str:
    """The same for a notebook: tables alone, everything escaped, no script and no style of the page."""
    return f"<p><b>{escape(heading)}</b></p>" + "".join(_html(each) for each in tables if each.rows)


def _html(table: Table) -> str:
    sides = ["right" if name.startswith(">") else "left" for name in table.head]

    def row(kind: str, cells: Iterable[str]) -> str:
        return "".join(
            f'<{kind} style="text-align:{side};padding:0.1em 1em 0.1em 0">{escape(cell)}</{kind}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    title = f'<caption style="text-align:left"><i>{escape(table.title)}</i></caption>' if table.title else ""
    head = f"<thead><tr>{row('th', (name.lstrip('>') for name in table.head))}</tr></thead>"
    body = "".join(f"<tr>{row('td', cells)}</tr>" for cells in table.rows)
    return f'<table style="margin-bottom:1em">{title}{head}<tbody>{body}</tbody></table>'


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
