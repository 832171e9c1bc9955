"""Recognise objects in event-camera recordings: train recognisers by many methods, test, compare and use them.

Recordings are a folder or zip of class folders in any readable format, or an HDF5 data set. If there are folders Train
and Test, training uses Train and testing uses Test.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.apps import PRICED, Backend, Chips, Seed, Sources, assignments, at_least, input_file, resumable

if TYPE_CHECKING:
    from neuro_events import Recordings
    from neuro_recognise.method import Progress
    from neuro_recognise.recogniser import Recogniser

app = typer.Typer(
    name="recognise", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


Option, Argument = typer.Option, typer.Argument


MethodName = Annotated[str, Argument(metavar="METHOD", help="Name of a method, of 'neuro recognise list'.")]
Data = Annotated[Path, Option("--data", metavar="FOLDER", help="Labelled recordings: a folder, zip or HDF5 data set.")]
Part = Annotated[str, Option("--part", metavar="NAME", help="Part of the data set, e.g. Train or Test.")]
ModelFile = Annotated[
    Path, Argument(metavar="MODEL", callback=input_file("a neuro recogniser 1"), help="Recogniser file of 'train'.")
]
Allow = Annotated[
    float | None,
    Option(
        "--allow", metavar="SHARE", help="Largest share of wrong decisions, 0 to 1, for deciding early; needs 'early'."
    ),
]
Assurance = Annotated[
    float,
    Option("--assurance", metavar="P", help="Probability that the share of wrong decisions stays within --allow."),
]
Set = Annotated[
    list[str],
    Option(
        "--set",
        metavar="NAME=VALUE",
        help="Setting of the method (see 'neuro recognise list METHOD'); repeatable.",
    ),
]
DetectionSet = Annotated[
    list[str],
    Option(
        "--set",
        metavar="NAME=VALUE",
        help="Setting of the scenes or of the detector, e.g. gap=10 or segmenter=msd; repeatable.",
    ),
]
Json = Annotated[bool, Option("--json", help="Print the figures as JSON.")]
SceneFolder = Annotated[Path, Argument(metavar="SCENES", help="Folder written by 'scenes'.")]


@contextmanager
def _training_bar() -> Iterator[Callable[[Progress], None]]:
    """Open a progress bar for a training, and yield the function that updates it."""
    from neuro_recognise.telling.report import LearningBar

    with resumable(), LearningBar() as bar:
        yield bar.show


@contextmanager
def _counting_bar(task: str) -> Iterator[Callable[[int, int], None]]:
    """Open a progress bar for one task, and yield a function of the finished and the total count."""
    from neuro_recognise.method import Progress
    from neuro_recognise.telling.report import LearningBar

    with LearningBar() as bar:
        yield lambda done, total: bar.show(Progress(task, done, total))


def _load(model: Path, values: Sequence[str] = ()) -> Recogniser:
    """Load a recogniser, and apply new values to the settings that may change after training."""
    from neuro_recognise.recogniser import Recogniser

    return Recogniser.load(model).changed(assignments([*values]))


def _refuse_network(model: Path, arguments: Sequence[str]) -> None:
    """Raise an error for a network file, with the command that predicts with networks as hint."""
    from neuro import ModelError

    if model.suffix in (".yaml", ".yml"):
        command = shlex.join(["neuro", "predict", str(model), *arguments])
        raise ModelError(f"{model}: is a network: expected a recogniser, as 'train' writes it", hint=command)


def _recordings(path: Path, part: str, classes: tuple[str, ...] | None = None) -> Recordings:
    from neuro_events import recordings

    return recordings(path, part=part, classes=classes)


@app.command("list")
def list_methods(
    method: Annotated[str | None, Argument(metavar="METHOD", help="Show the settings of this method.")] = None,
) -> None:
    """List the methods with their requirements and accuracies, or the settings of one method."""
    from neuro_recognise.telling import report

    if method is None:
        report.show_methods()
    else:
        report.show_settings(method)


@app.command()
def train(
    method: MethodName,
    data: Data,
    out: Annotated[Path, Option(metavar="FILE", help="Recogniser file to write.")] = Path("model.h5"),
    part: Part = "Train",
    preset: Annotated[
        str, Option(metavar="NAME", help="Preset of 'neuro recognise list METHOD'; default: the method's defaults.")
    ] = "",
    seed: Seed = 0,
    backend: Backend = "event",
    force: Annotated[bool, Option("--force", help="Replace --out, if it comes from a different training.")] = False,
    set: Set = [],  # noqa: B006
) -> None:
    """Train a recogniser on labelled recordings and write its file. Run the same command again to resume."""
    from neuro_recognise.methods import method_of
    from neuro_recognise.recogniser import fit
    from neuro_recognise.telling.report import training_summary

    chosen = method_of(method, preset, assignments(set))
    data_set = _recordings(data, part)
    with _training_bar() as update_bar:
        recogniser = fit(data_set, chosen, seed=seed, backend=backend, out=out, replace=force, report=update_bar)
    typer.echo(f"{out}: {training_summary(recogniser)}")


@app.command("test")
def try_model(
    model: ModelFile,
    data: Data,
    part: Part = "Test",
    json: Json = False,
    out: Annotated[Path | None, Option(metavar="FOLDER", help="Folder for a picture of the confusions.")] = None,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Test a recogniser on recordings: accuracy, its 95 % interval, and the confusion of the classes."""
    from neuro_recognise.telling import report

    _refuse_network(model, [str(data), "--labels", "--part", part])
    recogniser = _load(model, set)
    result = report.try_out(recogniser, _recordings(data, part, recogniser.classes), backend)
    if out is not None:
        report.write_confusion(result, out)
    if json:
        typer.echo(report.figures(recogniser, result))
    else:
        report.show(recogniser, result)


