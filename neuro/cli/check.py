"""A network before it runs: `neuro check` and `neuro show`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import Backend, NetworkFile, Seed, Set, assignments

if TYPE_CHECKING:
    from neuro.program.backend import Problem
    from neuro.program.program import Program


def check(file: NetworkFile, backend: Backend = "event", seed: Seed = 0, set: Set = []) -> None:  # noqa: B006
    """Load and compile a network, ask the backend whether it can run it, and say all that is wrong."""
    from neuro.compiler.mistakes import mistakes
    from neuro.program.backend import find_backend

    chosen = find_backend(backend)
    found = mistakes(file, assignments(set), seed)
    problems = () if found.program is None else chosen.problems(found.program)
    problems = [problem for problem in problems if problem.origin not in found.unsure]
    for error in found.mistakes:
        typer.echo(f"error: {error}", err=True)
    for problem in problems:
        typer.echo(refusal(problem), err=True)
    wrong = len(found.mistakes) + sum(problem.refused for problem in problems)
    if wrong > 1:
        typer.echo(f"{file}: {wrong} mistakes", err=True)
    if wrong or found.program is None:
        raise typer.Exit(2)
    typer.echo(f"{file}: ok on {backend}: {summary(found.program)}")


def refusal(problem: Problem) -> str:
    """A line for what a backend refuses or approximates."""
    place = f"{problem.origin}: " if problem.origin else ""
    kind = "refused" if problem.refused else "approximated"
    hint = f"\n  hint: {problem.way_out}" if problem.way_out else ""
    return f"{place}{kind}: {problem.what}: {problem.why}{hint}"


def summary(program: Program) -> str:
    """How large a network is."""
    from neuro.core.english import some

    neurons = sum(population.size for population in program.populations)
    synapses = sum(projection.size for projection in program.projections)
    return (
        f"{some(neurons, 'neuron')} in {some(len(program.populations), 'population')}, "
        f"{some(synapses, 'synapse')} in {some(len(program.projections), 'projection')}, "
        f"resolution {program.resolution:g} ms"
    )


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
