"""Compare spiking and non-spiking methods on benchmark tasks, with the same data and number of tries."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import Bar, assignments, at_least, check_output, resumable, seeds

app = typer.Typer(
    name="bench", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)
Option = typer.Option


@app.command()
def tasks() -> None:
    """List the tasks and the methods for them, with licences and sources."""
    from neuro.apps import console, table
    from neuro_bench.running import METHODS, TASKS

    task_rows = [(name, task.title, ", ".join(task.splits), task.metric) for name, task in TASKS.items()]
    console().print(table(("task", "description", "splits", "metric"), task_rows))
    for name, task in TASKS.items():
        typer.echo(f"{name}: {task.source}; licence: {task.licence}")  # no table, which would break addresses
    method_rows = [(name, m.title, m.kind, "yes" if m.spiking else "no") for name, m in METHODS.items()]
    console().print(table(("method", "description", "for", "spikes"), method_rows))


@app.command("run")
def run_method(
    task: Annotated[str, typer.Argument(metavar="TASK", help="Task of 'neuro bench tasks'.")],
    method: Annotated[str, Option("--method", metavar="NAME", help="Method of 'neuro bench tasks'.")],
    data: Annotated[
        Path | None, Option("--data", metavar="PATH", help="File or folder of the data; nothing is downloaded.")
    ] = None,
    split: Annotated[
        str | None,
        Option("--split", metavar="NAME", help="Split into folds, e.g. speakers; default: the task's first."),
    ] = None,
    out: Annotated[
        Path | None, Option("--out", metavar="FILE", help="JSON file of the result; by default TASK-SPLIT-METHOD.json.")
    ] = None,
    tries: Annotated[
        int,
        Option(
            "--tries",
            metavar="N",
            parser=at_least(1),
            help="Number of settings tried in each fold; the validation part selects one.",
        ),
    ] = 1,
    seeds: Annotated[
        tuple,  # type: ignore[type-arg]
        Option("--seeds", metavar="A,B,...", parser=seeds, help="Seeds of the method, each for all folds."),
    ] = "0",  # type: ignore[assignment]
    first_folds: Annotated[
        int | None, Option("--first-folds", metavar="N", parser=at_least(1), help="First N folds; default: all.")
    ] = None,
    split_seed: Annotated[int, Option("--split-seed", metavar="N", min=0, help="Seed of random folds.")] = 0,
    threads: Annotated[int, Option("--threads", metavar="N", min=1, help="Number of threads.")] = 1,
    set: Annotated[
        list[str],
        Option("--set", metavar="NAME=VALUE", help="Setting of the method in all tries, e.g. hidden=256; repeatable."),
    ] = [],  # noqa: B006
) -> None:
    """Train and test a method on the folds of a task; print a table row and write all figures as JSON."""
    from importlib.util import find_spec

    from neuro_bench import report
    from neuro_bench.running import KEPT, Request, run

    request = Request(
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
    task_object, _ = request.made()
    file = out or Path(f"{task}-{task_object.split}-{method}.json")
    unfinished = file.with_suffix(".folds")
    check_output(file, report.RESULT)
    check_output(unfinished, KEPT.kind)
    if find_spec("torch") is not None:
        import torch

        torch.set_num_threads(threads)
    with resumable(), Bar() as bar:
        result = run(request, lambda label, n_done, n_total: bar.show(n_done, n_total, label), unfinished)
    report.write(result, file)
    unfinished.unlink()
    report.show([report.read(file)])
    typer.echo(f"{file}: written")


@app.command()
def compare(
    results: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Results of 'run', of one task.")],
) -> None:
    """Print the results of one task as a table; the first line names the best method."""
    from neuro_bench import report

    report.show([report.read(file) for file in results])
