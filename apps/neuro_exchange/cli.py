"""Networks of other tools: `neuro convert`."""

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
    """A size of memory in bytes: a whole number, with K or M for 1024 or 1024 x 1024 of them."""
    units = {"K": 1 << 10, "M": 1 << 20}
    digits, unit = (text[:-1], units[text[-1]]) if text[-1:] in units else (text, 1)
    if not digits.isascii() or not digits.isdigit():
        raise typer.BadParameter(f"'{text}': expected a number of bytes, such as 65536, 64K or 1M")
    return int(digits) * unit


class Use(NamedTuple):
    """Formats that an option is for: endings of IN, and endings of OUT or words of --to."""

    reading: tuple[str, ...] = ()
    writing: tuple[str, ...] = ()


_NIR, _PYNN, _SCRIPTS, _C = Use((".nir",), (".nir",)), Use((".py",)), Use((), (".py", "c")), Use((), ("c",))
_TO = "The tool that reads OUT: norse, snntorch, sinabs, spikingjelly or nir; or c: OUT is a folder for C99."
_RESET = (
    "What a spike does in IN: to_value, to_value_next, subtract or subtract_next; "
    "of lava-dl's networks the steps between two resets."
)


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says beside the files; fields have the names of arguments in Python.

    An option without a `Use` is for all formats.
    """

    dt: float | None = option("--resolution MS", "Length of a step, in ms.", parser=milliseconds, use=_NIR)
    from_: str | None = option(
        "--from TOOL", "The tool that wrote IN: norse, snntorch, sinabs, ...", use=Use((".nir",))
    )
    for_: str | None = option("--to TOOL", _TO, use=Use((), (".nir",)))
    reset: str | None = option("--reset WORD", _RESET, use=Use((".nir", ".net")))
    as_json: bool = option("--json", "Print the verdicts as JSON instead of a table.", False)
    run_script: bool = option(
        "--run-script", "Run IN, a script of PyNN, in a confined process that simulates nothing.", False, use=_PYNN
    )
    arguments: str | None = option("--arguments TEXT", "What IN reads from its command line.", use=_PYNN)
    network: int | None = option("--network N", "Which network of IN, from 1; else the last.", use=_PYNN)
    seconds: float = option("--seconds S", "How long IN may take.", 120.0)
    memory: float = option("--memory GIB", "How much memory IN may use.", 4.0)
    seed: int | None = option(
        "--seed N", "Of what is drawn and written into the file beside OUT; else 0.", use=_SCRIPTS
    )
    duration: float | None = option(
        "--for MS", "How long OUT runs; random trains are then written.", parser=milliseconds, use=_SCRIPTS
    )
    chip: str | None = option("--chip NAME", "Whose integers: loihi (default), loihi2 or spinnaker.", use=_C)
    name: str | None = option("--name WORD", "With which names in C begin; else net.", use=_C)
    ram: int | None = option("--ram SIZE", "RAM that C may take, such as 64K.", parser=memory_size, use=_C)
    flash: int | None = option("--flash SIZE", "Flash that C may take, such as 1M.", parser=memory_size, use=_C)
    frozen: bool = option("--frozen", "Leave out in C what learns: weights stay as they are in IN.", False, use=_C)
    recording: Path | None = option("--recording REC", "Of an event camera, that the test in C shows.", use=_C)

    def given(self, *names: str) -> dict[str, Any]:
        """The values of some options that the user has given."""
        values = ((name, getattr(self, name)) for name in names)
        return {name: value for name, value in values if value is not None and value is not False}


def _read_yaml(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro import load

    return load(file), None


def _read_nir(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.nir.importing import examine_file, network_of

    found, note = examine_file(file, options.dt, options.from_, options.reset)
    table = replace(found.table(), note=note)
    return None if table.refused else network_of(found), table


def _read_pynn(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.pynn.kernel import not_held
    from neuro_exchange.pynn.read import from_pynn

    for sentence in not_held() if options.run_script else ():
        typer.echo(f"warning: {sentence}", err=True)
    words = options.given("run_script", "network", "seconds", "memory")
    arguments = None if options.arguments is None else shlex.split(options.arguments)
    net = from_pynn(file, arguments=arguments, **words)
    return net, net.verdicts


def _read_netx(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro_exchange.netx import examine_netx

    if options.reset is not None and not options.reset.isdigit():
        raise ModelError(f"--reset {options.reset}: expected a number of steps, of a network of lava-dl")
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

    words = options.given("chip", "name", "ram", "flash", "frozen", "seed", "duration")
    if options.recording is not None:
        words["given"] = _shown(net, options.recording)
    typer.echo(str(save_c(net, folder, **words)))
    return None


def _shown(net: Network, file: Path) -> dict[str, tuple[Any, Any]]:
    """The spikes of the network's pixels in a recording: steps, from 1, and neurons."""
    from neuro.apps import app

    asked = app("neuro_predict.asked", "a recording shown to a C program")
    first, readout = asked.gather([file], None, False).samples[0], asked.readout_of(net)
    step, neuron = asked.Pixels(net, readout).spikes(asked.load(first), str(first.path))
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