@app.command()
def predict(
    model: ModelFile,
    recordings: Annotated[list[Path], Argument(metavar="RECORDING...", help="Event files of any readable format.")],
    allow: Allow = None,
    assurance: Assurance = 0.9,
    json: Json = False,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Print the class of each recording, the scores of all classes, and the time of the decision.

    Damaged files are reported after the other results; then the exit status is 1.
    """
    from neuro_recognise.telling import report

    _refuse_network(model, [str(file) for file in recordings])
    recogniser = _load(model, set)
    predictions, errors = report.predict_files(recogniser, recordings, backend, allow, assurance)
    if predictions or json:
        report.show_predicted(recogniser, predictions, json, allow)
    for error in errors:
        typer.echo(f"error: {error}", err=True)
    if errors:
        raise typer.Exit(1 if predictions else 2)


@app.command()
def early(
    model: ModelFile,
    data: Data,
    part: Part = "Train",
    every: Annotated[float, Option(metavar="MS", help="Time between possible decisions, ms.")] = 10.0,
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="Number of folds; each is held out once.")] = 5,
    assurance: Assurance = 0.9,
    backend: Backend = "event",
) -> None:
    """Learn when a recogniser may decide before a recording ends, and add the result to its file.

    After an interruption, run the same command again to resume.
    """
    from neuro_recognise.early import learn_early
    from neuro_recognise.telling import report

    recogniser = _load(model)
    data_set = _recordings(data, part, recogniser.classes)
    with _training_bar() as update_bar:
        with_early = learn_early(
            recogniser, data_set, every_ms=every, folds=folds, backend=backend, out=model, report=update_bar
        )
    report.show_early(with_early, assurance)


@app.command()
def watch(
    model: ModelFile,
    recording: Annotated[Path, Argument(metavar="RECORDING", help="Event file of any readable format.")],
    out: Annotated[Path, Option(metavar="FILE", help="HTML page to write.")] = Path("recognise.html"),
    several: Annotated[bool, Option("--several", help="Detect several objects, as 'detect' does.")] = False,
    boxes: Annotated[
        Path | None, Option(metavar="FILE", help="Boxes to draw as well, a .csv file of 'detect' or 'scenes'.")
    ] = None,
    allow: Allow = None,
    assurance: Assurance = 0.9,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Write a page that plays a recording: events, inputs of the method, scores, and the time of the decision.

    With --several or --boxes the page shows the objects of a scene instead: boxes, classes and identities.
    """
    recogniser = _load(model, set)
    if several or boxes is not None:
        from neuro_recognise.detection.report import watch_objects

        if allow is not None:
            raise typer.BadParameter(
                "early decisions exist for single objects only: leave out --several and --boxes", param_hint="'--allow'"
            )
        summary = watch_objects(recogniser, recording, out, table=boxes, find=several, backend=backend)
    else:
        from neuro_recognise.telling.watch import watch

        summary = watch(recogniser, recording, out, allow, backend, assurance)
    typer.echo(f"{out}: {summary}")


@app.command()
def compare(
    data: Data,
    out: Annotated[Path, Option(metavar="FOLDER", help="Folder for results and pages.")] = Path("compared"),
    method: Annotated[
        list[str],
        Option(metavar="NAME", help="Method to compare, or a preset such as 'hats:poker'; repeatable; default: all."),
    ] = [],  # noqa: B006
    part: Part = "Train",
    without: Annotated[
        list[str],
        Option(metavar="PATTERN", help="Leave out recordings whose name matches, e.g. '*i.aedat'; repeatable."),
    ] = [],  # noqa: B006
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="Number of folds; each is tested once.")] = 5,
    repeats: Annotated[int, Option(metavar="N", parser=at_least(1), help="Repetitions with other seeds.")] = 1,
    chips: Chips = PRICED,
    backend: Backend = "event",
    workers: Annotated[
        int | None, Option(metavar="N", parser=at_least(1), help="Folds that run in parallel; default: one per core.")
    ] = None,
) -> None:
    """Train and test all methods on the same folds: accuracy, time and energy on each chip, as a table and a page.

    Results that are already in the folder are reused.
    """
    from neuro_recognise.compare import MethodComparison, compare as compare_methods, contestants, show, write
    from neuro_train.data import leaving_out

    plan = MethodComparison(contestants(method), folds, tuple(range(repeats)), tuple(chips), out, backend, workers)
    with _training_bar() as update_bar:
        results = compare_methods(leaving_out(_recordings(data, part), without), plan, update_bar)
    show(results, plan)
    for file in write(results, plan, data.name):
        typer.echo(file)


