"""A folder of composed scenes: events and true boxes, which can be made in several goes and read as a data set.

```
scenes.json     how they were made: settings, seed, recordings and a hash of these, names of the classes, number
0000.npz        events of the first scene, in a format of `neuro.events.load`
0000.csv        its true boxes, see `neuro_recognise.detection.boxes`; written last, so that a scene with it is whole
```

Scene k depends on the settings, the recordings, the seed and k alone: a killed run goes on to the same scenes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from neuro import ModelError
from neuro.apps import Kind, make_folder, write_text
from neuro.events import Recordings, load, save
from neuro_recognise.detection.boxes import read_boxes, write_boxes
from neuro_recognise.detection.composing import Scene, Scenery, compose
from neuro_recognise.shown import Ints, Lazy

FORMAT = "neuro recognise scenes 1"
ABOUT = "scenes.json"


def _is_ours(path: Path) -> bool:
    try:
        return bool(json.loads(path.read_text())["format"] == FORMAT)
    except (ValueError, KeyError, TypeError):
        return False


ABOUT_KIND = Kind("a list of 'neuro recognise scenes'", _is_ours)


class Scenes(Lazy[Scene]):
    """The scenes of a folder, each read when it is asked for.

    Args:
        folder: as `write_scenes` fills it.

    Attributes:
        classes: names, by which labels are counted.
        scenery: what the scenes are like.

    Raises:
        ModelError: it is no such folder, or scenes are missing.
    """

    def __init__(self, folder: Path) -> None:
        about = folder / ABOUT
        if not about.is_file() or not _is_ours(about):
            raise ModelError(f"{folder}: no scenes, expected a folder that 'neuro recognise scenes' filled")
        told = json.loads(about.read_text())
        self._folder, self._count = folder, int(told["count"])
        self.classes: tuple[str, ...] = tuple(told["classes"])
        self.scenery = Scenery.from_words(told["scenery"])
        if missing := [k for k in range(self._count) if not _boxes_of(folder, k).is_file()]:
            raise ModelError(
                f"{folder}: {len(missing)} of {self._count} scenes are missing, the first is {_name(missing[0])}",
                hint="the command that began to write them goes on where it was",
            )

    def __len__(self) -> int:
        return self._count

    def item(self, k: int) -> Scene:
        """Read one."""
        events = load(_events_of(self._folder, k))
        boxes = read_boxes(_boxes_of(self._folder, k), self.classes)
        return Scene(_name(k), events, boxes, self.scenery.slices())


def write_scenes(
    folder: Path,
    data: Recordings,
    scenery: Scenery,
    count: int,
    *,
    seed: int = 0,
    chosen: Ints | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Scenes:
    """Fill a folder with scenes; the same call goes on where it was, and one with a larger `count` adds to them.

    Args:
        folder: made if it is not there.
        data: labelled recordings of one object each.
        scenery: what the scenes are like.
        count: how many.
        seed: of everything random.
        chosen: indices of the recordings that are used; None for all.
        report: called with how many are done, and of how many.

    Raises:
        ModelError: the folder has scenes made otherwise, or a scene has no room for its objects.
        EventFileError: a recording is damaged, or a scene cannot be written.
    """
    indices = np.arange(len(data)) if chosen is None else chosen
    if len(indices) < scenery.objects[1]:
        raise ModelError(f"scenes of up to {scenery.objects[1]} objects from {len(indices)} recordings: too few")
    make_folder(folder)
    _tell(folder, data, scenery, count, seed, indices)
    for k in range(count):
        if not _boxes_of(folder, k).is_file():
            _write(folder, k, scene_of(data, indices, scenery, seed, k), data.classes)
        report(k + 1, count)
    return Scenes(folder)


def scene_of(data: Recordings, chosen: Ints, scenery: Scenery, seed: int, k: int) -> Scene:
    """One scene.

    Args:
        data: labelled recordings of one object each.
        chosen: indices of those that are used.
        scenery: what the scene is like.
        seed: of all scenes.
        k: number of this one.
    """
    rng = np.random.default_rng([seed, k])
    n = int(rng.integers(scenery.objects[0], scenery.objects[1] + 1))
    items = [data[int(index)] for index in rng.choice(chosen, n, replace=False)]
    return compose(_name(k), [item.load() for item in items], [item.label for item in items], scenery, rng)


def fold_of(data: Recordings, folds: int, fold: int) -> Ints:
    """Indices of the recordings of one of several folds, see `Recordings.folds`; of a single fold all.

    Args:
        data: labelled recordings.
        folds: how many.
        fold: which, from 0 on.

    Raises:
        ModelError: there is no such fold, or a class has fewer recordings than there are folds.
    """
    if not 0 <= fold < folds:
        raise ModelError(f"fold {fold} of {folds}: expected 0 to {folds - 1}")
    return np.arange(len(data)) if folds == 1 else data.folds(folds, seed=0)[fold][1]


def _tell(folder: Path, data: Recordings, scenery: Scenery, count: int, seed: int, chosen: Ints) -> None:
    """Write how the scenes are made, or see that those which are there were made so."""
    about = folder / ABOUT
    told = {
        "format": FORMAT,
        "scenery": scenery.as_words(),
        "seed": seed,
        "count": count,
        "classes": list(data.classes),
        "data": data.fingerprint(),
        "recordings": [data[int(k)].name for k in chosen],
    }
    if about.exists() and _is_ours(about) and any(_boxes_of(folder, k).exists() for k in range(count)):
        there = json.loads(about.read_text())
        more = count >= int(there.get("count", 0))  # scenes do not depend on how many there are
        other = [name for name in told if there.get(name) != told[name] and not (more and name == "count")]
        if other:
            raise ModelError(f"{folder}: has scenes with another {other[0]}", hint="take a new folder")
    write_text(about, json.dumps(told, indent=1) + "\n", ABOUT_KIND)


def _write(folder: Path, k: int, scene: Scene, classes: Sequence[str]) -> None:
    save(scene.events, _events_of(folder, k), replace=True)  # events without boxes are what a kill left
    write_boxes(_boxes_of(folder, k), scene.boxes, classes)


def _name(k: int) -> str:
    return f"{k:04d}"


def _events_of(folder: Path, k: int) -> Path:
    return folder / f"{_name(k)}.npz"


def _boxes_of(folder: Path, k: int) -> Path:
    return folder / f"{_name(k)}.csv"
