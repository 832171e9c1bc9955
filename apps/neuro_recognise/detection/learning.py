"""What a recogniser learns from so that it knows what a detector shows it: crops out of scenes, with their classes.

A crop lacks the noise round an object, has some of the background and of its neighbours, and moves otherwise than a
recording of one object in the middle of the field: HATS finds half as many objects by their class when it learnt from
whole recordings (docs/how-to/detect-objects.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from neuro.apps import make_folder
from neuro.events import Events, save
from neuro_recognise.detection.boxes import Boxes, iou
from neuro_recognise.detection.following import Detecting, Piece, crop, pieces
from neuro_recognise.detection.measures import AT_LEAST
from neuro_recognise.detection.scenes import Scene, Scenes


def crops(scene: Scene, settings: Detecting, size: tuple[int, int]) -> Iterator[tuple[int, Events]]:
    """The objects that a detector finds in a scene: class and crop; what fits to no true box is left out.

    Args:
        scene: with its true boxes.
        settings: how objects are found.
        size: width and height of the crops, px.
    """
    for piece in pieces(scene.events, settings):
        label = _label(piece, scene.boxes)
        if label is not None:
            yield label, crop(piece.regions, size, settings.proposals.scale_of(piece.regions))


def write_crops(
    folder: Path,
    scenes: Scenes,
    settings: Detecting,
    *,
    before: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Write crops of all scenes, in folders named as their classes; the same call writes the same files.

    Args:
        folder: made if it is not there.
        scenes: with true boxes.
        settings: how objects are found.
        before: stands before the names of files, so that several data sets of scenes fit into one folder.
        report: called with how many scenes are done, and of how many.

    Returns:
        How many there are.

    Raises:
        EventFileError: a crop cannot be written.
    """
    for name in scenes.classes:
        make_folder(folder / name)
    size = settings.proposals.field
    written = 0
    for done, scene in enumerate(scenes, 1):
        for k, (label, events) in enumerate(crops(scene, settings, size)):
            save(events, folder / scenes.classes[label] / f"{before}{scene.name}-{k}.npz", replace=True)
            written += 1
        report(done, len(scenes))
    return written


def _label(piece: Piece, there: Boxes) -> int | None:
    """The class of the object that most boxes of a piece fit to, None where they fit to none."""
    fits: list[int] = []
    for one in piece.seen:
        now = there.within(one.start, one.stop)
        shared = iou(one.region.box[None], now.box)[0]
        fits += [int(now.label[shared.argmax()])] if len(now) and shared.max() >= AT_LEAST else []
    return int(np.bincount(fits).argmax()) if fits else None