ARGUMENTS: dict[str, str] = {one.name: one.metadata["name"] for one in fields(Options)}
"""The options that take the place of arguments in Python."""
USES: dict[str, Use] = {one.name: one.metadata["use"] for one in fields(Options) if "use" in one.metadata}
"""What options are for that not all formats have."""


@with_settings
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="The network to read.")],
    destination: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")],
    options: Options,
) -> None:
    """Convert a network from or to the format of another tool, chosen by the endings, with a verdict for each node.

    With --to c it is written as C99 for a microcontroller, with the spikes and states of an emulated chip.
    """
    form = _form(destination, options.for_)
    if options.for_ == form:  # --to names what is written, and no tool
        options = replace(options, for_=None)
    read, write = _of(READERS, source, "read"), WRITERS[form]
    for name in options.given(*USES):
        use = USES[name]
        if source.suffix not in use.reading and form not in use.writing:
            ends = [f"IN to end in {end}" for end in use.reading]
            ends += [f"OUT to end in {end}" if end.startswith(".") else f"--to {end}" for end in use.writing]
            message = f"{ARGUMENTS[name]}: has no use from {source} to {destination}: expected {', or '.join(ends)}"
            raise ModelError(message)
    with _in_options():
        net, table = read(source, options)
        if net is not None:
            table = write(net, destination, options) or table
        if table is not None:
            nodes = tuple(replace(each, way_out=_as_option(each.way_out)) for each in table)
            table = replace(table, nodes=nodes)
            typer.echo(table.to_json() if options.as_json else str(table))
            table.check()


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

    def told(error: ModelError) -> ModelError:
        others = tuple(told(each) for each in error.others)
        return error.but(message=_as_option(error.message), hint=_as_option(error.hint), others=others)

    try:
        yield
    except ModelError as error:
        raise told(error) from None


def _of(table: dict[str, T], file: Path, done: str, hint: str = "") -> T:
    if file.suffix not in table:
        raise ModelError(f"{file}: cannot be {done}: expected a name ending in {', '.join(sorted(table))}", hint=hint)
    return table[file.suffix]


def _form(destination: Path, to: str | None) -> str:
    """What is written: a word of `WRITERS` that --to gives, or the ending of a file."""
    words = [word for word in WRITERS if not word.startswith(".")]
    if to in words:
        return to
    ends = {end: write for end, write in WRITERS.items() if end not in words}
    if to is not None and destination.suffix not in ends:
        raise ModelError(f"--to {to}: expected {' or '.join(words)}", hint="other formats are chosen by OUT's ending")
    _of(ends, destination, "written", "--to c writes C into a folder of that name")
    return destination.suffix
