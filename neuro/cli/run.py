"""Commands that run a network and show the results: `neuro run`, `plot` and `report`."""

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

Record = Annotated[
    list[str],
    typer.Option(
        metavar="NAME",
        help="Population or generator whose spikes are written, instead of those of all neurons; repeatable.",
    ),
]
ResultsOut = Annotated[Path, typer.Option(metavar="FILE", help="HDF5 file of the results.")]
AllWeights = Annotated[
    bool, typer.Option("--all-weights", help="Static weights also of projections above a million synapses.")
]
Episodes = Annotated[
    int | None, typer.Option(metavar="N", parser=at_least(1), help="Largest number of episodes in the world.")
]
Frozen = Annotated[bool, typer.Option("--frozen", help="Act in the world without learning.")]
CopiesOf = Annotated[
    int,
    typer.Option(
        "--copies",
        metavar="N",
        parser=at_least(1),
        help="Number of worlds side by side, each with a copy of the network; their weight changes are summed.",
    ),
]
Pace = Annotated[
    float | None,
    typer.Option("--pace", metavar="X", help="Speed limit of the world, as a multiple of real time; default: none."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the interrupted or killed run of a world to --out.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", help="Print each approximation of the backend, instead of their number.")
]
SaveFrozen = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="YAML file of the network with its learnt weights as static synapses."),
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
    """Run a network and write spikes, traces, weights and the network itself to one HDF5 file.

    A network with a world acts and learns there until --for, --steps, --episodes or --until, whichever is first. The
    default of --for applies only if no other limit is set.
    """
    from neuro.model.language import load

    share_among_processes(backend)
    net = load(file, params=assignments(set))
    keep_spikes(net, record)

    from neuro.core.clock import Clock  # these slow imports come after the network was checked
    from neuro.core.outputs import check_output
    from neuro.core.progress import advance
    from neuro.core.system import shared, speaks
    from neuro.files.results import KIND, read
    from neuro.model.language.writer import check_network_file
    from neuro.run.compiled import compile as compiled

    check_output(out, KIND)
    if save_frozen is not None:
        check_network_file(save_frozen)
    if net.world_section is not None:
        from neuro.cli.world import run_world, summary

        source = context.get_parameter_source("duration")
        if (source is not None and source.name == "COMMANDLINE") or (steps, episodes, until) == (None, None, None):
            steps_of_duration = copies * max(1, math.ceil(duration / net.world_section.step - 1e-9))
            steps = steps_of_duration if steps is None else min(steps, steps_of_duration)
        ends: dict[str, Any] = {"steps": steps, "episodes": episodes, "until": until}
        outputs: dict[str, Any] = {"record": record, "all_weights": all_weights, "save_frozen": save_frozen}
        loop_settings: dict[str, Any] = {"backend": backend, "seed": seed, "threads": threads}
        loop_settings |= {"copies": copies, "pace": pace}
        compiling = partial(approximations, file, backend, verbose)
        results, loop = run_world(
            net, out, ends=ends, frozen=frozen, resume=resume, compiling=compiling, **outputs, **loop_settings
        )
        print_results(results, out)
        typer.echo(summary(loop.log))
        print_energy(loop.sim, "control step of the last block", round(loop.sim.time / net.world_section.step))
        if (account := loop.account) is not None:
            typer.echo(f"{account.misses:,} of {account.ticks:,} steps late; due to done: {account.response}", err=True)
        return
    refuse_unused(context, "a network with a world", "steps", "episodes", "until", "frozen", "copies", "pace", "resume")
    ticks = Clock(net.resolution).step(duration, "--for")
    with stoppable(lambda: _state_of_output(out)) as bar:
        bar.say("preparing")
        with approximations(file, backend, verbose):
            sim = compiled(net, backend=backend, seed=seed, threads=threads)
        outputs = {"threads": threads, "record": record, "all_weights": all_weights}
        start_s = time.perf_counter()
        if shared() or (out.exists() and not out.is_file()):
            results, first_s = _run_then_write(sim, net, ticks, bar, out, outputs)
        else:
            with sim.record_to(out, **outputs):
                first_s = advance(sim, ticks, bar)
                bar.say("writing")
            results = read(out)
        elapsed_s = time.perf_counter() - start_s - first_s
        silent_generators = silent_inputs(sim)
        if save_frozen is not None:
            sim.network(frozen=True).save(save_frozen)
    if speaks():
        print_results(results, out)
        warn_of_silence(silent_generators)
        print_energy(sim)
        # Standard output is the same for equal runs, so the time goes to standard error.
        real_time_factor = elapsed_s * 1000.0 / duration
        typer.echo(f"{duration:g} ms simulated in {elapsed_s:.3g} s: real-time factor {real_time_factor:.3g}", err=True)


