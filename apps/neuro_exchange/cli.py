"""The command `neuro convert`: networks from and to other tools."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

import typer

from neuro import ModelError
from neuro.apps import milliseconds, option, with_settings

if TYPE_CHECKING:
    from neuro import Network
    from neuro_exchange.verdict import Verdicts


T = TypeVar("T")


def memory_size(text: str) -> int:
    """Return a size of memory in bytes, e.g. 65536 for "64K". K is 1024 bytes, M is 1024 K.

    Raises:
        typer.BadParameter: the text is not a size.
    """
    units = {"K": 1 << 10, "M": 1 << 20}
    digits, unit = (text[:-1], units[text[-1]]) if text[-1:] in units else (text, 1)
    if not digits.isascii() or not digits.isdigit():
        raise typer.BadParameter(f"'{text}': expected a number of bytes, such as 65536, 64K or 1M")
    return int(digits) * unit


class Use(NamedTuple):
    """Formats that use an option.

    Attributes:
        reading: endings of IN.
        writing: endings of OUT, and values of --to.
    """

    reading: tuple[str, ...] = ()
    writing: tuple[str, ...] = ()


_NIR = "NIR (.nir) and lava-dl (.net)"
_READ_NIR: dict[str, Any] = {"use": Use((".nir",)), "panel": _NIR}
_READ_OR_WRITE_NIR: dict[str, Any] = {"use": Use((".nir",), (".nir",)), "panel": _NIR}
_READ_NIR_OR_NETX: dict[str, Any] = {"use": Use((".nir", ".net")), "panel": _NIR}
_LIMIT: dict[str, Any] = {"panel": "Reading a PyNN script (.py)"}
_PYNN: dict[str, Any] = {"use": Use((".py",)), **_LIMIT}
_SCRIPTS: dict[str, Any] = {"use": Use((), (".py", "c")), "panel": "Writing a PyNN script (.py) or C (--to c)"}
_C: dict[str, Any] = {"use": Use((), ("c",)), "panel": "Writing C (--to c)"}


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `neuro convert`. Fields have the names of the arguments in Python.

    An option without a `Use` is for all formats. None means that the user did not set the option.
    """

    for_: str | None = option(
        "--to TOOL",
        "Tool that reads the .nir OUT: norse, snntorch, sinabs, spikingjelly, nir (default); c: C99 in the folder OUT.",
        use=Use((), (".nir",)),
    )
    as_json: bool = option("--json", "Print the verdicts as JSON instead of a table.", False)
    from_: str | None = option(
        "--from TOOL",
        "Tool that wrote IN: norse, snntorch, sinabs, spikingjelly, spyx, rockpool or nir; default: as noted in IN, "
        "else nir.",
        **_READ_NIR,
    )
    dt: float | None = option(
        "--resolution MS",
        "Length of a step in ms; default: as noted in IN, else 1.",
        parser=milliseconds,
        **_READ_OR_WRITE_NIR,
    )
    reset: str | None = option(
        "--reset RULE",
        "Reset after a spike; default: by --from. One of to_value, to_value_next, subtract, subtract_next. "
        "For lava-dl: number of steps between two resets of the network.",
        **_READ_NIR_OR_NETX,
    )
    run_script: bool = option(
        "--run-script",
        "Allow IN to run, without simulation or access to other files. Without this option no script is read.",
        False,
        **_PYNN,
    )
    arguments: str | None = option("--arguments TEXT", "Command-line arguments for IN.", **_PYNN)
    network: int | None = option("--network N", "Number of the network in IN, from 1; default: the last.", **_PYNN)
    seconds: float = option("--seconds S", "Time limit of IN in seconds.", 120.0, **_LIMIT)
    memory: float = option("--memory GIB", "Memory limit of IN in GiB.", 4.0, **_LIMIT)
    seed: int | None = option("--seed N", "Seed of random parameters and connections; default: 0.", **_SCRIPTS)
    duration: float | None = option(
        "--for MS",
        "Duration of the run in OUT in ms; PyNN then gets the spikes of random generators as lists. Default: in PyNN "
        "1000, with random generators; in C a few steps after the last spike.",
        parser=milliseconds,
        **_SCRIPTS,
    )
    chip: str | None = option("--chip NAME", "Chip to emulate: loihi (default), loihi2 or spinnaker.", **_C)
    name: str | None = option("--name WORD", "Prefix of the C names; default: net.", **_C)
    ram: int | None = option(
        "--ram SIZE", "Error if the program needs more RAM than this, e.g. 64K.", parser=memory_size, **_C
    )
    flash: int | None = option(
        "--flash SIZE", "Error if the program needs more flash than this, e.g. 1M.", parser=memory_size, **_C
    )
    frozen: bool = option("--frozen", "Leave out learning rules; weights stay as in IN.", False, **_C)
    recording: Path | None = option("--recording REC", "Event recording as input of the test of the C code.", **_C)

    def set_by_user(self, *names: str) -> dict[str, Any]:
        """Return the values of those of the named options that the user set."""
        values = ((name, getattr(self, name)) for name in names)
        return {name: value for name, value in values if value is not None and value is not False}


