"""What `neuro sweep run` and `neuro tune run` tell while runs are done, and of those that failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from neuro.core.progress import Bar
from neuro.sweeps.folder import Folder


@contextmanager
def going(out: Path) -> Iterator[Bar]:
    """A bar while runs are done; who interrupts them is told that the same command goes on."""
    with Bar() as bar:
        try:
            yield bar
        except KeyboardInterrupt:
            bar.stop()
            typer.echo(f"interrupted: {out} keeps what is done; the same command goes on", err=True)
            raise typer.Exit(130) from None


def failures(folder: Folder, keys: Sequence[str]) -> list[str]:
    """What went wrong, each reason once, with how often and where."""
    from neuro.sweeps.table import reasons

    lines = []
    for those in reasons(folder.outcomes(keys)):
        first = those[0].error.partition("\n")[0]
        alike = ", and others like it" if any(each.error != those[0].error for each in those) else ""
        lines.append(f"failed {len(those):,} x: {first}{alike} (first: {those[0].key[:10]})")
    return [*lines[:5], f"and {len(lines) - 5} more reasons, see the table"] if len(lines) > 5 else lines