def approximations(file: Path | str, backend: str, verbose: bool) -> AbstractContextManager[None]:
    """Return a context for compilation that prints the approximations of a backend, or only their number."""
    from neuro.chips.known import CHIPS, is_table

    if verbose:
        return listed_approximations()
    is_chip = backend in CHIPS or is_table(backend)
    command = ["fit", str(file), "--chip"] if is_chip else ["check", str(file), "--backend"]
    return counted_approximations(backend, shlex.join(["neuro", *command, backend]))


def _run_then_write(
    sim: Simulation, net: Network, steps: int, bar: Bar, out: Path, outputs: dict[str, Any]
) -> tuple[Results, float]:
    """Run the network, then write all results at once.

    A pipe cannot be written piece by piece. Of several processes, only one writes.

    Returns:
        the results, and the duration of the first steps from `advance` in s. The results have no weights in processes
        that do not write.
    """
    from neuro.core.outputs import output
    from neuro.core.progress import advance
    from neuro.core.system import speaks
    from neuro.files.results import KIND, read, write
    from neuro.run.collect import all_weights_of, collect

    first_s = advance(sim, steps, bar)
    bar.say("writing")
    results = collect(sim, net, **outputs, weights=False)
    weights = all_weights_of(sim, outputs["all_weights"])
    if not speaks():
        for _ in weights:  # each step sends this process's weights to the process that writes
            pass
        return results, first_s
    with output(out, KIND) as part:
        write(results, part, weights)
        return read(part), first_s  # the open file stays readable, also if the part is copied to a pipe and removed


def _state_of_output(out: Path) -> str:
    """Describe the results that an interrupted run has written."""
    from neuro.files.results import recorded_in, unfinished

    return recorded_in(unfinished(out)) or f"{out} is not written"


def share_among_processes(backend: str) -> None:
    """Distribute the network over the processes of mpirun if the backend supports this.

    SIGTERM then ends a process by `SystemExit`, so that its unfinished files are deleted.
    """
    import signal

    from neuro.core.system import processes, share

    if processes() == 1:
        return
    from neuro.program.backend import Distributed, find_backend

    if isinstance(find_backend(backend), Distributed):
        share()
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))


def print_energy(sim: Simulation, unit: str = "", parts: int = 1) -> None:
    """Print one line with the energy and time of the run on the emulated chip, or nothing for other backends.

    Args:
        sim: the simulation, after its run.
        unit: unit of the figures, such as "control step"; "" for the whole run.
        parts: number of these units in the run.
    """
    from neuro.chips.known import CHIPS
    from neuro.core.errors import ModelError

    if sim.backend in CHIPS:
        try:
            text = sim.energy(sim.backend).per(max(1, parts), unit or "run").totals()
        except ModelError as error:
            text = f"not priced: {error.message}"
        typer.echo(f"{sim.backend}: {text}{unit and ', each '}{unit}")


def silent_inputs(sim: Simulation) -> list[str]:
    """Return the names of the spike generators if all were silent, else an empty list."""
    counts = sim.counts().populations
    inputs = [part.name for part in sim.program.populations if part.kind not in ("neuron", "current")]
    return [] if any(counts[name].spikes for name in inputs) else inputs


