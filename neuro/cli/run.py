"""A network run, and a file made again from what it holds: `neuro run` and `neuro rerun`."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import Backend, Duration, NetworkFile, Seed, Set, Threads, assignments, stoppable

if TYPE_CHECKING:
    from neuro.core.progress import Bar
    from neuro.files.parts import Trace
    from neuro.files.results import Results
    from neuro.model.network import Network
    from neuro.run.simulation import Simulation

Record = Annotated[list[str], typer.Option(metavar="NAME", help="Keep only this population's spikes; repeatable.")]
Out = Annotated[Path, typer.Option(metavar="FILE", help="The HDF5 file to write.")]
AllWeights = Annotated[bool, typer.Option("--all-weights", help="Keep also static weights above a million synapses.")]


def run(
    file: NetworkFile,
    duration: Duration = 1000.0,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    record: Record = [],  # noqa: B006
    out: Out = Path("out.h5"),
    all_weights: AllWeights = False,
) -> None:
    """Run a network and write its spikes, traces and weights, and the network itself, to one HDF5 file."""
    from neuro.core.clock import Clock
    from neuro.core.launch import shared, speaks
    from neuro.core.outputs import check_output
    from neuro.files.results import KIND, read
    from neuro.model.language import load
    from neuro.run.compiled import compile as compiled
    from neuro.run.progress import advance

    together(backend)
    net = load(file, params=assignments(set))
    steps = Clock(net.resolution).step(duration, "--for")
    keep_spikes(net, record)
    check_output(out, KIND)
    with stoppable(lambda: _left_of(out)) as bar:
        bar.say("preparing")
        sim = compiled(net, backend=backend, seed=seed, threads=threads)
        words: dict[str, Any] = {"threads": threads, "record": record, "all_weights": all_weights}
        began = time.perf_counter()
        if shared() or (out.exists() and not out.is_file()):
            results, first_s = _at_the_end(sim, net, steps, bar, out, words)
        else:
            with sim.record_to(out, **words):
                first_s = advance(sim, steps, bar)
                bar.say("writing")
            results = read(out)
        taken = time.perf_counter() - began - first_s
        silent = silent_inputs(sim)
    if speaks():
        report(results, out)
        tell_silence(silent)
        # What differs from run to run is not among what can be compared.
        typer.echo(f"{duration:g} ms took {taken:.3g} s, {taken * 1000.0 / duration:.3g} x its own time", err=True)


def _at_the_end(
    sim: Simulation, net: Network, steps: int, bar: Bar, out: Path, words: dict[str, Any]
) -> tuple[Results, float]:
    """Run, and write all at once, into a pipe or by one of several processes, which may be killed untidily.

    Returns:
        the results, and what `advance` gives.
    """
    from neuro.core.launch import speaks
    from neuro.core.outputs import output
    from neuro.files.results import KIND, write
    from neuro.run.collect import collect
    from neuro.run.progress import advance

    first_s = advance(sim, steps, bar)
    bar.say("writing")
    results = collect(sim, net, **words)
    if speaks():
        with output(out, KIND) as part:
            write(results, part)
    return results, first_s


def _left_of(out: Path) -> str:
    """What an interrupted run has left."""
    from neuro.files.results import read, unfinished

    part = unfinished(out)
    return f"{part} has what was recorded up to {read(part).time:g} ms" if part.exists() else f"{out} is not written"


def together(backend: str) -> None:
    """Let the processes of mpirun share the network where the backend can; one of them cleans up at the end."""
    import signal

    from neuro.core.launch import processes, share
    from neuro.program.backend import find_backend

    if processes() > 1 and getattr(find_backend(backend), "distributed", False):
        share()
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))


def silent_inputs(sim: Simulation) -> list[str]:
    """The generators of spikes, if there are some and none of them has emitted any."""
    counts = sim.counts().populations
    inputs = [part.name for part in sim.program.populations if part.kind not in ("neuron", "current")]
    return [] if any(counts[name].spikes for name in inputs) else inputs


def tell_silence(inputs: list[str]) -> None:
    """Warn that what was counted, and is priced, is the network without input."""
    if inputs:
        message = f"the input emitted no spike ({', '.join(inputs)}): these are the figures of a network without input"
        typer.echo(f"warning: {message}\n  hint: give it spikes or rates; a program may inject them", err=True)


def keep_spikes(net: Network, names: list[str]) -> None:
    """Ask for the spikes of the named populations; those of some generators are not kept of themselves."""
    from neuro.core.english import a
    from neuro.core.errors import ModelError, Where, unknown
    from neuro.model.neurons import CurrentGenerator, Generator

    net.place = Where("--record")
    probed = {probe.of for probe in net.probes.values() if probe.record == "spikes"}
    for name in names:
        if name not in net.populations:
            raise unknown("population", name, net.populations, net.place)
        model = net.populations[name].model
        if isinstance(model, CurrentGenerator):
            raise ModelError(f"'{name}' is {a(model.name)}, which has no spikes", where=net.place)
        if name not in probed and isinstance(model, Generator):
            net.probe(f"{name}.spikes", name)
    net.place = None


def report(results: Results, out: Path) -> None:
    """Print rates, weights that learnt, what was recorded, and what to do next."""
    from neuro.core.tables import console, table

    columns = ("population", "model", ">neurons", ">spikes", ">rate Hz")
    console().print(table(columns, rates(results)))
    learnt = list(weights(results))
    if learnt:
        console().print(table(("projection", "synapse", ">synapses", ">weight", ">SD", ">from", ">to"), learnt))
    typer.echo(recorded(results))
    left_out = [name for name, part in results.projections.items() if part.weight is None]
    if left_out:
        typer.echo(f"left out the static weights of {', '.join(left_out)}; --all-weights keeps them")
    typer.echo(f"{out}: {results.duration_ms:g} ms")
    if any(part.recorded for part in results.populations.values()) or results.traces:
        typer.echo(f"next: neuro plot {shlex.quote(str(out))}, or neuro report {shlex.quote(str(out))}")


def rates(results: Results) -> Iterator[tuple[str, ...]]:
    """A row for each population."""
    from neuro.files.results import spike_columns

    for name, train in results.populations.items():
        yield name, train.model, f"{train.size:,}", *spike_columns(train.spikes, train.size, results.duration_ms)


def weights(results: Results) -> Iterator[tuple[str, ...]]:
    """A row for each projection whose weights have changed: their mean, standard deviation and bounds at the end."""
    for name, part in results.projections.items():
        if part.weight is not None and part.weight.size and part.counts["learning_updates"]:
            w = part.weight
            spread = w.std() if w.min() < w.max() else 0.0  # of equal weights, rounding of the mean would show
            figures = (f"{value:.4g}" for value in (w.mean(), spread, w.min(), w.max()))
            yield name, part.synapse, f"{w.size:,}", *figures


def recorded(results: Results) -> str:
    """What was recorded, in a line."""
    spikes = [name for name, part in results.populations.items() if part.recorded]
    parts = [f"spikes of {', '.join(spikes)}"] if spikes else []
    parts += [f"{name} ({what(part)})" for name, part in results.traces.items()]
    return f"recorded: {'; '.join(parts) or 'nothing'}"


def what(trace: Trace) -> str:
    """What a probe recorded, in a few words."""
    from neuro.core.english import some

    of, times = trace.projection or trace.population, some(trace.times_ms.size, "time")
    if trace.at_pre_spikes:
        return f"{trace.state} of {of} at {some(trace.times_ms.size, 'pre spike')}"
    if trace.single:
        return f"{'mean ' * trace.mean}{trace.state} of {of} at {times}"
    return f"{trace.state} of {some(trace.columns, 'synapse' if trace.projection else 'neuron')} at {times}"


File = Annotated[Path, typer.Argument(metavar="FILE", help="Results, a model, a page, or the folder of a run.")]
OtherBackend = Annotated[str, typer.Option("--backend", metavar="NAME", help="Another one than it was made on.")]
Inputs = Annotated[
    list[Path], typer.Option(metavar="FOLDER", help="Look there for inputs that were moved, by content; repeatable.")
]
Against = Annotated[Path | None, typer.Option(metavar="OTHER", help="Compare with this file instead of making it.")]


def rerun(
    file: File,
    backend: OtherBackend = "",
    inputs: Inputs = [],  # noqa: B006
    against: Against = None,
) -> None:
    """Make a file again from what it holds; report whether it has the same bits, or what differs and what changed."""
    from neuro.core.progress import Bar
    from neuro.rerun.again import rerun as again

    with Bar() as bar:
        bar.say("running again")
        verdict = again(file, backend=backend, inputs=inputs, against=against, bar=bar)
    typer.echo(f"{file}: " + ("the same bits" if verdict.same else f"not the same: {verdict.difference}"))
    for line in verdict.changed:
        typer.echo(f"changed: {line}")
    if not verdict.same:
        raise typer.Exit(1)
