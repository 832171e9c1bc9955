"""Train a network by gradients on recordings of classes or targets; test it on simulators and emulated chips."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro import apps
from neuro_train.plan import TrainingPlan, augmentation, costs

if TYPE_CHECKING:
    from collections.abc import Mapping

    import neuro
    from neuro_train.data import BatchData

app = typer.Typer(
    name="train", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)

Option = typer.Option


# recordings
Data = Annotated[Path, Option("--data", metavar="PATH", help="Recordings: a folder, zip or HDF5; --loss mse: a .npz.")]
Part = Annotated[str, Option("--part", metavar="NAME", help="Part of the data set, e.g. Train or Test.")]
Without = Annotated[
    list[str], Option(metavar="PATTERN", help="Leave out recordings whose name matches, e.g. '*i.aedat'; repeatable.")
]
Test = Annotated[Path | None, Option("--test", metavar="FOLDER", help="Recordings to test on; default: no test.")]
Folds = Annotated[
    int | None, Option(metavar="N", parser=apps.at_least(2), help="Cross-validate with N folds, each tested once.")
]

# settings of the training beside the plan
Augment = Annotated[
    list[str],
    Option(
        "--augment",
        metavar="NAME=N",
        help="Augmentation: shift=2 (up to 2 px), warp=0.1 (rotation, scale, shear) or mirror=0.5 (half); repeatable.",
    ),
]
Threads = Annotated[int, Option(metavar="N", min=1, help="Number of threads.")]
Cost = Annotated[list[str], Option(metavar="CHIP=X", help="Energy penalty: loss per microjoule on CHIP; repeatable.")]

# results
Out = Annotated[Path, Option("--out", metavar="FILE", help="Network file to write.")]
Html = Annotated[Path | None, Option(metavar="FILE", help="HTML page to write; default: the name of --out with .html.")]
Search = Annotated[
    str | None,
    Option(
        "--search",
        metavar="A,B=1:2,...",
        help="Settings to vary for the front of accuracy and joules: A in its usual range, B from 1 to 2.",
    ),
]
Budget = Annotated[int, Option(metavar="N", min=1, help="Number of networks that --search trains.")]


@app.command()
@apps.with_settings
def train(
    file: apps.NetworkFile,
    data: Data,
    plan: TrainingPlan,
    out: Out = Path("trained.yaml"),
    part: Part = "Train",
    without: Without = [],  # noqa: B006
    test: Test = None,
    backends: apps.Backends = "event,loihi,spinnaker",
    folds: Folds = None,
    augment: Augment = [],  # noqa: B006
    cost: Cost = [],  # noqa: B006
    search: Search = None,
    budget: Budget = 20,
    html: Html = None,
    seed: apps.Seed = 0,
    threads: Threads = 1,
    set: apps.Set = [],  # noqa: B006
) -> None:
    """Train a network on recordings, test it and save it. Run the same command again to resume."""
    import neuro
    from neuro import ModelError

    if find_spec("torch") is None:
        raise ModelError("neuro train learns by PyTorch, which is not installed", hint=apps.install("torch"))
    import torch

    from neuro_events import recordings
    from neuro_train import telling
    from neuro_train.data import leaving_out, show

    plan = plan.changed({**augmentation(augment), "cost": costs(cost), "seed": seed})
    net = neuro.load(file, params=apps.assignments(set))
    torch.set_num_threads(threads)
    if plan.loss == "mse":
        class_options: Any = {"folds": folds, "search": search, "without": without, "augment": augment}
        class_options |= {"window": plan.window, "for": plan.duration != 100.0}
        class_options |= {"start": plan.start, "scale": plan.scale > 1}
        _train_on_targets(net, data, test, plan, class_options, backends, out, html or out.with_suffix(".html"))
        return
    if search is None:
        apps.Clock(net.resolution).step(plan.duration, "--for")
    if folds and test is not None:
        raise ModelError("--folds and --test: expected one of them", hint="--folds tests on held-out recordings")
    if html is not None and (folds or search):
        raise ModelError(
            f"--{'folds' if folds else 'search'} and --html: expected one of them", hint="a page shows one training"
        )
    _check_before(net, plan, backends if folds or test else [], out, html)
    training_recordings, unseen = leaving_out(recordings(data, part=part), without), None
    held_out = None if test is None or search else recordings(test, part="Test", classes=training_recordings.classes)
    page = html or out.with_suffix(".html")
    with apps.resumable():
        if search is not None:
            inputs = (file, data, part, without)
            _search(inputs, net, plan, apps.assignments(set), search, budget, folds, test, out.with_suffix(""))
            return
        with apps.Bar() as bar:
            count = partial(_count, bar)
            samples = show(net, training_recordings, plan, count)
            if folds:
                from neuro_train.search import cross_validate

                parts = training_recordings.folds(folds, seed=plan.seed)
                results = cross_validate(net, samples, parts, plan, backends, out, count)
            elif held_out is not None:
                unseen = show(net, held_out, plan, count, "test on recordings of the sensor of --data")
        if folds:
            telling.show_folds(results)
        else:
            _train(net, samples, unseen, plan, backends, out, page)


def _train_on_targets(
    net: neuro.Network,
    data: Path,
    test: Path | None,
    plan: TrainingPlan,
    class_options: Mapping[str, Any],
    backends: list[str],
    out: Path,
    page: Path,
) -> None:
    """Train on targets. The options in `class_options` are for recordings with classes and are refused if set."""
    from neuro import ModelError
    from neuro_train.data import check_network, read

    if refused := [name for name, value in class_options.items() if value]:
        raise ModelError(f"--{refused[0]}: is for recordings with classes: leave it out with --loss mse")
    check_network(net, plan)
    samples, test_samples = read(data, net, plan), None if test is None else read(test, net, plan)
    plan = replace(plan, duration=samples.events.steps * net.resolution)
    _check_before(net, plan, backends if test_samples else [], out, page)
    with apps.resumable():
        _train(net, samples, test_samples, plan, backends, out, page)


def _train(
    net: neuro.Network,
    samples: BatchData,
    unseen: BatchData | None,
    plan: TrainingPlan,
    backends: list[str],
    out: Path,
    page: Path,
) -> None:
    """Run one training; write the network, the page and the tests."""
    from neuro_train import telling
    from neuro_train.tested import train_and_test
    from neuro_train.trainer import training_checkpoint

    with apps.Bar() as bar:

        def tell(epoch: int, figures: Mapping[str, float]) -> None:
            energy = f", {1e6 * figures['joules']:.3g} uJ as fast as the chip can" if figures.get("joules") else ""
            grade = _grade(plan, figures["right"])
            bar.show(epoch, plan.epochs, f"epoch {epoch}: loss {figures['loss']:.4g}, {grade}{energy}")

        checkpoint = training_checkpoint(net, out, samples, plan)
        chips = ([plan.chip] if plan.bits else []) + ([] if unseen is None else backends)
        callbacks = tell, partial(_count, bar)
        trained, room, tests = train_and_test(net, out, samples, unseen, plan, backends, chips, checkpoint, *callbacks)
        telling.write(page, plan, trained, tests, len(samples), room)
        checkpoint.remove()
    telling.show(tests, room)
    figures = trained.curves
    if plan.epochs:
        share = figures["right"][-1]
        grade = (
            f"{_grade(plan, share)} on {len(samples)}" if plan.loss == "mse" else f"{share:.1%} of {len(samples)} right"
        )
        message = f"loss {figures['loss'][-1]:.4g}, {grade}"
        typer.echo(f"{plan.epochs} epoch{'s' * (plan.epochs > 1)}: {message}")
    for file in (out, page):
        typer.echo(f"{file}: written")


def _search(
    inputs: tuple[Path, Path, str, list[str]],
    net: neuro.Network,
    plan: TrainingPlan,
    params: Mapping[str, Any],
    text: str,
    budget: int,
    folds: int | None,
    test: Path | None,
    folder: Path,
) -> None:
    """Train networks that differ, and write the front of accuracy against joules."""
    from neuro import ModelError
    from neuro_train import telling
    from neuro_train.search import check_optuna, search as run_search, space

    if test is not None:
        problem = "--search and --test: a search tests on recordings of --data that it holds out: expected one of them"
        raise ModelError(problem, hint="test a network of the front: neuro train NETWORK --epochs 0 --test ...")
    check_optuna()
    parameters = {**apps.plain(apps.read(inputs[0], "a network", "neuro: 1")).get("parameters", {}), **params}
    varied = space(text, net, plan, parameters)
    with apps.Bar() as bar:
        places = run_search(*inputs, plan, params, varied, budget, folds, folder, bar.say)
    files = telling.write_front(folder, places, plan.chip)
    telling.show_front(places, plan.chip)
    for file in files:
        typer.echo(f"{file}: written")


def _count(bar: apps.Bar, activity: str, count: int, total: int) -> None:
    bar.show(count, total, activity)


def _grade(plan: TrainingPlan, share: float) -> str:
    """Return the share of right decisions, or R2, as text."""
    if plan.loss != "mse":
        return f"{share:.1%} right"
    from neuro_train.data import r_squared_text

    return r_squared_text(share)


def _check_before(net: neuro.Network, plan: TrainingPlan, backends: list[str], out: Path, page: Path | None) -> None:
    """Raise errors of the network, the files and the backends before the training."""
    import neuro
    import neuro_torch
    from neuro_train.data import check_network
    from neuro_train.telling import PAGE
    from neuro_train.trainer import module_of

    check_network(net, plan)
    apps.check_output(out, apps.NETWORK)
    apps.check_output(page or out.with_suffix(".html"), PAGE)
    module = module_of(net, plan)
    if plan.prune:
        neuro_torch.prune(module, plan.prune)
    for name in backends:
        with warnings.catch_warnings(action="ignore"):  # warnings are shown when the backend runs
            neuro.compile(net, backend=name)
