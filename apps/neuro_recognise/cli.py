"""Recognise objects in event-camera recordings: train, test, compare and use methods by one interface.

Recordings are a folder or zip of class folders in any readable format, or an HDF5 data set; of one with folders Train
and Test the right half is taken.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.apps import PRICED, Backend, Chips, Seed, Set, Sources, assignments, at_least, resumable

if TYPE_CHECKING:
    from neuro_events import Recordings
    from neuro_recognise.method import Progress
    from neuro_recognise.recogniser import Recogniser

app = typer.Typer(
    name="recognise", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


Option, Argument = typer.Option, typer.Argument


MethodName = Annotated[str, Argument(metavar="METHOD", help="See 'neuro recognise list'.")]
Data = Annotated[Path, Option("--data", metavar="FOLDER", help="Recordings: a folder, zip or HDF5 data set.")]
Part = Annotated[str, Option("--part", metavar="NAME", help="Of recordings in parts, such as Train and Test.")]
ModelFile = Annotated[Path, Argument(metavar="MODEL", help="A recogniser, as 'train' writes it.")]
Allow = Annotated[
    float | None,
    Option("--allow", metavar="SHARE", help="Decide as soon as no larger share is wrong; learnt by 'early'."),
]
Assurance = Annotated[
    float, Option("--assurance", metavar="P", help="Probability that no more than allowed are wrong.")
]
Json = Annotated[bool, Option("--json", help="Print the figures as JSON.")]
SceneFolder = Annotated[Path, Argument(metavar="SCENES", help="A folder that 'scenes' filled.")]


@contextmanager
def _learning() -> Iterator[Callable[[Progress], None]]:
    """A bar for what is learnt: a function that shows how far it is."""
    from neuro_recognise.telling.report import LearningBar

    with resumable(), LearningBar() as bar:
        yield bar.show


@contextmanager
def _counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar for one thing: a function of how many are done, and of how many."""
    from neuro_recognise.method import Progress
    from neuro_recognise.telling.report import LearningBar

    with LearningBar() as bar:
        yield lambda done, total: bar.show(Progress(what, done, total))


def _loaded(model: Path, values: Sequence[str] = ()) -> Recogniser:
    """A recogniser of a file, with other settings of how recordings are looked at."""
    from neuro_recognise.recogniser import Recogniser

    return Recogniser.load(model).changed(assignments([*values]))


def _refuse_network(model: Path, words: Sequence[str]) -> None:
    """Lead to the command that asks a network, as `neuro train` or `neuro convert` writes it."""
    from neuro import ModelError

    if model.suffix in (".yaml", ".yml"):
        command = shlex.join(["neuro", "predict", str(model), *words])
        raise ModelError(f"{model}: is a network: expected a recogniser, as 'train' writes it", hint=command)


def _recordings(path: Path, part: str, classes: tuple[str, ...] | None = None) -> Recordings:
    from neuro_events import recordings

    return recordings(path, part=part, classes=classes)


@app.command("list")
def list_methods(
    method: Annotated[str | None, Argument(metavar="METHOD", help="All settings of this one.")] = None,
) -> None:
    """Show the methods: what they are, what they need, and how well they do; or the settings of one."""
    from neuro_recognise.telling import report

    if method is None:
        report.show_methods()
    else:
        report.show_settings(method)


@app.command()
def train(
    method: MethodName,
    data: Data,
    out: Annotated[Path, Option(metavar="FILE", help="The recogniser to write.")] = Path("model.h5"),
    part: Part = "Train",
    preset: Annotated[str, Option(metavar="NAME", help="A preset of the method.")] = "",
    seed: Seed = 0,
    backend: Backend = "event",
    force: Annotated[bool, Option("--force", help="Replace a recogniser of another training.")] = False,
    set: Set = [],  # noqa: B006
) -> None:
    """Train on recordings; after a kill the same command goes on where it was."""
    from neuro_recognise.methods import method_of
    from neuro_recognise.recogniser import fit
    from neuro_recognise.telling.report import learnt

    chosen = method_of(method, preset, assignments(set))
    found = _recordings(data, part)
    with _learning() as shown:
        made = fit(found, chosen, seed=seed, backend=backend, out=out, replace=force, report=shown)
    typer.echo(f"{out}: {learnt(made)}")