def warn_of_silence(inputs: list[str]) -> None:
    """Warn about silent inputs, because counts and energy are then those of a network without input."""
    if inputs:
        message = f"no input emitted a spike ({', '.join(inputs)}): all figures are those of a network without input"
        hint = "set spikes or rates of the generators, or inject spikes from a program"
        typer.echo(f"warning: {message}\n  hint: {hint}", err=True)


def keep_spikes(net: Network, names: list[str]) -> None:
    """Add probes for the spikes of named generators. By default generators are not recorded.

    Raises:
        ModelError: a population is unknown, or emits no spikes.
    """
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
    """Print the rates, the learnt weights, the recorded quantities and the next commands."""
    from neuro.core.tables import console, table

    columns = ("population", "model", ">neurons", ">spikes", ">rate Hz")
    console().print(table(columns, rates(results)))
    if weight_rows := list(weights(results)):
        console().print(table(("projection", "synapse", ">synapses", ">weight", ">SD", ">from", ">to"), weight_rows))
    typer.echo(recorded(results))
    omitted = [name for name, part in results.projections.items() if part.weight is None and not part.drawn_by]
    if omitted:
        typer.echo(f"static weights not written: {', '.join(omitted)}; --all-weights writes them")
    if undisclosed := [name for name, part in results.projections.items() if part.drawn_by]:
        typer.echo(f"weights not written, because the backend drew the synapses: {', '.join(undisclosed)}")
    typer.echo(f"{out}: {results.duration_ms:g} ms")
    if any(part.recorded for part in results.populations.values()) or results.traces:
        typer.echo(f"next: neuro plot {shlex.quote(str(out))}, or neuro report {shlex.quote(str(out))}")


def rates(results: Results) -> Iterator[tuple[str, ...]]:
    """Yield a row for each population: name, model, neurons, spikes and rate."""
    from neuro.files.results import spike_columns

    for name, train in results.populations.items():
        yield name, train.model, f"{train.size:,}", *spike_columns(train.spikes, train.size, results.duration_ms)


def weights(results: Results) -> Iterator[tuple[str, ...]]:
    """Yield a row for each learnt projection: name, synapse, and number, mean, deviation and range of its weights."""
    for name, part in results.projections.items():
        if part.weight is not None and part.weight.size and part.counts["learning_updates"]:
            weight = part.weight
            low, high = weight.min(), weight.max()
            spread = weight.std() if low < high else 0.0  # std of equal weights is not exactly 0
            figures = (f"{value:.4g}" for value in (weight.mean(), spread, low, high))
            yield name, part.synapse, f"{weight.size:,}", *figures


def recorded(results: Results) -> str:
    """Return a line with the recorded spikes and states."""
    spikes = [name for name, part in results.populations.items() if part.recorded]
    parts = [f"spikes of {', '.join(spikes)}"] if spikes else []
    parts += [f"{name} ({trace_text(part)})" for name, part in results.traces.items()]
    return f"recorded: {'; '.join(parts) or 'nothing'}"


def trace_text(trace: Trace) -> str:
    """Describe the record of a probe, e.g. "V_m of 3 neurons at 1,000 times"."""
    from neuro.core.errors import some

    times = some(trace.times_ms.size, "time")
    if trace.at_pre_spikes:
        return f"{trace.state} of {trace.of} at {some(trace.times_ms.size, 'pre spike')}"
    if trace.single:
        return f"{'mean ' * trace.mean}{trace.state} of {trace.of} at {times}"
    return f"{trace.state} of {some(trace.columns, trace.noun)} at {times}"


