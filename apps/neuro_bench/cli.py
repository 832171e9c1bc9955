"""Run the field's benchmarks: spiking networks beside what is not spiking, on the same data with the same tries."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import Bar, Set, assignments, at_least, check_output, resumable, seeds

app = typer.Typer(
    name="bench", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)
Option = typer.Option


@app.command()
def tasks() -> None:
    """List the tasks and the methods for them, with licences and sources."""
    from neuro.apps import console, table
    from neuro_bench.running import METHODS, TASKS

    rows = [(name, one.title, ", ".join(one.splits), one.metric) for name, one in TASKS.items()]
    console().print(table(("task", "is", "splits", "metric"), rows))
    for name, one in TASKS.items():
        typer.echo(f"{name}: {one.source}; licence: {one.licence}")  # addresses stay whole
    listed = [(name, one.title, one.kind, "yes" if one.spiking else "no") for name, one in METHODS.items()]
    console().print(table(("method", "is", "for", "spikes"), listed))


@app.command("run")
def run_method(
    task: Annotated[str, typer.Argument(metavar="TASK", help="See 'neuro bench tasks'.")],
    method: Annotated[str, Option("--method", metavar="NAME", help="See 'neuro bench tasks'.")],
    data: Annotated[Path | None, Option("--data", metavar="PATH", help="The data; none are downloaded.")] = None,
    split: Annotated[str | None, Option("--split", metavar="NAME", help="Which folds, such as speakers.")] = None,
    out: Annotated[Path | None, Option("--out", metavar="FILE", help="TASK-SPLIT-METHOD.json if not given.")] = None,
    tries: Annotated[
        int,
        Option(
            "--tries", metavar="N", parser=at_least(1), help="Settings to try in each fold, by its validation part."
        ),
    ] = 1,
    seeds: Annotated[tuple, Option("--seeds", metavar="A,B,...", parser=seeds, help="Each on all folds.")] = "0",  # type: ignore[assignment, type-arg]
    first_folds: Annotated[
        int | None, Option("--first-folds", metavar="N", parser=at_least(1), help="Only so many folds, the first.")
    ] = None,
    split_seed: Annotated[int, Option("--split-seed", metavar="N", min=0, help="Of folds that are drawn.")] = 0,
    threads: Annotated[int, Option("--threads", metavar="N", min=1, help="Threads to compute with.")] = 1,
    set: Set = [],  # noqa: B006
) -> None:
    """Run a method on the folds of a task, print its row and write all figures as JSON.

    --set changes a setting in all tries: --set hidden=256.
    """
    from importlib.util import find_spec

    from neuro_bench import report
    from neuro_bench.running import KEPT, Request, run

    asked = Request(
        task=task,
        method=method,
        data=data,
        split=split,
        tries=tries,
        seeds=tuple(seeds),
        folds=first_folds,
        changes=assignments(set),
        split_seed=split_seed,
    )
    made, _ = asked.made()
    file = out or Path(f"{task}-{made.split}-{method}.json")
    kept = file.with_suffix(".folds")
    check_output(file, report.RESULT)
    check_output(kept, KEPT.kind)
    if find_spec("torch") is not None:
        import torch

        torch.set_num_threads(threads)
    with resumable(), Bar() as bar:
        found = run(asked, lambda what, done, total: bar.show(done, total, what), kept)
    report.write(found, file)
    kept.unlink()
    report.show([report.read(file)])
    typer.echo(f"{file}: written")


@app.command()
def compare(
    results: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Results of 'run', of one task.")],
) -> None:
    """Print results of one task as a table; its first line says who wins."""
    from neuro_bench import report

    report.show([report.read(file) for file in results])
