"""Errors, contents, placement and energy of a network: `neuro check`, `neuro show`, `neuro fit`, `neuro energy`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import (
    Backend,
    Duration,
    NetworkFile,
    Seed,
    Set,
    Steps,
    Threads,
    Until,
    assignments,
    milliseconds,
    name_list,
    refuse_unused,
    stoppable,
)

if TYPE_CHECKING:
    from neuro.chips.description import Chip
    from neuro.chips.energy import Energy
    from neuro.chips.placing import Placement
    from neuro.program.backend import EngineCounts, Problem
    from neuro.program.program import Program
    from neuro.run.simulation import Simulation


def check(file: NetworkFile, backend: Backend = "event", seed: Seed = 0, set: Set = []) -> None:  # noqa: B006
    """List all errors of a network file, and all parts that the backend refuses or approximates."""
    from neuro.compiler.mistakes import mistakes
    from neuro.program.backend import Draws, find_backend

    backend_class = find_backend(backend)
    report = mistakes(file, assignments(set), seed, isinstance(backend_class, Draws))
    problems = () if report.program is None else backend_class.problems(report.program)
    problems = [problem for problem in problems if problem.origin not in report.unsure]
    for error in report.mistakes:
        typer.echo(f"error: {error}", err=True)
    for problem in problems:
        typer.echo(refusal(problem), err=True)
    n_errors = len(report.mistakes) + sum(problem.refused for problem in problems)
    if n_errors > 1:
        typer.echo(f"{file}: {n_errors} mistakes", err=True)
    if n_errors or report.program is None:
        raise typer.Exit(2)
    typer.echo(f"{file}: ok on {backend}: {summary(report.program)}")


def refusal(problem: Problem, begin: str = "{place}{kind}: ") -> str:
    """Format a backend's refusal or approximation with place, reason and hint."""
    place = f"{problem.origin}: " if problem.origin else ""
    kind = "refused" if problem.refused else "approximated"
    hint = f"\n  hint: {problem.way_out}" if problem.way_out else ""
    return f"{begin.format(place=place, kind=kind)}{problem.what}: {problem.why}{hint}"


def summary(program: Program) -> str:
    """Return a line with the numbers of neurons, populations, synapses and projections, and the resolution."""
    from neuro.core.errors import some

    neurons = sum(population.size for population in program.populations)
    synapses = sum(projection.size for projection in program.projections)
    return (
        f"{some(neurons, 'neuron')} in {some(len(program.populations), 'population')}, "
        f"{some(synapses, 'synapse')} in {some(len(program.projections), 'projection')}, "
        f"resolution {program.resolution:g} ms"
    )


AsProgram = Annotated[bool, typer.Option("--program", help="Print the compiled form that backends run.")]


def show(file: NetworkFile, program: AsProgram = False, seed: Seed = 0, set: Set = []) -> None:  # noqa: B006
    """Print the populations, projections and memory of a network, or its compiled form."""
    from neuro.compiler import compile_network
    from neuro.compiler.show import program_text, tables
    from neuro.core.tables import console, table
    from neuro.model.language import load

    net = load(file, params=assignments(set))
    compiled = compile_network(net, seed)
    if program:
        typer.echo(program_text(compiled), nl=False)
        return
    out = console()
    for part in tables(net, compiled):
        out.print(table(part.head, part.rows, title=part.title))


