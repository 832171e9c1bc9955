"""Scenes of several objects with true boxes, composed from recordings of one object each, and folders of such scenes.

The events of each recording, including its noise, move along a straight path on a larger sensor. A recording that is
shorter than the scene is repeated. A true box is measured from the events of its object alone, before events of other
objects and of the background are added. Only events count that had a neighbour shortly before
(`neuro.events.filters.BackgroundActivity`). In each slice of time, the box spans the columns and rows between two
percentiles of these events, by default 1 % and 99 %.

A folder of scenes can be written in several runs and is read as a data set:

```
scenes.json     conditions: settings, seed, recordings and their hash, names of the classes, number of scenes
0000.npz        events of the first scene, in a format of `neuro.events.load`
0000.csv        its true boxes, see `neuro_recognise.detection.boxes`; a scene with this file is complete
```

Scene k depends only on the settings, the recordings, the seed and k, so an interrupted run resumes with the same
scenes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from neuro import ModelError
from neuro.apps import Kind, Settings, make_folder, setting, write_text
from neuro_events import Events, Recordings, filters, load, save
from neuro_recognise.detection.boxes import Boxes, read_boxes, write_boxes
from neuro_recognise.shown import Floats, Ints, Lazy

TRIES = 2000
"""Number of random placements that are tried. If all fail, an error says that the objects do not fit."""
FEWEST = 20
"""Fewest events of an object in a slice; with fewer events it has no box there."""


@dataclass(frozen=True)
class Scenery(Settings):
    """Settings of scenes."""

    sensor: tuple[int, int] = setting((100, 80), "px", "width and height", "room for three digits of 23 px", at_least=1)
    objects: tuple[int, int] = setting(
        (2, 3), "", "fewest and most objects per scene", "more would not fit", at_least=1
    )
    touching: bool = setting(False, "", "whether objects touch and move together", "the harder scenes")
    gap: float = setting(6.0, "px", "least distance of boxes, unless touching", "a quarter of a digit", at_least=0)
    speed: float = setting(
        10.0, "px/s", "speed of an object, in a random direction", "a digit in about 2 s", at_least=0
    )
    noise: float = setting(1.0, "Hz", "background rate per pixel", "a quiet sensor's", at_least=0)
    length: float = setting(300.0, "ms", "duration of a scene", "that of a recording of N-MNIST", at_least=1)
    slice: float = setting(
        100.0, "ms", "duration of a slice, with one box per object", "a saccade of N-MNIST", at_least=1
    )
    support: float = setting(
        10.0, "ms", "longest time since a neighbour's event", "Delbruck's filter, its default", above=0
    )
    percentile: float = setting(
        1.0,
        "%",
        "share of events outside of a box at each side",
        "remaining noise, which would enlarge the full extent",
        at_least=0,
        below=50,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("sensor", "objects"):
            if len(getattr(self, name)) != 2:
                raise ModelError(f"scenery: {name} = {list(getattr(self, name))}: expected two numbers")
        if self.objects[0] > self.objects[1]:
            raise ModelError(f"scenery: objects = {list(self.objects)}: expected the fewest first")

    @property
    def length_us(self) -> int:
        """The duration of a scene, us."""
        return round(1000.0 * self.length)

    def slices(self) -> list[tuple[int, int]]:
        """Return start and stop of each slice, us. The last slice may be shorter."""
        step = round(1000.0 * self.slice)
        return [(start, min(start + step, self.length_us)) for start in range(0, self.length_us, step)]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Events of several objects with their true boxes.

    Attributes:
        name: name of the scene.
        events: events of all objects and the background.
        boxes: true boxes; `identity` is the index of the object.
        slices: start and stop, us, of each slice of time in which boxes are measured.
    """

    name: str
    events: Events
    boxes: Boxes
    slices: Sequence[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class _Object:
    """A recording on its path.

    Attributes:
        events: events of the recording.
        box: box of the recording's events that have a recent neighbour, on the sensor of the recording, px.
        start: initial position of the box's centre, px.
        velocity: velocity of the centre, px/us.
    """

    events: Events
    box: Floats
    start: Floats
    velocity: Floats

    def boxes_at(self, t: Floats) -> Floats:
        """Return the box at several times, us, (n, 4)."""
        middle = self.start + self.velocity * t[:, None]
        half_size = (self.box[2:] - self.box[:2]) / 2.0
        return np.concatenate([middle - half_size, middle + half_size], axis=1)


def compose(
    name: str, recordings: Sequence[Events], labels: Sequence[int], scenery: Scenery, rng: np.random.Generator
) -> Scene:
    """Compose a scene.

    Args:
        name: name of the scene.
        recordings: one recording of each object.
        labels: class of each object.
        scenery: settings of the scene.
        rng: generator of positions, paths and noise.

    Raises:
        ModelError: a recording has too few events, or the objects do not fit.
    """
    boxes = [_box(_supported(events, scenery), scenery) for events in recordings]
    for events, box in zip(recordings, boxes, strict=True):
        if box is None:
            raise ModelError(f"{name}: a recording of {len(events)} events has no box: expected more events")
    objects = [_Object(e, b, np.zeros(2), np.zeros(2)) for e, b in zip(recordings, boxes, strict=True) if b is not None]
    placed_objects = _place(name, objects, scenery, rng)
    moved = [_moved(object_, scenery) for object_ in placed_objects]
    rows = [
        (start, stop, identity, label, 1.0, box.tolist())
        for start, stop in scenery.slices()
        for identity, (events, label) in enumerate(zip(moved, labels, strict=True))
        if (box := _box(_supported(events, scenery).between(start, stop), scenery)) is not None
    ]
    t, x, y, p = (np.concatenate([getattr(part, word) for part in moved]) for word in "txyp")
    order = np.argsort(t, kind="stable")
    events = Events(t[order], x[order], y[order], p[order], scenery.sensor)
    if scenery.noise:
        noise = filters.ShotNoise(scenery.sensor, rate_hz=scenery.noise, seed=int(rng.integers(1 << 62)))
        events = noise.apply(events)
    return Scene(name, events, Boxes.of(rows), scenery.slices())


def _supported(events: Events, scenery: Scenery) -> Events:
    sieve = filters.BackgroundActivity(events.sensor_size, dt_us=round(1000.0 * scenery.support))
    return sieve.apply(events)


def _box(events: Events, scenery: Scenery) -> Floats | None:
    """Return the box of an object's events, (4,) px; None if there are too few events."""
    if len(events) < FEWEST:
        return None
    ends = scenery.percentile, 100.0 - scenery.percentile
    (left, right), (top, bottom) = (np.percentile(values, ends) for values in (events.x, events.y))
    return np.array([left, top, right + 1.0, bottom + 1.0])


def _place(name: str, objects: list[_Object], scenery: Scenery, rng: np.random.Generator) -> list[_Object]:
    """Draw positions and paths until all objects stay on the sensor, and apart or touching as the settings say."""
    times = np.linspace(0, scenery.length_us, 20)
    for _ in range(TRIES):
        if scenery.touching:
            candidates = _touching(objects, scenery, rng)
        else:
            starts = rng.uniform(0, scenery.sensor, (len(objects), 2))
            candidates = [
                replace(candidate, start=start, velocity=_velocity(scenery, rng))
                for candidate, start in zip(objects, starts, strict=True)
            ]
        boxes = [candidate.boxes_at(times) for candidate in candidates]
        inside = all((box[:, :2] >= 0).all() and (box[:, 2:] <= scenery.sensor).all() for box in boxes)
        gap = 0.0 if scenery.touching else scenery.gap
        pairs = ((a, b) for k, a in enumerate(boxes) for b in boxes[:k])
        # the least distance of two boxes at any time is negative if they overlap
        distances = (np.maximum(a[:, :2] - b[:, 2:], b[:, :2] - a[:, 2:]).max(axis=1).min() for a, b in pairs)
        if inside and all(distance >= gap - 1e-9 for distance in distances):
            return candidates
    width, height = scenery.sensor
    raise ModelError(
        f"{name}: {len(objects)} objects do not fit on {width}x{height} px in {TRIES} tries",
        hint="use a larger sensor, fewer objects, less speed or a smaller gap",
    )


def _touching(objects: list[_Object], scenery: Scenery, rng: np.random.Generator) -> list[_Object]:
    """Place each object next to an earlier one in a random direction, so that their boxes touch."""
    velocity = _velocity(scenery, rng)
    objects_so_far = [replace(objects[0], start=rng.uniform(0, scenery.sensor), velocity=velocity)]
    for object_ in objects[1:]:
        neighbour = objects_so_far[rng.integers(len(objects_so_far))]
        angle = rng.uniform(0, 2 * np.pi)
        direction = np.array([np.cos(angle), np.sin(angle)])
        half_sides = (object_.box[2:] - object_.box[:2] + neighbour.box[2:] - neighbour.box[:2]) / 2.0
        distance = np.min(half_sides / np.maximum(np.abs(direction), 1e-9))
        objects_so_far.append(replace(object_, start=neighbour.start + distance * direction, velocity=velocity))
    return objects_so_far


def _velocity(scenery: Scenery, rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.asarray(scenery.speed * 1e-6 * np.array([np.cos(angle), np.sin(angle)]))


def _moved(object_: _Object, scenery: Scenery) -> Events:
    """Return the object's events on the sensor of the scene, for the whole duration of the scene."""
    events, middle = object_.events, (object_.box[:2] + object_.box[2:]) / 2.0
    elapsed = events.t - events.t[0]
    rounds = -(-scenery.length_us // (int(elapsed[-1]) + 1))
    t = np.concatenate([elapsed + k * (int(elapsed[-1]) + 1) for k in range(rounds)])
    shift = np.rint(object_.start - middle + object_.velocity * t[:, None]).astype(np.int64)
    x, y = np.tile(events.x, rounds) + shift[:, 0], np.tile(events.y, rounds) + shift[:, 1]
    width, height = scenery.sensor
    inside = (t < scenery.length_us) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return Events(t[inside], x[inside], y[inside], np.tile(events.p, rounds)[inside], scenery.sensor)


FORMAT = "neuro recognise scenes 1"
ABOUT = "scenes.json"


def _is_ours(path: Path) -> bool:
    try:
        return bool(json.loads(path.read_text())["format"] == FORMAT)
    except (ValueError, KeyError, TypeError):
        return False


ABOUT_KIND = Kind("a list of 'neuro recognise scenes'", _is_ours)


class Scenes(Lazy[Scene]):
    """The scenes of a folder. Each scene is loaded on access.

    Args:
        folder: folder that `write_scenes` filled.

    Attributes:
        classes: names of the classes; labels are indices into them.
        scenery: settings of the scenes.

    Raises:
        ModelError: the folder has no scenes, or some are missing.
    """

    def __init__(self, folder: Path) -> None:
        facts_file = folder / ABOUT
        if not facts_file.is_file() or not _is_ours(facts_file):
            raise ModelError(f"{folder}: no scenes, expected a folder that 'neuro recognise scenes' filled")
        facts = json.loads(facts_file.read_text())
        super().__init__(int(facts["count"]), self._read)
        self._folder = folder
        self.classes: tuple[str, ...] = tuple(facts["classes"])
        self.scenery = Scenery.from_words(facts["scenery"])
        if missing := [k for k in range(len(self)) if not _file(folder, k, "csv").is_file()]:
            raise ModelError(
                f"{folder}: {len(missing)} of {len(self)} scenes are missing, the first is {missing[0]:04d}",
                hint="run 'neuro recognise scenes' again: it resumes",
            )

    def _read(self, k: int) -> Scene:
        events = load(_file(self._folder, k, "npz"))
        boxes = read_boxes(_file(self._folder, k, "csv"), self.classes)
        return Scene(f"{k:04d}", events, boxes, self.scenery.slices())


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
    """Fill a folder with scenes. The same call resumes after an interruption, and a larger `count` adds scenes.

    Args:
        folder: folder for the scenes; created if missing.
        data: labelled recordings of one object each.
        scenery: settings of the scenes.
        count: number of scenes.
        seed: seed of all random numbers.
        chosen: indices of the recordings to use; None for all.
        report: function that is called with the number of finished and of all scenes.

    Raises:
        ModelError: the folder has scenes with other conditions, or the objects of a scene do not fit.
        EventFileError: a recording is damaged, or a scene cannot be written.
    """
    indices = np.arange(len(data)) if chosen is None else chosen
    if len(indices) < scenery.objects[1]:
        raise ModelError(f"scenes of up to {scenery.objects[1]} objects from {len(indices)} recordings: too few")
    make_folder(folder)
    facts_file = folder / ABOUT
    facts = {
        "format": FORMAT,
        "scenery": scenery.as_words(),
        "seed": seed,
        "count": count,
        "classes": list(data.classes),
        "data": data.fingerprint(),
        "recordings": [data[int(k)].name for k in indices],
    }
    if facts_file.exists() and _is_ours(facts_file) and any(_file(folder, k, "csv").exists() for k in range(count)):
        existing = json.loads(facts_file.read_text())
        grown = count >= int(existing.get("count", 0))  # a scene does not depend on the count
        differing = [name for name in facts if existing.get(name) != facts[name] and not (grown and name == "count")]
        if differing:
            raise ModelError(f"{folder}: has scenes with another {differing[0]}", hint="use a new folder")
    write_text(facts_file, json.dumps(facts, indent=1) + "\n", ABOUT_KIND)
    for k in range(count):
        if not _file(folder, k, "csv").is_file():
            scene = scene_of(data, indices, scenery, seed, k)
            save(scene.events, _file(folder, k, "npz"), replace=True)  # replaces events of an interrupted run
            write_boxes(_file(folder, k, "csv"), scene.boxes, data.classes)
        report(k + 1, count)
    return Scenes(folder)


def scene_of(data: Recordings, chosen: Ints, scenery: Scenery, seed: int, k: int) -> Scene:
    """Compose one scene.

    Args:
        data: labelled recordings of one object each.
        chosen: indices of the recordings to use.
        scenery: settings of the scene.
        seed: seed of all scenes.
        k: index of the scene.
    """
    rng = np.random.default_rng([seed, k])
    n = int(rng.integers(scenery.objects[0], scenery.objects[1] + 1))
    items = [data[int(index)] for index in rng.choice(chosen, n, replace=False)]
    return compose(f"{k:04d}", [item.load() for item in items], [item.label for item in items], scenery, rng)


def fold_of(data: Recordings, folds: int, fold: int) -> Ints:
    """Return the indices of the recordings of one of several folds, see `Recordings.folds`; all with a single fold.

    Args:
        data: labelled recordings.
        folds: number of folds.
        fold: index of the fold, from 0.

    Raises:
        ModelError: there is no such fold, or a class has fewer recordings than folds.
    """
    if not 0 <= fold < folds:
        raise ModelError(f"fold {fold} of {folds}: expected 0 to {folds - 1}")
    return np.arange(len(data)) if folds == 1 else data.folds(folds, seed=0)[fold][1]


def _file(folder: Path, k: int, ending: str) -> Path:
    return folder / f"{k:04d}.{ending}"
