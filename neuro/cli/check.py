"""`neuro check`."""

from __future__ import annotations

import typer

from neuro.cli.options import Backend, NetworkFile, Seed, Set, assignments


def check(file: NetworkFile, backend: Backend = "event", seed: Seed = 0, set: Set = []) -> None:  # noqa: B006
    """Load and compile a network, ask the backend whether it can run it, and say so."""
    from neuro.compiler import compile_network
    from neuro.model.language import load
    from neuro.program.backend import find_backend

    chosen = find_backend(backend)
    program = compile_network(load(file, params=assignments(set)), seed)
    problems = chosen.problems(program)
    for problem in problems:
        place = f"{problem.origin}: " if problem.origin else ""
        kind = "refused" if problem.refused else "approximated"
        hint = f"\n  hint: {problem.way_out}" if problem.way_out else ""
        typer.echo(f"{place}{kind}: {problem.what}: {problem.why}{hint}", err=True)
    if any(problem.refused for problem in problems):
        raise typer.Exit(2)
    neurons = sum(population.size for population in program.populations)
    synapses = sum(projection.size for projection in program.projections)
    typer.echo(
        f"{file}: ok on {backend}: {neurons} neurons in {len(program.populations)} populations, "
        f"{synapses} synapses in {len(program.projections)} projections, resolution {program.resolution:g} ms"
    )
