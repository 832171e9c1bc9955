"""Backends side by side: `neuro compare`, and `neuro verify` beside golden traces."""

from __future__ import annotations

import json
import math
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import Backends, Duration, NetworkFile, Seed, Set, Threads, assignments, listed, stoppable

if TYPE_CHECKING:
    from neuro.compare.result import Comparison
    from neuro.model.network import Network
    from neuro.testing.golden import Result

BACKENDS = "event,loihi,spinnaker"
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="All figures as JSON.")]
Rules = Annotated[bool, typer.Option("--rules", help="Show where Loihi 1 and 2 give different integers, nothing else.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with pictures, too.")]


def compare(
    file: NetworkFile,
    backends: Backends = BACKENDS,
    duration: Duration = 1000.0,
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    as_json: Json = False,
    out: Out = None,
    html: Html = None,
    rules: Rules = False,
) -> None:
    """Run a network on several backends and compare spikes, weights, counts and joules with the first."""
    from neuro.compare import compare as run
    from neuro.compare.report import PAGE
    from neuro.compare.result import JSON
    from neuro.core.clock import Clock
    from neuro.core.outputs import output
    from neuro.core.progress import advance
    from neuro.model.language import load

    net = load(file, params=assignments(set))
    Clock(net.resolution).step(duration, "--for")
    if rules:
        _check_alone({"--backends": backends != listed(BACKENDS), "--out": out, "--html": html})
        _compare_rules(net, duration, seed, as_json)
        return
    _check_apart(html, out)
    with stoppable("nothing is compared") as bar, ExitStack() as files:
        page_part = files.enter_context(output(html, PAGE)) if html else None
        json_part = files.enter_context(output(out, JSON)) if out else None
        bar.say("preparing")
        found = run(net, backends, duration, seed, threads=threads, advance=lambda sim, n: advance(sim, n, bar))
        write(found, page_part, json_part)
    print_comparison(found, as_json, [file for file in (out, html) if file])


def _check_alone(given: dict[str, object]) -> None:
    """Refuse options for which --rules has no use."""
    from neuro.core.errors import ModelError

    if words := [word for word, value in given.items() if value]:
        raise ModelError(f"{words[0]}: has no use beside --rules", hint="--json prints the differences as JSON")


def _compare_rules(net: Network, duration: float, seed: int, as_json: bool) -> None:
    """Print where the rules of both Loihis differ."""
    from neuro.compare import loihi_rules

    found = loihi_rules(net, duration, seed)
    typer.echo(json.dumps(asdict(found), indent=2) if as_json else str(found))


def write(found: Comparison, page_part: Path | None, json_part: Path | None) -> None:
    """Write the files that are asked for."""
    from neuro.compare.report import PAGE, page
    from neuro.compare.result import JSON

    if page_part:
        page_part.write_text(PAGE.seal(page(found)), "utf-8")
    if json_part:
        content = {**found.as_dict(), "provenance": dict(found.record)}
        json_part.write_text(JSON.seal(json.dumps(content, indent=2) + "\n"), "utf-8")


def print_comparison(found: Comparison, as_json: bool, written: list[Path]) -> None:
    """Print a comparison, and which files there are."""
    from neuro.compare.cells import show
    from neuro.core.tables import console

    if as_json:
        typer.echo(json.dumps(found.as_dict(), indent=2))
        return
    show(found, console())
    for out in written:
        typer.echo(f"{out}: written")


def _check_apart(html: Path | None, out: Path | None) -> None:
    """Refuse to write two things to one file."""
    if html is not None and out is not None and html.resolve() == out.resolve():
        raise typer.BadParameter(f"'{out}' is the page already: expected another name", param_hint="'--out'")


Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Golden traces: NAME.json and NAME.npz of each case.")]
Chosen = Annotated[
    str | None,
    typer.Option("--backend", metavar="NAME", help="What to run on; if not given, the chip of the traces, or event."),
]
VerifyJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def verify(folder: Folder, backend: Chosen = None, as_json: VerifyJson = False) -> None:
    """Compare a backend with golden traces; the exit status is 1 if a value is wrong."""
    from neuro.core.progress import Bar
    from neuro.program.backend import find_backend
    from neuro.testing.verify import verify as compare

    with Bar() as bar:
        results = compare(folder, find_backend(backend) if backend else None, progress=bar.say)
    if as_json:
        typer.echo(json.dumps([figures_of(result) for result in results], indent=2))
    else:
        print_results(results)
    if not all(result.ok for result in results):
        raise typer.Exit(1)


def figures_of(result: Result) -> dict[str, Any]:
    """A result for JSON, which has no infinity: there the error is null."""
    return asdict(result) | ({} if math.isfinite(result.error) else {"error": None})


def print_results(results: list[Result]) -> None:
    """Print a row for each quantity of each case, and the sum of it."""
    from neuro.core.tables import console, table

    columns = ("case", "quantity", ">deviation", ">accepted", "", "")
    rows = [
        (r.case, r.quantity, f"{r.error:.3g}", f"{r.limit:g}", "ok" if r.ok else "WRONG", r.message) for r in results
    ]
    console().print(table(columns, rows))
    cases = {result.case for result in results}
    wrong = {result.case for result in results if not result.ok}
    typer.echo(f"{len(cases) - len(wrong)} of {len(cases)} cases agree")