@app.command()
def relearn(
    data: Data,
    out: Annotated[Path, Option(metavar="FOLDER", help="Folder for results and a picture.")] = Path("relearnt"),
    method: Annotated[
        list[str],
        Option(metavar="NAME", help="Method to test, a preset such as 'remus:thesis', or 'linear'; repeatable."),
    ] = [],  # noqa: B006
    part: Part = "Train",
    without: Annotated[
        list[str],
        Option(metavar="PATTERN", help="Leave out recordings whose name matches, e.g. '*i.aedat'; repeatable."),
    ] = [],  # noqa: B006
    before: Annotated[int, Option(metavar="N", parser=at_least(1), help="Epochs before the labels are permuted.")] = 8,
    after: Annotated[int, Option(metavar="N", parser=at_least(1), help="Epochs with permuted labels.")] = 10,
    folds: Annotated[int, Option(metavar="N", parser=at_least(2), help="Number of folds; the first is tested.")] = 5,
    repeats: Annotated[int, Option(metavar="N", parser=at_least(1), help="Repetitions with other seeds.")] = 5,
    backend: Backend = "event",
    workers: Annotated[
        int | None,
        Option(metavar="N", parser=at_least(1), help="Trainings that run in parallel; default: one per core."),
    ] = None,
    set: Set = [],  # noqa: B006
) -> None:
    """Show how methods relearn after the labels are permuted: accuracy on held-out recordings after each epoch.

    Results that are already in the folder are reused.
    """
    from neuro_recognise import relearn
    from neuro_recognise.telling.report import show_relearnt
    from neuro_train.data import leaving_out

    methods, seeds = relearn.rules(method, assignments(set)), tuple(range(repeats))
    plan = relearn.Relearning(methods, before, after, folds, seeds, out, backend, workers)
    data_set = leaving_out(_recordings(data, part), without)
    with _training_bar() as update_bar:
        accuracies = relearn.relearn(data_set, plan, update_bar)
    show_relearnt(accuracies, before, len(data_set.classes), out / "relearn.png")


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
    """Run a recogniser's network on recordings, and print energy and time per recording on each chip."""
    from neuro_recognise import energy
    from neuro_recognise.telling.report import try_out

    recogniser = _load(model)
    energy.check_targets(recogniser, chips)
    result = try_out(recogniser, _recordings(data, part, recogniser.classes), backend)
    priced = energy.bills(result, chips)
    if json:
        typer.echo(energy.words(recogniser, result, priced))
    else:
        energy.show(recogniser, result, priced, sources)


@app.command()
def show(
    model: ModelFile,
    out: Annotated[Path | None, Option(metavar="FOLDER", help="Folder for pictures of what was learnt.")] = None,
) -> None:
    """Print the training record of a recogniser; with --out also draw what it has learnt."""
    from neuro_recognise.telling import report

    recogniser = _load(model)
    report.describe(recogniser)
    report.show_early(recogniser)
    if out is not None:
        report.write_pictures(recogniser, out)