@app.command("test")
def try_model(
    model: ModelFile,
    data: Data,
    part: Part = "Test",
    json: Json = False,
    out: Annotated[Path | None, Option(metavar="FOLDER", help="Write a picture there.")] = None,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Test a recogniser on recordings: accuracy, its 95 % interval, and the confusion of the classes."""
    from neuro_recognise.telling import report

    _refuse_network(model, [str(data), "--labels", "--part", part])
    trained = _loaded(model, set)
    tried = report.try_out(trained, _recordings(data, part, trained.classes), backend)
    if out is not None:
        report.write_confusion(tried, out)
    if json:
        typer.echo(report.figures(trained, tried))
    else:
        report.show(trained, tried)


@app.command()
def predict(
    model: ModelFile,
    recordings: Annotated[list[Path], Argument(metavar="RECORDING...", help="Files of any readable format.")],
    allow: Allow = None,
    assurance: Assurance = 0.9,
    json: Json = False,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Print the class of recordings, what speaks for each, and when that was decided.

    Damaged files are reported after the others; then the exit status is 1.
    """
    from neuro_recognise.telling import report

    _refuse_network(model, [str(file) for file in recordings])
    trained = _loaded(model, set)
    found, wrong = report.predict_files(trained, recordings, backend, allow, assurance)
    if found or json:
        report.show_predicted(trained, found, json, allow)
    for error in wrong:
        typer.echo(f"error: {error}", err=True)
    if wrong:
        raise typer.Exit(1 if found else 2)


@app.command()
def early(
    model: ModelFile,
    data: Data,
    part: Part = "Train",
    every: Annotated[float, Option(metavar="MS", help="From moment to moment.")] = 10.0,
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="Of recordings, each held out once.")] = 5,
    assurance: Assurance = 0.9,
    backend: Backend = "event",
) -> None:
    """Learn from recordings when a recogniser may decide before they end, and add that to its file.

    After a kill the same command goes on where it was.
    """
    from neuro_recognise.early import learn_early
    from neuro_recognise.telling import report

    trained = _loaded(model)
    chosen = _recordings(data, part, trained.classes)
    with _learning() as shown:
        made = learn_early(trained, chosen, every_ms=every, folds=folds, backend=backend, out=model, report=shown)
    report.show_early(made, assurance)


