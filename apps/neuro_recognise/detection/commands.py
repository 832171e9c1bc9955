"""The commands `scenes`, `crops` and `detect` of `neuro recognise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import Backend, Seed, Set, assignments

if TYPE_CHECKING:
    from neuro_recognise.detection.detector import Detector
    from neuro_recognise.detection.following import Detecting

__all__ = ["add_commands"]

SceneFolder = Annotated[Path, typer.Argument(metavar="SCENES", help="A folder that 'scenes' filled.")]


def add_commands(app: typer.Typer) -> None:
    """Add them to an app."""
    for command in (scenes, crops, detect):
        app.command()(command)


def scenes(
    data: Annotated[Path, typer.Option("--data", metavar="FOLDER", help="Recordings of one object each.")],
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where the scenes go.")],
    count: Annotated[int, typer.Option("--count", metavar="N", min=1, help="How many.")] = 100,
    sensor: Annotated[str, typer.Option("--sensor", metavar="WxH", help="Its size, px.")] = "100x80",
    touching: Annotated[bool, typer.Option("--touching", help="Objects touch, and move as one.")] = False,
    noise: Annotated[float, typer.Option("--noise", metavar="HZ", help="Background events of a pixel.")] = 1.0,
    length: Annotated[float, typer.Option("--length", metavar="MS", help="Of a scene.")] = 300.0,
    part: Annotated[str, typer.Option("--part", metavar="NAME", help="Of recordings in parts.")] = "Train",
    folds: Annotated[int, typer.Option("--folds", metavar="N", min=1, help="Into which recordings are divided.")] = 1,
    fold: Annotated[int, typer.Option("--fold", metavar="K", min=0, help="Take only this one, from 0 on.")] = 0,
    others: Annotated[bool, typer.Option("--others", help="Take all folds but this one.")] = False,
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
) -> None:
    """Compose scenes of several moving objects from recordings of one each, with true boxes; resumable.

    By --set: objects (fewest and most, as objects=[1,1]), gap and speed, and slice, support and percentile, by which
    true boxes are measured.
    """
    import numpy as np

    from neuro.events import recordings
    from neuro_recognise.detection.composing import Scenery
    from neuro_recognise.detection.scenes import fold_of, write_scenes
    from neuro_recognise.method import Progress
    from neuro_recognise.telling.bars import LearningBar

    given = {"sensor": _size(sensor), "touching": touching, "noise": noise, "length": length}
    scenery = Scenery().changed(given | assignments(set))
    found = recordings(data, part=part)
    chosen = fold_of(found, folds, fold)
    if others:
        chosen = np.setdiff1d(np.arange(len(found)), chosen)
    with LearningBar() as bar:
        write_scenes(
            out, found, scenery, count, seed=seed, chosen=chosen,
            report=lambda done, total: bar.show(Progress("composing scenes", done, total)),
        )  # fmt: skip
    typer.echo(f"{out}: {count} scenes of {len(chosen)} recordings")


def crops(
    scenes: SceneFolder,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where the recordings go.")],
    set: Set = [],  # noqa: B006
) -> None:
    """Cut single objects out of scenes, as a detector sees them: recordings for 'neuro recognise train'."""
    from neuro_recognise.detection.following import Detecting
    from neuro_recognise.detection.learning import write_crops
    from neuro_recognise.detection.scenes import Scenes
    from neuro_recognise.method import Progress
    from neuro_recognise.telling.bars import LearningBar

    settings = Detecting().changed(assignments(set))
    with LearningBar() as bar:
        n = write_crops(
            out,
            Scenes(scenes),
            settings,
            before=f"{scenes.resolve().name}-",
            report=lambda done, total: bar.show(Progress("cutting out objects", done, total)),
        )
    typer.echo(f"{out}: {n} recordings")


def detect(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A recogniser, as 'train' writes it.")],
    recording: Annotated[Path | None, typer.Argument(metavar="RECORDING", help="File of any readable format.")] = None,
    data: Annotated[Path | None, typer.Option("--data", metavar="SCENES", help="Measure on scenes instead.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Boxes as .html (page), .png (picture) or .csv.")
    ] = None,
    way: Annotated[
        str, typer.Option("--way", metavar="WAY", help="proposals; or dense: a remus network over the whole sensor.")
    ] = "proposals",
    json: Annotated[bool, typer.Option("--json", help="Print boxes or figures as JSON.")] = False,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Find several objects in a recording, with boxes and identities; or measure that on scenes."""
    from neuro_recognise.detection.detector import Detector
    from neuro_recognise.detection.following import Detecting
    from neuro_recognise.recogniser import Recogniser

    if (recording is None) == (data is None):
        raise typer.BadParameter("expected either a RECORDING or --data SCENES")
    settings: Detecting = Detecting().changed(assignments(set))
    detector = Detector(Recogniser.load(model), settings, backend, way)
    if data is not None:
        if out is not None:
            raise typer.BadParameter("boxes are written of a RECORDING", param_hint="'--out'")
        _measure(detector, data, json)
    elif recording is not None:
        _find(detector, recording, out, json)


def _measure(detector: Detector, folder: Path, as_json: bool) -> None:
    from neuro_recognise.detection import report
    from neuro_recognise.detection.scenes import Scenes
    from neuro_recognise.detection.trial import try_out
    from neuro_recognise.method import Progress
    from neuro_recognise.telling.bars import LearningBar

    scenes = Scenes(folder)
    report.check_classes(detector.recogniser.classes, scenes)
    with LearningBar() as bar:
        tried = try_out(detector, scenes, lambda done: bar.show(Progress("finding objects", done, len(scenes))))
    report.show_tried(detector, tried, as_json)


def _find(detector: Detector, recording: Path, out: Path | None, as_json: bool) -> None:
    from neuro.events import load
    from neuro_recognise.detection import report

    if out is not None:
        report.check_ending(out)
    events = load(recording)
    boxes = detector.detect(events)
    if out is not None:
        report.write_found(out, events, boxes, detector.recogniser.classes, recording.name)
    report.show_found(boxes, detector.recogniser.classes, as_json)


def _size(text: str) -> Any:
    """Width and height."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() and int(side) for side in sides):
        raise typer.BadParameter(f"'{text}': expected width and height such as 100x80", param_hint="'--sensor'")
    return tuple(int(side) for side in sides)
