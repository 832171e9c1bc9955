"""Commands that compare backends with each other, and with golden traces: `neuro compare` and `neuro verify`."""

from __future__ import annotations

import json
import math
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import Backends, Duration, NetworkFile, Seed, Set, Threads, assignments, name_list, stoppable

if TYPE_CHECKING:
    from neuro.compare.result import Comparison
    from neuro.model.network import Network
    from neuro.testing.golden import Result

BACKENDS = "event,loihi,spinnaker"
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="JSON file of all numbers.")]
Rules = Annotated[
    bool,
    typer.Option(
        "--rules",
        help="Compare only loihi with loihi2: the integers that differ, each with the arithmetic rule behind it.",
    ),
]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="HTML page with numbers and pictures.")]


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
    """Run a network on several backends and compare spikes, weights, counts and energy with the first backend."""
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
        _check_alone({"--backends": backends != name_list(BACKENDS), "--out": out, "--html": html})
        _compare_rules(net, duration, seed, as_json)
        return
    _check_apart(html, out)
    with stoppable("nothing is compared") as bar, ExitStack() as files:
        page_part = files.enter_context(output(html, PAGE)) if html else None
        json_part = files.enter_context(output(out, JSON)) if out else None
        bar.say("preparing")
        comparison = run(net, backends, duration, seed, threads=threads, advance=lambda sim, n: advance(sim, n, bar))
        write(comparison, page_part, json_part)
    print_comparison(comparison, as_json, [file for file in (out, html) if file])


def _check_alone(options: dict[str, object]) -> None:
    """Refuse options that have no effect with --rules."""
    from neuro.core.errors import ModelError

    if names := [name for name, value in options.items() if value]:
        raise ModelError(f"{names[0]}: has no effect with --rules", hint="use --json to print the differences as JSON")


def _compare_rules(net: Network, duration: float, seed: int, as_json: bool) -> None:
    """Print the differences between the integers of a network on Loihi 1 and on Loihi 2."""
    from neuro.compare import loihi_rules

    differences = loihi_rules(net, duration, seed)
    typer.echo(json.dumps(asdict(differences), indent=2) if as_json else str(differences))


def write(comparison: Comparison, page_part: Path | None, json_part: Path | None) -> None:
    """Write the HTML page and the JSON file. A file whose path is None is not written."""
    from neuro.compare.report import PAGE, page
    from neuro.compare.result import JSON

    if page_part:
        page_part.write_text(PAGE.seal(page(comparison)), "utf-8")
    if json_part:
        content = {**comparison.as_dict(), "provenance": dict(comparison.record)}
        json_part.write_text(JSON.seal(json.dumps(content, indent=2) + "\n"), "utf-8")


def print_comparison(comparison: Comparison, as_json: bool, files: list[Path]) -> None:
    """Print a comparison and the paths of the files that were written."""
    from neuro.compare.cells import show
    from neuro.core.tables import console

    if as_json:
        typer.echo(json.dumps(comparison.as_dict(), indent=2))
        return
    show(comparison, console())
    for path in files:
        typer.echo(f"{path}: written")


def _check_apart(html: Path | None, out: Path | None) -> None:
    """Refuse the same file for the page and the JSON."""
    if html is not None and out is not None and html.resolve() == out.resolve():
        raise typer.BadParameter(f"'{out}' is the page already: expected another name", param_hint="'--out'")


Folder = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="Folder of golden traces: NAME.json and NAME.npz for each case.")
]
Chosen = Annotated[
    str | None,
    typer.Option(
        "--backend", metavar="NAME", help="Simulator or chip to verify; by default the traces' chip, or event."
    ),
]
VerifyJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def verify(folder: Folder, backend: Chosen = None, as_json: VerifyJson = False) -> None:
    """Compare a backend with golden traces (stored reference runs).

    The exit status is 1 if a value deviates by more than its limit.
    """
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
    """Return a result as data for JSON, with null for an infinite error, because JSON has no infinity."""
    return asdict(result) | ({} if math.isfinite(result.error) else {"error": None})


def print_results(results: list[Result]) -> None:
    """Print a row for each quantity of each case, and the number of cases that agree."""
    from neuro.core.tables import console, table

    columns = ("case", "quantity", ">deviation", ">accepted", "", "")
    rows = [
        (r.case, r.quantity, f"{r.error:.3g}", f"{r.limit:g}", "ok" if r.ok else "WRONG", r.message) for r in results
    ]
    console().print(table(columns, rows))
    cases = {result.case for result in results}
    failed_cases = {result.case for result in results if not result.ok}
    typer.echo(f"{len(cases) - len(failed_cases)} of {len(cases)} cases agree")