@app.command()
def watch(
    model: ModelFile,
    recording: Annotated[Path, Argument(metavar="RECORDING", help="A file of any readable format.")],
    out: Annotated[Path, Option(metavar="FILE", help="The page to write.")] = Path("recognise.html"),
    several: Annotated[bool, Option("--several", help="Find several objects, as 'detect' does.")] = False,
    boxes: Annotated[
        Path | None, Option(metavar="FILE", help="Draw these, too: as of 'detect' or 'scenes', .csv.")
    ] = None,
    allow: Allow = None,
    assurance: Assurance = 0.9,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Write a page that plays a recording: events, what the method looks at, scores, and when it is decided.

    With --several or --boxes it shows the objects of a scene instead: boxes, classes and identities.
    """
    trained = _loaded(model, set)
    if several or boxes is not None:
        from neuro_recognise.detection.report import watch_objects

        if allow is not None:
            raise typer.BadParameter("decides early on a single object", param_hint="'--allow'")
        summary = watch_objects(trained, recording, out, given=boxes, find=several, backend=backend)
    else:
        from neuro_recognise.telling.watch import watch

        summary = watch(trained, recording, out, allow, backend, assurance)
    typer.echo(f"{out}: {summary}")


@app.command()
def compare(
    data: Data,
    out: Annotated[Path, Option(metavar="FOLDER", help="Results and pages.")] = Path("compared"),
    method: Annotated[
        list[str], Option(metavar="NAME", help="Only this one, 'hats:poker' with settings; repeatable.")
    ] = [],  # noqa: B006
    part: Part = "Train",
    without: Annotated[list[str], Option(metavar="PATTERN", help="Leave out names like '*i.aedat'; repeatable.")] = [],  # noqa: B006
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="Each is tested once.")] = 5,
    repeats: Annotated[int, Option(metavar="N", parser=at_least(1), help="Folds and trainings anew, by seed.")] = 1,
    chips: Chips = PRICED,
    backend: Backend = "event",
    workers: Annotated[
        int | None, Option(metavar="N", parser=at_least(1), help="Folds at a time; one for each core.")
    ] = None,
) -> None:
    """Train and test all methods on the same folds: accuracy, time, joules on each chip, as a table and a page.

    What is in the folder already is not done again.
    """
    from neuro_recognise.compare import MethodComparison, compare as compare_methods, contestants, show, write
    from neuro_train.data import leaving_out

    plan = MethodComparison(contestants(method), folds, tuple(range(repeats)), tuple(chips), out, backend, workers)
    with _learning() as shown:
        found = compare_methods(leaving_out(_recordings(data, part), without), plan, shown)
    show(found, plan)
    for file in write(found, plan, data.name):
        typer.echo(file)


@app.command()
def relearn(
    data: Data,
    out: Annotated[Path, Option(metavar="FOLDER", help="Results and a picture.")] = Path("relearnt"),
    method: Annotated[
        list[str], Option(metavar="NAME", help="Only this one, 'remus:thesis' with settings, or 'linear'; repeatable.")
    ] = [],  # noqa: B006
    part: Part = "Train",
    without: Annotated[list[str], Option(metavar="PATTERN", help="Leave out names like '*i.aedat'; repeatable.")] = [],  # noqa: B006
    before: Annotated[int, Option(metavar="N", parser=at_least(1), help="Epochs until labels are permuted.")] = 8,
    after: Annotated[int, Option(metavar="N", parser=at_least(1), help="Epochs with permuted labels.")] = 10,
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="The first is tested.")] = 5,
    repeats: Annotated[int, Option(metavar="N", parser=at_least(1), help="Folds and trainings anew, by seed.")] = 5,
    backend: Backend = "event",
    workers: Annotated[
        int | None, Option(metavar="N", parser=at_least(1), help="Trainings at a time; one for each core.")
    ] = None,
    set: Set = [],  # noqa: B006
) -> None:
    """Permute the labels while methods learn; print and draw the accuracy on held-out recordings after each epoch.

    What is in the folder already is not done again.
    """
    from neuro_recognise import relearn
    from neuro_recognise.telling.report import show_relearnt
    from neuro_train.data import leaving_out

    methods, seeds = relearn.rules(method, assignments(set)), tuple(range(repeats))
    plan = relearn.Relearning(methods, before, after, folds, seeds, out, backend, workers)
    found = leaving_out(_recordings(data, part), without)
    with _learning() as shown:
        accuracies = relearn.relearn(found, plan, shown)
    show_relearnt(accuracies, before, len(found.classes), out / "relearn.png")


@app.command()
def energy(
    model: ModelFile,
    data: Data,
    part: Part = "Test",
    chips: Chips = PRICED,
    sources: Sources = False,
    json: Json = False,
    backend: Backend = "event",
) -> None:
    """Show recordings to a network and print what one of them takes on chips: joules and time."""
    from neuro_recognise import energy
    from neuro_recognise.telling.report import try_out

    trained = _loaded(model)
    energy.check_targets(trained, chips)
    tried = try_out(trained, _recordings(data, part, trained.classes), backend)
    priced = energy.bills(tried, chips)
    if json:
        typer.echo(energy.words(trained, tried, priced))
    else:
        energy.show(trained, tried, priced, sources)


@app.command()
def show(
    model: ModelFile,
    out: Annotated[Path | None, Option(metavar="FOLDER", help="Write pictures there.")] = None,
) -> None:
    """Show what a recogniser was trained with; with --out draw what it has learnt."""
    from neuro_recognise.telling import report

    trained = _loaded(model)
    report.describe(trained)
    report.show_early(trained)
    if out is not None:
        report.write_pictures(trained, out)


@app.command()
def scenes(
    data: Annotated[Path, Option(metavar="FOLDER", help="Recordings of one object each.")],
    out: Annotated[Path, Option(metavar="FOLDER", help="Where the scenes go.")],
    count: Annotated[int, Option(metavar="N", min=1, help="How many.")] = 100,
    sensor: Annotated[str, Option(metavar="WxH", help="Its size, px.")] = "100x80",
    touching: Annotated[bool, Option("--touching", help="Objects touch, and move as one.")] = False,
    noise: Annotated[float, Option(metavar="HZ", help="Background events of a pixel.")] = 1.0,
    length: Annotated[float, Option("--for", metavar="MS", help="Of a scene, in ms.")] = 300.0,
    part: Part = "Train",
    folds: Annotated[int, Option(metavar="N", min=1, help="Into which recordings are divided.")] = 1,
    fold: Annotated[int, Option(metavar="K", min=0, help="Take only this one, from 0 on.")] = 0,
    others: Annotated[bool, Option("--others", help="Take all folds but this one.")] = False,
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
) -> None:
    """Compose scenes of several moving objects from recordings of one each, with true boxes; resumable.

    By --set: objects (fewest and most, as objects=[1,1]), gap and speed, and slice, support and percentile, by which
    true boxes are measured.
    """
    import numpy as np

    from neuro_recognise.detection.scenes import Scenery, fold_of, write_scenes

    sides = sensor.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and int(side) for side in sides):
        raise typer.BadParameter(f"'{sensor}': expected width and height such as 100x80", param_hint="'--sensor'")
    given = {"sensor": tuple(map(int, sides)), "touching": touching, "noise": noise, "length": length}
    scenery = Scenery().changed(given | assignments(set))
    found = _recordings(data, part)
    chosen = fold_of(found, folds, fold)
    if others:
        chosen = np.setdiff1d(np.arange(len(found)), chosen)
    with _counting("composing scenes") as shown:
        write_scenes(out, found, scenery, count, seed=seed, chosen=chosen, report=shown)
    typer.echo(f"{out}: {count} scenes of {len(chosen)} recordings")


@app.command()
def crops(
    scenes: SceneFolder,
    out: Annotated[Path, Option(metavar="FOLDER", help="Where the recordings go.")],
    set: Set = [],  # noqa: B006
) -> None:
    """Cut single objects out of scenes, as a detector sees them: recordings for 'neuro recognise train'."""
    from neuro_recognise.detection.detector import Detecting, write_crops
    from neuro_recognise.detection.scenes import Scenes

    settings = Detecting().changed(assignments(set))
    with _counting("cutting out objects") as shown:
        n = write_crops(out, Scenes(scenes), settings, before=f"{scenes.resolve().name}-", report=shown)
    typer.echo(f"{out}: {n} recordings")


@app.command()
def detect(
    model: ModelFile,
    recording: Annotated[Path | None, Argument(metavar="RECORDING", help="File of any readable format.")] = None,
    data: Annotated[Path | None, Option(metavar="SCENES", help="Measure on scenes instead.")] = None,
    out: Annotated[Path | None, Option(metavar="FILE", help="Boxes as .html (page), .png (picture) or .csv.")] = None,
    way: Annotated[
        str, Option(metavar="WAY", help="proposals; or dense: a remus network over the whole sensor.")
    ] = "proposals",
    json: Annotated[bool, Option("--json", help="Print boxes or figures as JSON.")] = False,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Find several objects in a recording, with boxes and identities; or measure that on scenes."""
    from neuro_events import load
    from neuro_recognise.detection import report
    from neuro_recognise.detection.detector import Detecting, Detector, try_out
    from neuro_recognise.detection.scenes import Scenes

    if (recording is None) == (data is None):
        raise typer.BadParameter("expected either a RECORDING or --data SCENES")
    settings: Detecting = Detecting().changed(assignments(set))
    detector = Detector(_loaded(model), settings, backend, way)
    classes = detector.recogniser.classes
    if data is not None:
        if out is not None:
            raise typer.BadParameter("boxes are written of a RECORDING", param_hint="'--out'")
        scenes = Scenes(data)
        report.check_classes(classes, scenes)
        with _counting("finding objects") as shown:
            tried = try_out(detector, scenes, lambda done: shown(done, len(scenes)))
        report.show_tried(detector, tried, json)
    elif recording is not None:
        if out is not None:
            report.check_ending(out)
        events = load(recording)
        boxes = detector.detect(events)
        if out is not None:
            report.write_found(out, events, boxes, classes, recording.name)
        report.show_found(boxes, classes, json)
