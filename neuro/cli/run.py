"""A network run, and what it left shown: `neuro run`, `plot` and `report`."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.mistakes import counted_approximations, listed_approximations
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
    at_least,
    milliseconds,
    moment,
    refuse_unused,
    stoppable,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from neuro.core.progress import Bar
    from neuro.files.parts import Trace
    from neuro.files.results import Results
    from neuro.model.network import Network
    from neuro.model.views import View
    from neuro.run.simulation import Simulation

Record = Annotated[list[str], typer.Option(metavar="NAME", help="Keep only this population's spikes; repeatable.")]
ResultsOut = Annotated[Path, typer.Option(metavar="FILE", help="The HDF5 file to write.")]
AllWeights = Annotated[bool, typer.Option("--all-weights", help="Keep also static weights above a million synapses.")]
Episodes = Annotated[int | None, typer.Option(metavar="N", parser=at_least(1), help="Episodes in its world.")]
Frozen = Annotated[bool, typer.Option("--frozen", help="Act in its world without learning.")]
CopiesOf = Annotated[int, typer.Option("--copies", metavar="N", parser=at_least(1), help="Worlds side by side.")]
Pace = Annotated[
    float | None, typer.Option("--pace", metavar="X", help="Times real time in its world; else as fast as it can.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a run that was interrupted or killed.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", help="List all approximations of the backend, not only their number.")
]
SaveFrozen = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Also write the network in YAML with what it has learnt, as static synapses."),
]


def run(
    context: typer.Context,
    file: NetworkFile,
    duration: Duration = 1000.0,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    record: Record = [],  # noqa: B006
    out: ResultsOut = Path("out.h5"),
    all_weights: AllWeights = False,
    steps: Steps = None,
    episodes: Episodes = None,
    until: Until = None,
    frozen: Frozen = False,
    copies: CopiesOf = 1,
    pace: Pace = None,
    resume: Resume = False,
    save_frozen: SaveFrozen = None,
    verbose: Verbose = False,
) -> None:
    """Run a network and write its spikes, traces and weights, and the network itself, to one HDF5 file.

    A network with a world acts there and learns until --for, --steps, --episodes or --until, whichever comes first.
    """
    from neuro.core.clock import Clock
    from neuro.core.outputs import check_output
    from neuro.core.progress import advance
    from neuro.core.system import shared, speaks
    from neuro.files.results import KIND, read
    from neuro.model.language import load
    from neuro.model.language.writer import check_network_file
    from neuro.run.compiled import compile as compiled

    together(backend)
    net = load(file, params=assignments(set))
    keep_spikes(net, record)
    check_output(out, KIND)
    if save_frozen is not None:
        check_network_file(save_frozen)
    if net.world_section is not None:
        from neuro.cli.world import run_world, summary

        given = context.get_parameter_source("duration")
        if (given is not None and given.name == "COMMANDLINE") or (steps, episodes, until) == (None, None, None):
            asked = max(1, math.ceil(duration / net.world_section.step - 1e-9))
            steps = asked if steps is None else min(steps, asked)
        ends: dict[str, Any] = {"steps": steps, "episodes": episodes, "until": until}
        words: dict[str, Any] = {"record": record, "all_weights": all_weights, "save_frozen": save_frozen}
        acts: dict[str, Any] = {"backend": backend, "seed": seed, "threads": threads, "copies": copies, "pace": pace}
        words["compiling"] = partial(approximations, file, backend, verbose)
        results, loop = run_world(net, out, ends=ends, frozen=frozen, resume=resume, **words, **acts)
        print_results(results, out)
        typer.echo(summary(loop.log))
        tell_joules(loop.sim, "control step of the last block", round(loop.sim.time / net.world_section.step))
        if (account := loop.account) is not None:
            typer.echo(f"{account.misses:,} of {account.ticks:,} steps late; due to done: {account.response}", err=True)
        return
    refuse_unused(context, "a network with a world", "steps", "episodes", "until", "frozen", "copies", "pace", "resume")
    ticks = Clock(net.resolution).step(duration, "--for")
    with stoppable(lambda: _left_of(out)) as bar:
        bar.say("preparing")
        with approximations(file, backend, verbose):
            sim = compiled(net, backend=backend, seed=seed, threads=threads)
        words = {"threads": threads, "record": record, "all_weights": all_weights}
        began = time.perf_counter()
        if shared() or (out.exists() and not out.is_file()):
            results, first_s = _at_the_end(sim, net, ticks, bar, out, words)
        else:
            with sim.record_to(out, **words):
                first_s = advance(sim, ticks, bar)
                bar.say("writing")
            results = read(out)
        taken = time.perf_counter() - began - first_s
        silent = silent_inputs(sim)
        if save_frozen is not None:
            sim.network(frozen=True).save(save_frozen)
    if speaks():
        print_results(results, out)
        tell_silence(silent)
        tell_joules(sim)
        # What differs from run to run is not among what can be compared.
        typer.echo(f"{duration:g} ms took {taken:.3g} s, {taken * 1000.0 / duration:.3g} x its own time", err=True)


def approximations(file: Path | str, backend: str, verbose: bool) -> AbstractContextManager[None]:
    """Return a context in which a network is compiled and the backend's approximations are counted, or listed."""
    from neuro.chips.known import CHIPS, is_table

    if verbose:
        return listed_approximations()
    is_chip = backend in CHIPS or is_table(backend)
    command = ["fit", str(file), "--chip"] if is_chip else ["check", str(file), "--backend"]
    return counted_approximations(backend, shlex.join(["neuro", *command, backend]))


