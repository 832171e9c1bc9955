"""`neuro show`."""

from __future__ import annotations

from typing import Annotated

import typer

from neuro.cli.options import NetworkFile, Seed, Set, assignments

AsProgram = Annotated[bool, typer.Option("--program", help="Print the resolved form that backends get.")]


def show(file: NetworkFile, program: AsProgram = False, seed: Seed = 0, set: Set = []) -> None:  # noqa: B006
    """Show the populations, projections and memory of a network, or its resolved form."""
    from neuro.compiler import compile_network
    from neuro.compiler.show import program_text, tables
    from neuro.core.tables import console, table
    from neuro.model.language import load

    net = load(file, params=assignments(set))
    resolved = compile_network(net, seed)
    if program:
        typer.echo(program_text(resolved), nl=False)
        return
    out = console()
    for part in tables(net, resolved):
        out.print(table(part.head, part.rows, title=part.title))