@app.command()
def scenes(
    data: Annotated[Path, Option(metavar="FOLDER", help="Labelled recordings of one object each.")],
    out: Annotated[Path, Option(metavar="FOLDER", help="Folder for the scenes.")],
    count: Annotated[int, Option(metavar="N", min=1, help="Number of scenes.")] = 100,
    sensor: Annotated[str, Option(metavar="WxH", help="Size of the sensor, px.")] = "100x80",
    touching: Annotated[bool, Option("--touching", help="Let objects touch and move together.")] = False,
    noise: Annotated[float, Option(metavar="HZ", help="Background rate per pixel, Hz.")] = 1.0,
    length: Annotated[float, Option("--for", metavar="MS", help="Duration of a scene, ms.")] = 300.0,
    part: Part = "Train",
    folds: Annotated[int, Option(metavar="N", min=1, help="Number of folds of the recordings.")] = 1,
    fold: Annotated[int, Option(metavar="K", min=0, help="Index of the fold to use, from 0.")] = 0,
    others: Annotated[bool, Option("--others", help="Use all folds except --fold.")] = False,
    seed: Seed = 0,
    set: DetectionSet = [],  # noqa: B006
) -> None:
    """Compose scenes of several moving objects with true boxes from recordings of one object each; resumable.

    Settings for --set: objects (fewest and most, e.g. objects=[1,1]), gap and speed; and slice, support and percentile,
    which define the true boxes.
    """
    import numpy as np

    from neuro_recognise.detection.scenes import Scenery, fold_of, write_scenes

    sides = sensor.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and int(side) for side in sides):
        raise typer.BadParameter(f"'{sensor}': expected width and height such as 100x80", param_hint="'--sensor'")
    options = {"sensor": tuple(map(int, sides)), "touching": touching, "noise": noise, "length": length}
    scenery = Scenery().changed(options | assignments(set))
    data_set = _recordings(data, part)
    chosen = fold_of(data_set, folds, fold)
    if others:
        chosen = np.setdiff1d(np.arange(len(data_set)), chosen)
    with _counting_bar("composing scenes") as update_bar:
        write_scenes(out, data_set, scenery, count, seed=seed, chosen=chosen, report=update_bar)
    typer.echo(f"{out}: {count} scenes of {len(chosen)} recordings")


@app.command()
def crops(
    scenes: SceneFolder,
    out: Annotated[Path, Option(metavar="FOLDER", help="Folder for the recordings.")],
    set: DetectionSet = [],  # noqa: B006
) -> None:
    """Cut scenes into recordings of single objects to train on, cropped as a detector crops them."""
    from neuro_recognise.detection.detector import Detecting, write_crops
    from neuro_recognise.detection.scenes import Scenes

    settings = Detecting().changed(assignments(set))
    with _counting_bar("cutting out objects") as update_bar:
        n = write_crops(out, Scenes(scenes), settings, before=f"{scenes.resolve().name}-", report=update_bar)
    typer.echo(f"{out}: {n} recordings")


@app.command()
def detect(
    model: ModelFile,
    recording: Annotated[Path | None, Argument(metavar="RECORDING", help="Event file of any readable format.")] = None,
    data: Annotated[Path | None, Option(metavar="SCENES", help="Scenes to measure the detection on.")] = None,
    out: Annotated[Path | None, Option(metavar="FILE", help="File for the boxes: .html, .png or .csv.")] = None,
    way: Annotated[
        str,
        Option(
            metavar="WAY",
            help="Method: proposals (classify proposed regions) or dense (a remus network over the whole sensor).",
        ),
    ] = "proposals",
    json: Annotated[bool, Option("--json", help="Print boxes or figures as JSON.")] = False,
    backend: Backend = "event",
    set: DetectionSet = [],  # noqa: B006
) -> None:
    """Detect several objects in a recording, with boxes and identities, or measure the detection on scenes."""
    from neuro_events import load
    from neuro_recognise.detection import report
    from neuro_recognise.detection.detector import Detecting, Detector, try_out
    from neuro_recognise.detection.scenes import Scenes

    if (recording is None) == (data is None):
        raise typer.BadParameter("expected either a RECORDING or --data SCENES")
    settings: Detecting = Detecting().changed(assignments(set))
    detector = Detector(_load(model), settings, backend, way)
    classes = detector.recogniser.classes
    if data is not None:
        if out is not None:
            raise typer.BadParameter("writes the boxes of a RECORDING: leave it out with --data", param_hint="'--out'")
        scenes = Scenes(data)
        report.check_classes(classes, scenes)
        with _counting_bar("finding objects") as update_bar:
            result = try_out(detector, scenes, lambda done: update_bar(done, len(scenes)))
        report.show_tried(detector, result, json)
    elif recording is not None:
        if out is not None:
            report.check_ending(out)
        events = load(recording)
        boxes = detector.detect(events)
        if out is not None:
            report.write_found(out, events, boxes, classes, recording.name)
        report.show_found(boxes, classes, json)
