"""Networks of other tools: `neuro convert`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from neuro.cli.options import memory_size, milliseconds

if TYPE_CHECKING:
    from neuro.exchange.verdict import Verdicts
    from neuro.model.network import Network


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says beside the files.

    Attributes:
        dt: length of a step in ms, None if not given.
        written_by: the tool that wrote the source, None if not given.
        read_by: the tool that is to read the destination, None if not given.
        reset: what a spike does, or of lava-dl the steps between two resets of states, None if not given.
        pynn: how a script of PyNN is run; its words are those of `neuro.from_pynn`.
        seed: of what is drawn where a network is written with its draws.
        duration: ms for which a script written for PyNN runs, or a test in C, None if not given.
        c: how C is written; its words are those of `neuro.save_c`.
        recording: that the test in C shows to the network, None if not given.
    """

    dt: float | None
    written_by: str | None
    read_by: str | None
    reset: str | None
    pynn: dict[str, Any]
    seed: int
    duration: float | None
    c: dict[str, Any]
    recording: Path | None


def _read_yaml(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.model.language import load

    return load(file), None


def _read_nir(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.exchange.nir.assumed import examine_file
    from neuro.exchange.nir.importing import network_of

    found, note = examine_file(file, options.dt, options.written_by, options.reset)
    table = replace(found.table(), note=note)
    return None if table.refused else network_of(found), table


def _read_pynn(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.exchange.pynn.kernel import not_held
    from neuro.exchange.pynn.read import from_pynn

    for sentence in not_held() if options.pynn["run_script"] else ():
        typer.echo(f"warning: {sentence}", err=True)
    net = from_pynn(file, **options.pynn)
    return net, net.verdicts


def _read_netx(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.core.errors import ModelError
    from neuro.exchange.netx import examine_netx

    if options.reset is not None and not options.reset.isdigit():
        raise ModelError(f"--reset {options.reset}: expected a number of steps, of a network of lava-dl")
    return examine_netx(file, reset=int(options.reset or 0))


def _write_yaml(net: Network, file: Path, options: Options) -> Verdicts | None:
    net.save(file)
    return None


def _write_nir(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro.exchange.nir.exporting import save_nir

    return save_nir(net, file, options.dt, options.read_by)


def _write_sonata(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro.exchange.sonata import save_sonata
    from neuro.run.compiled import compile

    return save_sonata(compile(net), file)


def _write_pynn(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro.exchange.pynn.write import to_pynn

    return to_pynn(net, file, seed=options.seed, duration=options.duration)


def _write_c(net: Network, folder: Path, options: Options) -> Verdicts | None:
    from neuro.exchange.c_code.export import save_c

    words = dict(options.c, seed=options.seed, duration=options.duration)
    if options.recording is not None:
        words["given"] = _shown(net, options.recording)
    typer.echo(str(save_c(net, folder, **words)))
    return None


def _shown(net: Network, file: Path) -> dict[str, tuple[Any, Any]]:
    """The spikes of the network's pixels in a recording: steps, from 1, and neurons."""
    from neuro.readout.asked import Pixels, gather, load, readout_of

    first, readout = gather([file], None, False).samples[0], readout_of(net)
    step, neuron = Pixels(net, readout).spikes(load(first), str(first.path))
    return {readout.input: (step + 1, neuron)}


READERS: dict[str, Callable[[Path, Options], tuple[Network | None, Verdicts | None]]] = {
    ".yaml": _read_yaml,
    ".yml": _read_yaml,
    ".nir": _read_nir,
    ".net": _read_netx,
    ".py": _read_pynn,
}
"""What reads a network and says what becomes of its nodes, by the ending of a file; no network if one is refused."""

WRITERS: dict[str, Callable[[Network, Path, Options], Verdicts | None]] = {
    ".yaml": _write_yaml,
    ".yml": _write_yaml,
    ".nir": _write_nir,
    ".json": _write_sonata,
    ".py": _write_pynn,
    "c": _write_c,
}
"""What writes one, by the ending of a file, or by the word of --to."""

READING = {
    ".nir": ("--resolution", "--from", "--reset"),
    ".net": ("--reset",),
    ".py": ("--run-script", "--arguments", "--network"),
}
WRITING = {
    ".nir": ("--resolution", "--to"),
    ".py": ("--seed", "--for"),
    "c": ("--chip", "--name", "--ram", "--flash", "--frozen", "--recording", "--seed", "--for"),
}
"""By the ending of IN, and of OUT or the word of --to, the options that are for it alone."""

Source = Annotated[Path, typer.Argument(metavar="IN", help="The network to read.")]
Destination = Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")]
Resolution = Annotated[
    float | None, typer.Option("--resolution", metavar="MS", parser=milliseconds, help="Length of a step, in ms.")
]
From = Annotated[
    str | None, typer.Option("--from", metavar="TOOL", help="The tool that wrote IN: norse, snntorch, sinabs, ...")
]
To = Annotated[
    str | None,
    typer.Option(
        "--to",
        metavar="TOOL",
        help="The tool that reads OUT: norse, snntorch, sinabs, spikingjelly or nir; or c: OUT is a folder for C99.",
    ),
]
Reset = Annotated[
    str | None,
    typer.Option(
        "--reset",
        metavar="WORD",
        help="What a spike does in IN: to_value, to_value_next, subtract or subtract_next; "
        "of lava-dl's networks the steps between two resets.",
    ),
]
RunScript = Annotated[
    bool, typer.Option("--run-script", help="Run IN, a script of PyNN, in a confined process that simulates nothing.")
]
Arguments = Annotated[
    str | None, typer.Option("--arguments", metavar="TEXT", help="What IN reads from its command line.")
]
Which = Annotated[
    int | None, typer.Option("--network", metavar="N", help="Which network of IN, from 1; else the last.")
]
Seconds = Annotated[float, typer.Option("--seconds", metavar="S", help="How long IN may take.")]
Memory = Annotated[float, typer.Option("--memory", metavar="GIB", help="How much memory IN may use.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", metavar="N", help="Of what is drawn and written into the file beside OUT; else 0."),
]
Duration = Annotated[
    float | None,
    typer.Option("--for", metavar="MS", parser=milliseconds, help="How long OUT runs; random trains are then written."),
]
OfChip = Annotated[
    str | None,
    typer.Option("--chip", metavar="NAME", help="Whose integers: loihi (default), loihi2 or spinnaker."),
]
Name = Annotated[str | None, typer.Option("--name", metavar="WORD", help="With which names in C begin; else net.")]
Ram = Annotated[
    int | None, typer.Option("--ram", metavar="SIZE", parser=memory_size, help="RAM that C may take, such as 64K.")
]
Flash = Annotated[
    int | None, typer.Option("--flash", metavar="SIZE", parser=memory_size, help="Flash that C may take, such as 1M.")
]
Frozen = Annotated[bool, typer.Option("--frozen", help="Leave out in C what learns: weights stay as they are in IN.")]
Recorded = Annotated[
    Path | None, typer.Option("--recording", metavar="REC", help="Of an event camera, that the test in C shows.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the verdicts as JSON instead of a table.")]


def convert(
    source: Source,
    destination: Destination,
    resolution: Resolution = None,
    written_by: From = None,
    to: To = None,
    reset: Reset = None,
    as_json: Json = False,
    run_script: RunScript = False,
    arguments: Arguments = None,
    network: Which = None,
    seconds: Seconds = 120.0,
    memory: Memory = 4.0,
    seed: Seed = None,
    duration: Duration = None,
    chip: OfChip = None,
    name: Name = None,
    ram: Ram = None,
    flash: Flash = None,
    frozen: Frozen = False,
    recording: Recorded = None,
) -> None:
    """Convert a network from or to the format of another tool, chosen by the endings, with a verdict for each node.

    With --to c it is written as C99 for a microcontroller, with the spikes and states of an emulated chip.
    """
    form = _form(destination, to)
    read_by = None if to in WRITERS else to
    read, write = _of(READERS, source, "read"), WRITERS[form]
    given: dict[str, object] = {"--resolution": resolution, "--from": written_by, "--to": read_by, "--reset": reset}
    given |= {"--run-script": run_script or None, "--arguments": arguments, "--network": network}
    given |= {"--seed": seed, "--for": duration, "--frozen": frozen or None, "--recording": recording}
    given |= (of_c := {"--chip": chip, "--name": name, "--ram": ram, "--flash": flash})
    _check_options([word for word, value in given.items() if value is not None], source, destination, form)
    pynn: dict[str, Any] = {"run_script": run_script, "network": network, "seconds": seconds, "memory": memory}
    pynn["arguments"] = None if arguments is None else shlex.split(arguments)
    c = {word.lstrip("-"): value for word, value in of_c.items() if value is not None} | {"frozen": frozen}
    options = Options(resolution, written_by, read_by, reset, pynn, seed or 0, duration, c, recording)
    with _in_options():
        net, table = read(source, options)
        if net is not None:
            table = write(net, destination, options) or table
        if table is not None:
            nodes = tuple(replace(each, way_out=_as_option(each.way_out)) for each in table)
            table = replace(table, nodes=nodes)
            typer.echo(table.to_json() if as_json else str(table))
            table.check()


ARGUMENTS = {
    "dt": "--resolution",
    "from_": "--from",
    "for_": "--to",
    "reset": "--reset",
    "run_script": "--run-script",
    "network": "--network",
    "seconds": "--seconds",
    "memory": "--memory",
    "seed": "--seed",
    "duration": "--for",
    "chip": "--chip",
    "name": "--name",
    "ram": "--ram",
    "flash": "--flash",
    "frozen": "--frozen",
}
"""The options that take the place of arguments in Python."""

_WORDS = "|".join(ARGUMENTS)
_IN_PYTHON = re.compile(r" \(\w+=True\)")
_CALL = re.compile(r"^(?:from|to|save)_(?:nir|pynn|netx|sonata|c): ")
_FLAG = re.compile(rf"(?<!in Python )\b({_WORDS})=True\b")
_VALUE = re.compile(rf"(?<![\w'])(?<!in Python )({_WORDS}) ?= ?(?:'([\w-]+)'|(?=\S))")
_BARE = re.compile(r"\b(dt|from_|for_)(?= is\b|$|:|,)")


def _as_option(text: str) -> str:
    """A message with the options of the command line in place of Python's arguments."""
    text = _CALL.sub("", _IN_PYTHON.sub("", text)).replace("for_=None", "--to nir")
    text = _FLAG.sub(lambda match: ARGUMENTS[match[1]], text)
    text = _VALUE.sub(lambda match: f"{ARGUMENTS[match[1]]} {match[2] or ''}", text)
    return _BARE.sub(lambda match: ARGUMENTS[match[1]], re.sub(r"\ba ((?:smaller )?)dt\b", r"a \1--resolution", text))


@contextmanager
def _in_options() -> Iterator[None]:
    """Tell mistakes in the words of the command line."""
    from neuro.core.errors import ModelError

    def told(error: ModelError) -> ModelError:
        others = tuple(told(each) for each in error.others)
        return error.but(message=_as_option(error.message), hint=_as_option(error.hint), others=others)

    try:
        yield
    except ModelError as error:
        raise told(error) from None


def _of(table: dict[str, T], file: Path, done: str, hint: str = "") -> T:
    from neuro.core.errors import ModelError

    if file.suffix not in table:
        raise ModelError(f"{file}: cannot be {done}: expected a name ending in {', '.join(sorted(table))}", hint=hint)
    return table[file.suffix]


def _form(destination: Path, to: str | None) -> str:
    """What is written: a word of `WRITERS` that --to gives, or the ending of a file."""
    from neuro.core.errors import ModelError

    words = [word for word in WRITERS if not word.startswith(".")]
    if to in words:
        return to
    ends = {end: write for end, write in WRITERS.items() if end not in words}
    if to is not None and destination.suffix not in ends:
        raise ModelError(f"--to {to}: expected {' or '.join(words)}", hint="other formats are chosen by OUT's ending")
    _of(ends, destination, "written", "--to c writes C into a folder of that name")
    return destination.suffix


def _check_options(given: list[str], source: Path, destination: Path, form: str) -> None:
    """Refuse options that neither file has a use for."""
    from neuro.core.errors import ModelError

    used = (*READING.get(source.suffix, ()), *WRITING.get(form, ()))
    for word in given:
        if word not in used:
            sides = (("IN", READING), ("OUT", WRITING))
            ends = [_wish(side, end) for side, table in sides for end in table if word in table[end]]
            raise ModelError(f"{word}: has no use from {source} to {destination}: expected {', or '.join(ends)}")


def _wish(side: str, end: str) -> str:
    """What an option is for."""
    return f"{side} to end in {end}" if end.startswith(".") else f"--to {end}"