ChipName = Annotated[str, typer.Option("--chip", metavar="NAME", help="Chip, or file of a chip's table.")]
Order = Annotated[
    str,
    typer.Option(
        "--order",
        metavar="NAME",
        help="Order of the populations on the cores: connected (follows synapses) or declared (as in the file).",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


def fit(
    file: NetworkFile,
    chip: ChipName = "loihi",
    order: Order = "connected",
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Report whether a network fits on a chip: rounding of weights and parameters, cores, memory, hops.

    The exit status is 1 if the network does not fit.
    """
    from neuro.chips.fixed_program import report
    from neuro.chips.known import ARITHMETICS
    from neuro.chips.placing import place
    from neuro.chips.quantising import quantise
    from neuro.compiler import compile_network
    from neuro.core.tables import echo
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
        unknown_rounding = f"no rounding is reported, because the arithmetic of {target.title} is not known"
        rounding = report(fixed) if fixed else unknown_rounding
        echo("\n\n".join([rounding, str(replace(placement, problems=())), *_paragraphs(problems), verdict]))
    if any(problem.refused for problem in problems):
        raise typer.Exit(1)


def _target(name: str) -> Chip:
    """Return the chip with a given name, or the chip that a table file describes.

    Raises:
        ModelError: the chip is unknown, or has neither cores nor limits.
    """
    from neuro.chips.known import CHIPS, chip, is_table
    from neuro.core.errors import ModelError, unknown

    limited = [title for title, description in sorted(CHIPS.items()) if description.limits]
    if name not in CHIPS and not is_table(name):
        raise unknown("chip", name, limited)
    target = chip(name)
    if target.mesh is None and not target.limits:
        raise ModelError(
            f"chip '{target.name}' has no cores or limits to fit",
            hint=f"expected one of {', '.join(limited)}, or a table with limits",
        )
    return target


def _paragraphs(problems: Sequence[Problem]) -> list[str]:
    """Format each problem as a paragraph, refusals first."""
    return [refusal(p, "{kind}: {place}") for p in sorted(problems, key=lambda p: not p.refused)]


def _verdict(network: str, chip: str, problems: Sequence[Problem]) -> str:
    """Return the last line: whether the network fits, and the numbers of refusals and approximations."""
    n_refused = sum(p.refused for p in problems)
    n_approximated = len(problems) - n_refused
    counts = [f"{n} {word}" for n, word in ((n_refused, "refused"), (n_approximated, "approximated")) if n]
    return f"'{network}' {'does not fit' if n_refused else 'fits'} on {chip}" + (
        f": {', '.join(counts)}" if counts else ""
    )


def _finite(value: Any) -> Any:
    """Replace infinities and NaN by text, because JSON has neither."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


PRICED = "loihi,spinnaker,spinnaker2,truenorth,cpu,gpu"

Chips = Annotated[
    Any,
    typer.Option("--chips", metavar="A,B,...", parser=name_list, help="Chips, or files with tables of chips."),
]
Per = Annotated[
    tuple[int, str],
    typer.Option(
        "--per",
        metavar="N WHAT",
        help="Print figures per part of the run: '100 recording' divides by 100 and prints joules per recording.",
    ),
]
StepTime = Annotated[
    float | None,
    typer.Option(
        "--step-time",
        metavar="MS",
        parser=milliseconds,
        help="Time that the chip takes for a step, in ms; by default the fastest possible and real time, both.",
    ),
]
ChipsOn = Annotated[
    int | None,
    typer.Option(
        "--chips-on", metavar="N", min=1, help="Number of powered chips, e.g. of a board; by default all used chips."
    ),
]
Sources = Annotated[bool, typer.Option("--sources", help="Print the source of each figure.")]
BillJson = Annotated[bool, typer.Option("--json", help="Print JSON, with NeuroBench's metrics, instead of tables.")]


def energy(
    context: typer.Context,
    file: NetworkFile,
    duration: Duration = 1000.0,
    chips: Chips = PRICED,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    per: Per = (1, "run"),
    until: Until = None,
    steps: Steps = None,
    step_time: StepTime = None,
    chips_on: ChipsOn = None,
    sources: Sources = False,
    as_json: BillJson = False,
) -> None:
    """Run a network and print its energy on chips: counts, joules and assumptions of each chip, then a comparison.

    With --until a network learns in its world, and the bill is for the whole training.
    """
    from neuro.chips.pricing import price
    from neuro.cli.run import silent_inputs, warn_of_silence
    from neuro.cli.world import summary as summary_of
    from neuro.core.clock import Clock
    from neuro.core.progress import advance
    from neuro.model.language import load
    from neuro.program.counts import total
    from neuro.run.compiled import compile as compiled

    if per[0] < 1:
        raise typer.BadParameter(f"'{per[0]}': expected a whole number >= 1", param_hint="'--per'")
    targets = [priceable(name) for name in chips]
    net = load(file, params=assignments(set))
    if net.world_section is None:
        refuse_unused(context, "a network with a world", "until", "steps")
    ticks, log, counts = Clock(net.resolution).step(duration, "--for"), None, None
    with stoppable("nothing is priced") as bar:
        bar.say("preparing")
        if until is not None:
            from neuro.realtime.closed_loop import closed_loop

            loop = closed_loop(net, backend=backend, seed=seed, threads=threads)
            placements = [placement_on(loop.sim.program, target) for target in targets]
            block_counts: list[EngineCounts] = []
            log = loop.run(
                until=until,
                steps=steps,
                progress=True,
                after=lambda loop: block_counts.append(loop.sim._engine.counts()),
            )
            sim, counts, per = loop.sim, reduce(total, block_counts), (1, "training") if per == (1, "run") else per
        elif net.world_section is not None:
            from neuro.realtime.closed_loop import lived

            ms = duration if steps is None else steps * net.world_section.step
            loop = lived(net, ms, progress=True, backend=backend, seed=seed, threads=threads)
            sim, per = loop.sim, (max(1, round(loop.sim.time / net.world_section.step)), "step") if per[0] == 1 else per
            placements = [placement_on(sim.program, target) for target in targets]
        else:
            sim = compiled(net, backend=backend, seed=seed, threads=threads)
            placements = [placement_on(sim.program, target) for target in targets]
            advance(sim, ticks, bar)
    counts = counts or sim._engine.counts()
    step_s = None if step_time is None else step_time * 1e-3
    bills = [
        price(sim.program, counts, *pair, step_s=step_s, chips=chips_on, ran_on=sim.backend, host=sim.host_work)
        for pair in zip(placements, targets, strict=True)
    ]
    if as_json:
        typer.echo(json.dumps(plain(sim, counts, bills, placements[0], per), indent=2))
    else:
        print_bills([priced.per(*per) for priced in bills], sources)
    if log is not None:
        typer.echo(summary_of(log), err=as_json)
    warn_of_silence(silent_inputs(sim))


def priceable(name: str) -> Chip:
    """Return the chip or processor with a given name, or the chip or processor that a table file describes.

    Raises:
        ModelError: the chip is unknown, or has no energy figures.
    """
    from neuro.chips.known import CHIPS, chip, is_table
    from neuro.chips.pricing import check_costs
    from neuro.core.errors import unknown

    if name not in CHIPS and not is_table(name):
        raise unknown("chip", name, sorted(title for title, description in CHIPS.items() if description.costs))
    description = chip(name)
    check_costs(description)
    return description


def placement_on(program: Program, chip: Chip) -> Placement | None:
    """Place a network on the cores of a chip. Return None for a processor without cores.

    Raises:
        ModelError: the network does not fit.
    """
    from neuro.chips.placing import place
    from neuro.chips.pricing import check_fits

    if chip.mesh is None:
        return None
    placement = place(program, chip)
    check_fits(program, placement, chip)
    return placement


def plain(
    sim: Simulation, counts: EngineCounts, bills: list[Energy], placement: Placement | None, per: tuple[int, str]
) -> dict[str, Any]:
    """Return data for JSON: all bills, and NeuroBench's metrics with the energy of the first bill."""
    from neuro.chips.neurobench_report import neurobench

    samples, steps = per[0], counts.steps // per[0]
    metrics = neurobench(sim.program, counts, samples=samples, steps=steps, placement=placement, energy=bills[0])
    facts = {"network": sim.program.name, "backend": sim.backend, "seed": sim.program.seed, "ms": sim.time}
    return {**facts, "bills": [priced.per(*per).as_dict() for priced in bills], "neurobench": metrics}


def print_bills(bills: list[Energy], sources: bool) -> None:
    """Print the bills. If there are several, also print a table that compares them."""
    from neuro.chips.energy import COLUMNS, FASTEST
    from neuro.core.tables import console, echo, table

    for priced in bills:
        echo(f"{priced.told(sources)}\n")
    if len(bills) > 1:
        rows = [(e.target, *e.cells()) for e in bills]
        columns = ("chip", *(name.replace(FASTEST, bills[0].clock) for name in COLUMNS))
        console().print(table(columns, rows, title=f"energy per {bills[0].of}"))