class PictureFormat(StrEnum):
    """Picture formats."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


def _results(path: Path) -> Path:
    """Return the path of results. A missing file is refused before the slow imports for reading it."""
    from neuro.core.inputs import existing
    from neuro.core.outputs import kept_parts

    return path if path.name and next(kept_parts(path)).exists() else existing(path)


File = Annotated[Path, typer.Argument(metavar="FILE", callback=_results, help="Results of 'neuro run'.")]
Folder = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Folder of the pictures; by default the folder of FILE.")
]
Between = Annotated[
    tuple[str, str] | None,
    typer.Option("--between", metavar="BEGIN END", help="Interval to draw, in ms; by default the whole run."),
]
Of = Annotated[
    list[str],
    typer.Option(
        "--of",
        metavar="NAME",
        help="Population, or some of its neurons such as 'exc[:100]', 'grid[2:4, :]' or 'exc[[3, 7]]', instead of all; "
        "repeatable.",
    ),
]
Bin = Annotated[
    float | None,
    typer.Option(
        "--bin", metavar="MS", parser=milliseconds, help="Bin width of the rates in ms; by default a round one."
    ),
]
InFormat = Annotated[PictureFormat, typer.Option("--format", metavar="png|pdf|svg", help="Format of the pictures.")]


def plot(
    file: File,
    out: Folder = None,
    between: Between = None,
    of: Of = [],  # noqa: B006
    bin: Bin = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw pictures of a run: spikes, rates and traces."""
    from neuro import plots
    from neuro.core.errors import ModelError
    from neuro.files.results import read
    from neuro.model.views import View, view_of_text

    results = read(file)
    window = None if between is None else tuple(moment(text) for text in between)
    populations = {name: results.laid(name) for name in results.populations}
    parts = [view_of_text(text, populations) for text in of]
    selection = [part if isinstance(part, View) else part.name for part in parts] or None
    whole = {part.name for part in parts if not isinstance(part, View)}
    views = [part for part in parts if isinstance(part, View) and part.population.name not in whole]
    names = {*whole, *(view.population.name for view in views)}
    probes = [
        name
        for name, trace in results.traces.items()
        if not of or (trace.population in names and _overlaps(trace, views))
    ]
    draw: dict[str, Callable[[], Figure]] = {}
    if of or any(train.recorded for train in results.populations.values()):
        draw["raster"] = lambda: plots.raster(results, selection, window=window)
        draw["rates"] = lambda: plots.rate(results, selection, bin=bin, window=window)
    if probes:
        draw["traces"] = lambda: plots.trace(results, probes, of=views, window=window)
    if not draw:
        raise ModelError(f"{file}: contains neither spikes nor traces", hint="'neuro run --record NAME' records spikes")
    pictures = ((f"{file.stem}-{kind}", picture()) for kind, picture in draw.items())
    write_pictures(pictures, file.parent if out is None else out, format)


def write_pictures(pictures: Iterable[tuple[str, Figure]], folder: Path, format: PictureFormat) -> None:
    """Write named pictures into a folder, which is created if necessary, and print the path of each."""
    from neuro.core.outputs import make_folder
    from neuro.core.pictures import write_picture

    make_folder(folder)
    for name, picture in pictures:
        path = folder / f"{name}.{format.value}"
        write_picture(path, picture)
        typer.echo(path)


def _overlaps(trace: Trace, views: Sequence[View]) -> bool:
    """Return True if a trace has a neuron in one of the views, or if no view has the population of the trace."""
    own_views = [view for view in views if view.population.name == trace.population]
    if not own_views or trace.single or trace.ids is None:
        return True
    return bool(set(trace.ids.tolist()) & {neuron for view in own_views for neuron in view.ids.tolist()})


PageOut = Annotated[Path | None, typer.Option(metavar="FILE", help="HTML page; by default FILE with the ending .html.")]
ChipName = Annotated[
    str, typer.Option("--chip", metavar="NAME", help="Chip, or file of a chip's table, whose energy is reported.")
]

ENDINGS = (".html", ".htm")


def report(file: File, out: PageOut = None, chip: ChipName = "loihi") -> None:
    """Write an HTML page about a run: spikes, rates, traces, weights, counts and the energy on a chip."""
    from neuro.chips.known import chip as known
    from neuro.core.errors import ModelError
    from neuro.core.outputs import check_output, output
    from neuro.files.results import read
    from neuro.pages.report import PAGE, page

    path = file.with_suffix(".html") if out is None else out
    check_output(path, PAGE)
    if path.suffix.lower() not in ENDINGS:
        raise ModelError(f"--out {path}: expected a name ending in .html")
    known(chip)
    results = read(file)
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(results, file, chip)), "utf-8")
    typer.echo(f"{path}: written")