def _at_the_end(
    sim: Simulation, net: Network, steps: int, bar: Bar, out: Path, words: dict[str, Any]
) -> tuple[Results, float]:
    """Run, and write all at once, into a pipe or by one of several processes, which may be killed untidily.

    Returns:
        the results, of several processes without weights, and what `advance` gives.
    """
    from neuro.core.outputs import output
    from neuro.core.progress import advance
    from neuro.core.system import shared, speaks
    from neuro.files.results import KIND, read, write
    from neuro.run.collect import all_weights_of, collect

    first_s = advance(sim, steps, bar)
    bar.say("writing")
    if not shared():
        results = collect(sim, net, **words)
        with output(out, KIND) as part:
            write(results, part)
        return results, first_s
    results = collect(sim, net, **words, weights=False)
    weights = all_weights_of(sim, words["all_weights"])
    if not speaks():
        for _ in weights:  # each process has some of them, which it gives to the others
            pass
        return results, first_s
    with output(out, KIND) as part:
        write(results, part, weights)
    return read(out), first_s


def _left_of(out: Path) -> str:
    """What an interrupted run has left."""
    from neuro.files.results import recorded_in, unfinished

    return recorded_in(unfinished(out)) or f"{out} is not written"


def together(backend: str) -> None:
    """Let the processes of mpirun share the network where the backend can; one of them cleans up at the end."""
    import signal

    from neuro.core.system import processes, share
    from neuro.program.backend import Distributed, find_backend

    if processes() > 1 and isinstance(find_backend(backend), Distributed):
        share()
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))


def tell_joules(sim: Simulation, of: str = "", parts: int = 1) -> None:
    """Print what the run takes on the chip that its backend emulates, in a line.

    Args:
        sim: after its run.
        of: one of the equal parts that the run has, such as "control step"; of the whole run if empty.
        parts: how many.
    """
    from neuro.chips.known import CHIPS
    from neuro.core.errors import ModelError

    if sim.backend in CHIPS:
        try:
            text = sim.energy(sim.backend).per(max(1, parts), of or "run").totals()
        except ModelError as error:
            text = f"not priced: {error.message}"
        typer.echo(f"{sim.backend}: {text}{of and ', each '}{of}")


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
    from neuro.core.errors import ModelError, Where, a, unknown
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


def print_results(results: Results, out: Path) -> None:
    """Print rates, weights that learnt, what was recorded, and what to do next."""
    from neuro.core.tables import console, table

    columns = ("population", "model", ">neurons", ">spikes", ">rate Hz")
    console().print(table(columns, rates(results)))
    learnt = list(weights(results))
    if learnt:
        console().print(table(("projection", "synapse", ">synapses", ">weight", ">SD", ">from", ">to"), learnt))
    typer.echo(recorded(results))
    left_out = [name for name, part in results.projections.items() if part.weight is None and not part.drawn_by]
    if left_out:
        typer.echo(f"left out the static weights of {', '.join(left_out)}; --all-weights keeps them")
    if drawn := [name for name, part in results.projections.items() if part.drawn_by]:
        typer.echo(f"drawn by the backend, and without weights: the synapses of {', '.join(drawn)}")
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
    from neuro.core.errors import some

    of, times = trace.projection or trace.population, some(trace.times_ms.size, "time")
    if trace.at_pre_spikes:
        return f"{trace.state} of {of} at {some(trace.times_ms.size, 'pre spike')}"
    if trace.single:
        return f"{'mean ' * trace.mean}{trace.state} of {of} at {times}"
    return f"{trace.state} of {some(trace.columns, 'synapse' if trace.projection else 'neuron')} at {times}"