def _read_yaml(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro import load

    return load(file), None


def _read_nir(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.nir.importing import examine_file, network_of

    analysis, note = examine_file(file, options.dt, options.from_, options.reset)
    table = replace(analysis.table(), note=note)
    return None if table.refused else network_of(analysis), table


def _read_pynn(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.pynn.kernel import missing_restrictions
    from neuro_exchange.pynn.read import from_pynn

    for sentence in missing_restrictions() if options.run_script else ():
        typer.echo(f"warning: {sentence}", err=True)
    settings = options.set_by_user("run_script", "network", "seconds", "memory")
    arguments = None if options.arguments is None else shlex.split(options.arguments)
    net = from_pynn(file, arguments=arguments, **settings)
    return net, net.verdicts


def _read_netx(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.netx import examine_netx

    if options.reset is not None and not options.reset.isdigit():
        raise ModelError(
            f"--reset {options.reset}: expected the number of steps between two resets of a lava-dl network"
        )
    return examine_netx(file, reset=int(options.reset or 0))


def _write_yaml(net: Network, file: Path, options: Options) -> Verdicts | None:
    net.save(file)
    return None


def _write_nir(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro_exchange.nir.exporting import save_nir

    return save_nir(net, file, options.dt, options.for_)


def _write_sonata(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro import compile
    from neuro_exchange.sonata import save_sonata

    return save_sonata(compile(net), file)


def _write_pynn(net: Network, file: Path, options: Options) -> Verdicts | None:
    from neuro_exchange.pynn.write import to_pynn

    return to_pynn(net, file, seed=options.seed or 0, duration=options.duration)


def _write_c(net: Network, folder: Path, options: Options) -> Verdicts | None:
    from neuro_exchange.c_code.export import save_c

    settings = options.set_by_user("chip", "name", "ram", "flash", "frozen", "seed", "duration")
    if options.recording is not None:
        settings["given"] = _pixel_spikes(net, options.recording)
    typer.echo(str(save_c(net, folder, **settings)))
    return None


def _pixel_spikes(net: Network, file: Path) -> dict[str, tuple[Any, Any]]:
    """Return the spikes of the network's pixels in a recording: by input, arrays of steps (from 1) and of neurons."""
    from neuro.apps import app

    predict = app("neuro_predict.asked", "a recording shown to a C program")
    sample, readout = predict.gather([file], None, False).samples[0], predict.readout_of(net)
    step, neuron = predict.Pixels(net, readout).spikes(predict.load(sample), str(sample.path))
    return {readout.input: (step + 1, neuron)}


READERS: dict[str, Callable[[Path, Options], tuple[Network | None, Verdicts | None]]] = {
    ".yaml": _read_yaml,
    ".yml": _read_yaml,
    ".nir": _read_nir,
    ".net": _read_netx,
    ".py": _read_pynn,
}
"""For each ending of IN, the function that reads a file of this ending.

The function returns the network (None if a node is refused) and the verdicts (None if the format has no verdicts).
"""

WRITERS: dict[str, Callable[[Network, Path, Options], Verdicts | None]] = {
    ".yaml": _write_yaml,
    ".yml": _write_yaml,
    ".nir": _write_nir,
    ".json": _write_sonata,
    ".py": _write_pynn,
    "c": _write_c,
}
"""For each ending of OUT or value of --to, the function that writes a network and returns the verdicts, if any."""

ARGUMENTS: dict[str, str] = {entry.name: entry.metadata["name"] for entry in fields(Options)}
"""Names of the options by argument in Python, e.g. "--from" by "from_"."""
USES: dict[str, Use] = {entry.name: entry.metadata["use"] for entry in fields(Options) if "use" in entry.metadata}
"""Formats that use an option, for each option that is not for all formats."""


@with_settings
def convert(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="Network to read: .yaml, .nir, .py (PyNN) or .net (lava-dl).")
    ],
    destination: Annotated[
        Path, typer.Argument(metavar="OUT", help="File to write: .yaml, .nir, .py or .json (SONATA).")
    ],
    options: Options,
) -> None:
    """Convert a network from or to another tool, and print how exactly each part is converted.

    The endings of IN and OUT choose the formats. With --to c, OUT is a folder with C99 code for a microcontroller,
    which computes the same spikes and states as the emulated chip.
    """
    form = _output_format(destination, options.for_)
    if options.for_ == form:  # --to is the format, not a tool
        options = replace(options, for_=None)
    read, write = _by_ending(READERS, source, "read"), WRITERS[form]
    for name in options.set_by_user(*USES):
        use = USES[name]
        if source.suffix not in use.reading and form not in use.writing:
            formats = [f"IN to end in {end}" for end in use.reading]
            formats += [f"OUT to end in {end}" if end.startswith(".") else f"--to {end}" for end in use.writing]
            message = f"{ARGUMENTS[name]}: not used from {source} to {destination}: expected {', or '.join(formats)}"
            raise ModelError(message)
    with _messages_for_command_line():
        net, table = read(source, options)
        if net is not None:
            table = write(net, destination, options) or table
        if table is not None:
            nodes = tuple(replace(verdict, way_out=_as_option(verdict.way_out)) for verdict in table)
            table = replace(table, nodes=nodes)
            typer.echo(table.to_json() if options.as_json else str(table))
            table.check()


# Patterns of Python code in messages.
_NAMES = "|".join(ARGUMENTS)
_IN_PYTHON = re.compile(r" \(\w+=True\)")
_CALL = re.compile(r"^(?:from|to|save)_(?:nir|pynn|netx|sonata|c): ")
_FLAG = re.compile(rf"(?<!in Python )\b({_NAMES})=True\b")
_VALUE = re.compile(rf"(?<![\w'])(?<!in Python )({_NAMES}) ?= ?(?:'([\w-]+)'|(?=\S))")
_BARE = re.compile(r"\b(dt|from_|for_)(?= is\b|$|:|,)")


def _as_option(text: str) -> str:
    """Replace Python's arguments in a message by options, e.g. "from_='norse'" by "--from norse"."""
    text = _CALL.sub("", _IN_PYTHON.sub("", text)).replace("for_=None", "--to nir")
    text = _FLAG.sub(lambda match: ARGUMENTS[match[1]], text)
    text = _VALUE.sub(lambda match: f"{ARGUMENTS[match[1]]} {match[2] or ''}", text)
    return _BARE.sub(lambda match: ARGUMENTS[match[1]], re.sub(r"\ba ((?:smaller )?)dt\b", r"a \1--resolution", text))


@contextmanager
def _messages_for_command_line() -> Iterator[None]:
    """Name options instead of Python's arguments in errors."""

    def translate(error: ModelError) -> ModelError:
        other_errors = tuple(translate(inner) for inner in error.others)
        return error.but(message=_as_option(error.message), hint=_as_option(error.hint), others=other_errors)

    try:
        yield
    except ModelError as error:
        raise translate(error) from None


def _by_ending(table: dict[str, T], file: Path, action: str, hint: str = "") -> T:
    if file.suffix not in table:
        raise ModelError(f"{file}: cannot be {action}: expected a name ending in {', '.join(sorted(table))}", hint=hint)
    return table[file.suffix]


def _output_format(destination: Path, to: str | None) -> str:
    """Return the key of `WRITERS`: --to if it names a format, else the ending of OUT."""
    formats = [key for key in WRITERS if not key.startswith(".")]
    if to in formats:
        return to
    endings = {key: write for key, write in WRITERS.items() if key not in formats}
    if to is not None and destination.suffix not in endings:
        raise ModelError(f"--to {to}: expected {' or '.join(formats)}", hint="OUT's ending chooses other formats")
    _by_ending(endings, destination, "written", "--to c writes C into a folder of that name")
    return destination.suffix
