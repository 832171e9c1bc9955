"""Tables of all printed output, for a terminal, as plain text and for a notebook."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    Attributes:
        title: meaning of the rows.
        head: names of the columns; columns whose name begins with ">" are numbers, aligned to the right.
        rows: rows with a text for each column.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def as_text(heading: str, tables: Iterable[Table]) -> str:
    """Return a heading and tables as plain text, without empty tables."""
    return "\n\n".join([heading, *("\n".join(_lines(table)) for table in tables if table.rows)])


def _lines(table: Table) -> Iterator[str]:
    names = [name.lstrip(">") for name in table.head]
    rules = ["-" * max(map(len, column)) for column in zip(names, *table.rows, strict=True)]
    if table.title:
        yield table.title
    sides = "".join(name[:1] if name.startswith(">") else "<" for name in table.head)
    yield from (f"  {line}".rstrip() for line in aligned([names, rules, *table.rows], sides))


def aligned(rows: Sequence[Sequence[str]], sides: str = "") -> list[str]:
    """Return lines of text with columns of equal width.

    Args:
        rows: the cells.
        sides: alignment of each column: ">" for right, "<" for left; further columns are aligned to the left.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    columns = list(zip(widths, sides.ljust(len(widths), "<"), strict=False))
    return [
        "  ".join(f"{cell:{side}{w}}" for cell, (w, side) in zip(row, columns, strict=True)).rstrip() for row in rows
    ]


def as_html(heading: str, tables: Iterable[Table]) -> str:
    """Return a heading and tables as HTML for a notebook, escaped, without script and without style sheets."""
    return f"<p><b>{escape(heading)}</b></p>" + "".join(_html(table) for table in tables if table.rows)


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
    """Return standard output. If it is no terminal, tables are COLUMNS or 120 characters wide."""
    from rich.console import Console

    out = Console(highlight=False)
    if out.is_terminal:
        return out
    columns = os.environ.get("COLUMNS", "")
    return Console(highlight=False, width=int(columns) if columns.isdecimal() and int(columns) else 120)


def echo(text: str) -> None:
    """Print text on standard output; a terminal gets its lines wrapped between words."""
    out = console()
    out.print(text, markup=False, emoji=False, soft_wrap=not out.is_terminal)


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], title: str = "") -> Any:
    """Return a table that fits `console()`. Columns with a name that begins with ">" are numbers, aligned to the right.

    Cells wrap between words. Words are split only if the longest words of all columns are wider than the console.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    names = [name.lstrip(">") for name in columns]
    cells = [[str(cell) for cell in row] for row in rows]
    texts = list(zip(names, *cells, strict=True))
    widths = [max(map(len, "\n".join(column).split("\n"))) for column in texts]
    word_widths = [max(map(len, " ".join(column).split()), default=0) for column in texts]
    available = console().width - 4  # 2 for the box, and 2 for edge padding, which rich counts but does not draw
    is_tight = sum(word_widths) + 3 * (len(names) - 1) > available
    out = Table(
        box=box.SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", pad_edge=False,
        collapse_padding=is_tight,
    )  # fmt: skip
    gap = 2 if is_tight else 3
    fitted = _fitted(widths, word_widths, available - gap * (len(names) - 1))
    for name, is_number, width in zip(names, (name.startswith(">") for name in columns), fitted, strict=True):
        out.add_column(Text(name), justify="right" if is_number else "left", overflow="fold", width=width)
    for row in cells:
        out.add_row(*map(Text, row))
    return out


def _fitted(widths: Sequence[int], lowest: Sequence[int], available: int) -> Sequence[int | None]:
    """Reduce the widest columns towards `lowest` until all fit, and return the widths; None if they do not fit."""
    fitted = list(widths)
    while sum(fitted) > available:
        reducible = [k for k, width in enumerate(fitted) if width > lowest[k]]
        if not reducible:
            return [None] * len(fitted)
        fitted[max(reducible, key=fitted.__getitem__)] -= 1
    return fitted