class PictureFormat(StrEnum):
    """Formats of pictures."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


File = Annotated[Path, typer.Argument(metavar="FILE", help="Results that 'neuro run' wrote.")]
Folder = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; beside FILE if not given.")]
Between = Annotated[
    tuple[str, str] | None, typer.Option("--between", metavar="BEGIN END", help="Only this stretch, in ms.")
]
Of = Annotated[
    list[str],
    typer.Option(
        "--of",
        metavar="NAME",
        help="Only this population, or some of its neurons: 'exc[:100]', 'grid[2:4, :]', 'exc[[3, 7]]'; repeatable.",
    ),
]
Bin = Annotated[float | None, typer.Option("--bin", metavar="MS", parser=milliseconds, help="Bins of the rates.")]
InFormat = Annotated[PictureFormat, typer.Option("--format", metavar="png|pdf|svg", help="Of the pictures.")]


def plot(
    file: File,
    out: Folder = None,
    between: Between = None,
    of: Of = [],  # noqa: B006
    bin: Bin = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw the spikes, rates and traces of a run as pictures."""
    from neuro import plots
    from neuro.core.errors import ModelError
    from neuro.files.results import read
    from neuro.model.views import View, view_of_text

    results = read(file)
    stretch = None if between is None else tuple(moment(text) for text in between)
    laid = {name: results.laid(name) for name in results.populations}
    asked = [view_of_text(text, laid) for text in of]
    shown = [part if isinstance(part, View) else part.name for part in asked] or None
    whole = {part.name for part in asked if not isinstance(part, View)}
    views = [part for part in asked if isinstance(part, View) and part.population.name not in whole]
    named = {*whole, *(view.population.name for view in views)}
    probes = [
        name for name, trace in results.traces.items() if not of or (trace.population in named and _seen(trace, views))
    ]
    draw: dict[str, Callable[[], Figure]] = {}
    if of or any(train.recorded for train in results.populations.values()):
        draw["raster"] = lambda: plots.raster(results, shown, window=stretch)
        draw["rates"] = lambda: plots.rate(results, shown, bin=bin, window=stretch)
    if probes:
        draw["traces"] = lambda: plots.trace(results, probes, of=views, window=stretch)
    if not draw:
        raise ModelError(f"{file}: holds neither spikes nor traces", hint="'neuro run --record NAME' keeps spikes")
    drawn = ((f"{file.stem}-{what}", picture()) for what, picture in draw.items())
    write_pictures(drawn, file.parent if out is None else out, format)


def write_pictures(pictures: Iterable[tuple[str, Figure]], folder: Path, format: PictureFormat) -> None:
    """Write pictures by their names into a folder, which is made if it is not there, and report each."""
    from neuro.core.outputs import make_folder
    from neuro.core.pictures import write_picture

    make_folder(folder)
    for name, picture in pictures:
        path = folder / f"{name}.{format.value}"
        write_picture(path, picture)
        typer.echo(path)


def _seen(trace: Trace, views: Sequence[View]) -> bool:
    """Whether a trace has neurons of the views of its population, if there are any."""
    mine = [view for view in views if view.population.name == trace.population]
    if not mine or trace.single or trace.ids is None:
        return True
    return bool(set(trace.ids.tolist()) & {neuron for view in mine for neuron in view.ids.tolist()})


PageOut = Annotated[Path | None, typer.Option(metavar="FILE", help="The page to write; FILE with .html if not given.")]
ChipName = Annotated[str, typer.Option("--chip", metavar="NAME", help="A chip, or a table's file, of the bill.")]

ENDINGS = (".html", ".htm")


def report(file: File, out: PageOut = None, chip: ChipName = "loihi") -> None:
    """Write one page that shows a run: spikes, rates, traces, weights, counts and what a chip would take."""
    from neuro.chips.known import chip as known
    from neuro.core.errors import ModelError
    from neuro.core.outputs import check_output, output
    from neuro.files.results import read
    from neuro.pages.report import PAGE, page

    path = file.with_suffix(".html") if out is None else out
    check_output(path, PAGE)
    if path.suffix.lower() not in ENDINGS:
        raise ModelError(f"--out {path}: a report is a page of HTML: expected a name ending in .html")
    known(chip)
    results = read(file)
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(results, file, chip)), "utf-8")
    typer.echo(f"{path}: written")
