"""`neuro fit`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import NetworkFile, Seed, Set, assignments

if TYPE_CHECKING:
    from neuro.chips.description import Chip
    from neuro.program.backend import Problem

ChipName = Annotated[str, typer.Option("--chip", metavar="NAME", help="A chip, or a table's file.")]
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
    from neuro.chips.arithmetics import ARITHMETICS
    from neuro.chips.placing.place import place
    from neuro.chips.quantising.fixed_program import report
    from neuro.chips.quantising.quantise import quantise
    from neuro.compiler import compile_network
    from neuro.model.language import load

    target = _target(chip)
    program = compile_network(load(file, params=assignments(set)), seed)
    placement = place(program, target, order=order)
    fixed = quantise(program, target) if target.arithmetic in ARITHMETICS else None
    problems = [*(fixed.problems if fixed else ()), *placement.problems]
    verdict = _verdict(program.name, target.name, problems)
    if as_json:
        parts = {"rounding": fixed.as_dict() if fixed else None, "placement": placement.as_dict()}
        typer.echo(json.dumps(_finite({**parts, "problems": _paragraphs(problems)}), indent=2, allow_nan=False))
    else:
        rounding = report(fixed) if fixed else _no_rounding(target.title)
        typer.echo("\n\n".join([rounding, str(replace(placement, problems=())), *_paragraphs(problems), verdict]))
    if any(problem.refused for problem in problems):
        raise typer.Exit(1)


def _target(name: str) -> Chip:
    """The chip; refuse one of which nothing is known that a network could exceed."""
    from neuro.chips.known import CHIPS, chip, is_table
    from neuro.core.errors import ModelError, unknown

    limited = [known for known, found in sorted(CHIPS.items()) if found.limits]
    if name not in CHIPS and not is_table(name):
        raise unknown("chip", name, limited)
    target = chip(name)
    if target.mesh is None and not target.limits:
        raise ModelError(
            f"target '{target.name}' has no cores or limits to fit",
            hint=f"expected one of {', '.join(limited)}, or a table with limits",
        )
    return target


def _no_rounding(title: str) -> str:
    return f"the arithmetic of {title} is not known here: no rounding is told"


def _paragraphs(problems: Sequence[Problem]) -> list[str]:
    """Every problem as a paragraph, those that refuse the network first."""
    return [
        f"{'refused' if p.refused else 'approximated'}: {f'{p.origin}: ' if p.origin else ''}{p.what}: {p.why}"
        + (f"\n  hint: {p.way_out}" if p.way_out else "")
        for p in sorted(problems, key=lambda p: not p.refused)
    ]


def _verdict(network: str, chip: str, problems: Sequence[Problem]) -> str:
    """One line: whether it fits, and how much is to be read above."""
    refused = sum(p.refused for p in problems)
    rest = len(problems) - refused
    counts = [f"{n} {word}" for n, word in ((refused, "refused"), (rest, "approximated")) if n]
    return f"'{network}' {'does not fit' if refused else 'fits'} on {chip}" + (
        f": {', '.join(counts)}" if counts else ""
    )


def _finite(value: Any) -> Any:
    """The same with texts in place of infinite numbers, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
