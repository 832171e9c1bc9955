"""`neuro fit`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from neuro.cli.options import NetworkFile, Seed, Set, assignments

ChipName = Annotated[str, typer.Option("--chip", metavar="NAME", help="loihi or spinnaker, or the table of another.")]
Order = Annotated[str, typer.Option("--order", metavar="NAME", help="Lay cores out as connected, or as declared.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


def fit(
    file: NetworkFile,
    chip: ChipName = "loihi",
    order: Order = "connected",
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Show whether a network fits on a chip: rounding of weights and neurons, cores, memory and hops.

    The exit status is 1 if it does not.
    """
    import neuro
    from neuro.chips.chip import chip as find
    from neuro.chips.place import place
    from neuro.chips.quantise import ARITHMETIC, quantise
    from neuro.compiler import compile_network

    program = compile_network(neuro.load(file, params=assignments(set)), seed)
    target = find(chip)
    placement = place(program, target, order=order)
    fixed = quantise(program, target) if target.arithmetic in ARITHMETIC else None
    problems = [*(fixed.problems if fixed else ()), *placement.problems]
    told = [
        f"{'refused' if p.refused else 'approximated'}: {f'{p.origin}: ' if p.origin else ''}{p.what}: {p.why}"
        + (f"\n  hint: {p.way_out}" if p.way_out else "")
        for p in problems
    ]
    if as_json:
        report = {"rounding": fixed.as_dict() if fixed else None, "placement": placement.as_dict(), "problems": told}
        typer.echo(json.dumps(report, indent=2))
    else:
        typer.echo("\n\n".join([*([str(fixed)] if fixed else []), str(placement), *told]))
    if any(problem.refused for problem in problems):
        raise typer.Exit(1)
