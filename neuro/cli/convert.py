"""Networks of other tools: `neuro convert`."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from neuro.cli.options import milliseconds

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
        reset: what a spike does, None if not given.
        pynn: how a script of PyNN is run; its words are those of `neuro.from_pynn`.
        seed: of what is drawn where a network is written with its draws.
        duration: ms for which a script written for PyNN runs, None if not given.
    """

    dt: float | None
    written_by: str | None
    read_by: str | None
    reset: str | None
    pynn: dict[str, Any]
    seed: int
    duration: float | None


def _read_yaml(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.model.language import load

    return load(file), None


def _read_nir(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.core.errors import ModelError
    from neuro.exchange.nir.importing import examine, network_of

    if options.dt is None:
        raise ModelError(f"{file}: NIR has no steps: expected the length of one", hint="--dt 1, in ms")
    found = examine(file, options.dt, options.written_by, options.reset)
    table = found.table()
    return None if table.refused else network_of(found), table


def _read_pynn(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.exchange.pynn.read import from_pynn

    net = from_pynn(file, **options.pynn)
    return net, net.verdicts


def _read_netx(file: Path, options: Options) -> tuple[Network | None, Verdicts | None]:
    from neuro.exchange.netx import from_netx

    return from_netx(file), None


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
}
"""What writes one."""

READING = {".nir": ("--dt", "--from", "--reset"), ".py": ("--run-script", "--arguments", "--network")}
WRITING = {".nir": ("--dt", "--for"), ".py": ("--seed", "--duration")}
"""By the ending of SRC, and of DST, the options that are for it alone."""

Source = Annotated[Path, typer.Argument(metavar="SRC", help="The network to read.")]
Destination = Annotated[Path, typer.Argument(metavar="DST", help="The file to write.")]
Dt = Annotated[float | None, typer.Option("--dt", metavar="MS", parser=milliseconds, help="Length of a step, in ms.")]
From = Annotated[
    str | None, typer.Option("--from", metavar="TOOL", help="The tool that wrote SRC: norse, snntorch, sinabs, ...")
]
For = Annotated[
    str | None,
    typer.Option(
        "--for", metavar="TOOL", help="The tool that reads DST: norse, snntorch, sinabs, spikingjelly or nir."
    ),
]
Reset = Annotated[
    str | None,
    typer.Option(
        "--reset", metavar="WORD", help="What a spike does in SRC: to_value, to_value_next, subtract or subtract_next."
    ),
]
RunScript = Annotated[
    bool, typer.Option("--run-script", help="Run SRC, a script of PyNN, in a confined process that simulates nothing.")
]
Arguments = Annotated[
    str | None, typer.Option("--arguments", metavar="TEXT", help="What SRC reads from its command line.")
]
Which = Annotated[
    int | None, typer.Option("--network", metavar="N", help="Which network of SRC, from 1; else the last.")
]
Seconds = Annotated[float, typer.Option("--seconds", metavar="S", help="How long SRC may take.")]
Memory = Annotated[float, typer.Option("--memory", metavar="GIB", help="How much memory SRC may use.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", help="Of what is drawn and written into the file beside DST; else 0."),
]
Duration = Annotated[
    float | None,
    typer.Option(
        "--duration", metavar="MS", parser=milliseconds, help="How long DST runs; random trains are then written."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the verdicts as JSON instead of a table.")]


def convert(
    source: Source,
    destination: Destination,
    dt: Dt = None,
    written_by: From = None,
    read_by: For = None,
    reset: Reset = None,
    as_json: Json = False,
    run_script: RunScript = False,
    arguments: Arguments = None,
    network: Which = None,
    seconds: Seconds = 120.0,
    memory: Memory = 4.0,
    seed: Seed = None,
    duration: Duration = None,
) -> None:
    """Convert a network from or to the format of another tool, chosen by the endings, with a verdict for each node."""
    read, write = _of(READERS, source, "read"), _of(WRITERS, destination, "written")
    given: dict[str, object] = {"--dt": dt, "--from": written_by, "--for": read_by, "--reset": reset}
    given |= {"--run-script": run_script or None, "--arguments": arguments, "--network": network}
    given |= {"--seed": seed, "--duration": duration}
    _check_options([word for word, value in given.items() if value is not None], source, destination)
    pynn: dict[str, Any] = {"run_script": run_script, "network": network, "seconds": seconds, "memory": memory}
    pynn["arguments"] = None if arguments is None else shlex.split(arguments)
    options = Options(dt, written_by, read_by, reset, pynn, seed or 0, duration)
    net, table = read(source, options)
    if net is not None:
        table = write(net, destination, options) or table
    if table is not None:
        typer.echo(table.to_json() if as_json else str(table))
        table.check()


def _of(table: dict[str, T], file: Path, done: str) -> T:
    from neuro.core.errors import ModelError

    if file.suffix not in table:
        raise ModelError(f"{file}: cannot be {done}: expected a name ending in {', '.join(sorted(table))}")
    return table[file.suffix]


def _check_options(given: list[str], source: Path, destination: Path) -> None:
    """Refuse options that neither file has a use for."""
    from neuro.core.errors import ModelError

    used = (*READING.get(source.suffix, ()), *WRITING.get(destination.suffix, ()))
    for word in given:
        if word not in used:
            sides = (("SRC", READING), ("DST", WRITING))
            ends = [f"{side} to end in {end}" for side, table in sides for end in table if word in table[end]]
            raise ModelError(f"{word}: has no use from {source} to {destination}: expected {', or '.join(ends)}")
