"""Recordings as batches of spikes, with the neuron that stands for the class of each, or with targets of each step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import unknown
from neuro.events.dataset import UNKNOWN
from neuro.events.parts import windowed
from neuro_train.plan import TrainingPlan, corner

if TYPE_CHECKING:
    from neuro.events import Events as Recorded, Recordings
    from neuro.events.dataset import Sample
    from neuro_torch import Events

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Report = Callable[[str, int, int], None]
"""Called with what is done, how much of it, and of how much."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchData:
    """Recordings as a network sees them, with what is wanted of it.

    Attributes:
        events: one batch of all.
        labels: (recordings,), the neuron of the output for each; or targets, the potentials of the output in mV at the
            end of each step, (recordings, steps, neurons), NaN where nothing is asked.
        classes: names; of targets none.
        shape: of the population of the pixels.
        digest: differs for other recordings.
    """

    events: Events
    labels: npt.NDArray[Any]
    classes: tuple[str, ...]
    shape: tuple[int, ...]
    digest: str

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, chosen: Ints) -> BatchData:
        """Some of them."""
        return BatchData(self.events[chosen.tolist()], self.labels[chosen], self.classes, self.shape, self.digest)

    @property
    def variance(self) -> float:
        """Variance of the targets about the mean of each neuron, mV^2; 0 where every neuron's targets are constant."""
        targets = self.labels[..., ~np.isnan(self.labels).all(axis=(0, 1))]
        if (np.nanmin(targets, axis=(0, 1)) == np.nanmax(targets, axis=(0, 1))).all():
            return 0.0
        return float(np.nanmean((targets - np.nanmean(targets, axis=(0, 1))) ** 2))


def but(found: Recordings, patterns: Sequence[str]) -> Recordings:
    """The recordings whose names fit no pattern, such as "*i.aedat"."""
    kept = [k for k, item in enumerate(found) if not any(fnmatchcase(item.name, pattern) for pattern in patterns)]
    if len(found) and not kept:
        message = (
            f"--without {' --without '.join(patterns)}: leaves none of the {len(found)} recordings of {found.path}"
        )
        raise ModelError(f"{message}: expected some of each class", hint=f"names are such as '{found[0].name}'")
    return found.take(kept)


def check_network(net: neuro.Network, plan: TrainingPlan) -> None:
    """Refuse a network that has no such input and output.

    Raises:
        ModelError: a population is missing, or is of the wrong kind.
    """
    for option, name in (("input", plan.input), ("output", plan.output)):
        if name not in net.populations:
            raise unknown(f"population for --{option}", name, net.populations)
    pixels = net.populations[plan.input]
    if not isinstance(pixels.model, neuro.spike_generator):
        message = (
            f"--input {plan.input}: found {pixels.model.name}: expected a spike_generator, whose spikes recordings are"
        )
        raise ModelError(message)
    shape = pixels.shape
    if plan.loss == "mse":
        return
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
        message = f"--input {plan.input}: shape {list(shape)}"
        hint = "of any shape with --loss mse, which learns targets"
        raise ModelError(f"{message}: expected [2, rows, columns], OFF then ON, or [rows, columns]", hint=hint)


def show(
    net: neuro.Network,
    data: Recordings,
    plan: TrainingPlan,
    report: Report,
    hint: str = "set it in the file, or by --set; --window centred shows a part of a larger sensor",
) -> BatchData:
    """Read recordings.

    Args:
        net: has the pixels and the output.
        data: the recordings.
        plan: how they are seen.
        report: called with how many are read.
        hint: what to do where the pixels are of another sensor.

    Raises:
        EventFileError: one is damaged.
        ModelError: one has no class, there are more classes than neurons of the output, the pixels are of another
            sensor, or the window leaves out too much of one.
    """
    from neuro_torch import Events

    shape = tuple(int(side) for side in net.populations[plan.input].shape)
    _check_labels(net, data, plan)
    if plan.window is None:
        _check_sensor(data, shape, plan, hint)
    words: Any = {"shape": shape, "step": net.resolution, "duration": plan.duration}
    words |= {"scale": plan.scale, "start": plan.start}
    parts = []
    for k in range(len(data)):
        parts.append(Events.of_recordings([_seen(data[k], shape, plan)], plan.input, **words))
        report("reading recordings", k + 1, len(data))
    events = Events.join(parts)
    if not events.trains[plan.input].step.size:
        when = f"{plan.start:g} to {plan.start + plan.duration:g} ms"
        message = f"{data.path}: no recording has an event from {when}: expected some to learn from"
        raise ModelError(message, hint="--start and --duration say which part of each recording is used")
    return BatchData(events, data.labels, data.classes, shape, data.fingerprint()[:32])


def _seen(item: Sample, shape: tuple[int, ...], plan: TrainingPlan) -> Recorded:
    """The events of a recording, those of the window where there is one."""
    events = item.load()
    if plan.window is None:
        return events
    rows, columns = shape[-2:]
    size = columns * plan.scale, rows * plan.scale
    return windowed(events, size, corner(plan.window), plan.start, plan.duration, str(item.path))


def _check_labels(net: neuro.Network, data: Recordings, plan: TrainingPlan) -> None:
    if not len(data):
        raise ModelError(f"{data.path}: has no recordings: expected some of each class")
    for item in data:
        if item.label == UNKNOWN:
            message = f"{item.path}: its class is not known: expected recordings in folders of classes"
            raise ModelError(message, hint="Train.zip with 0/a.bin, 1/b.bin, ...; or a MANIFEST.csv beside them")
    neurons = math.prod(int(side) for side in net.populations[plan.output].shape)
    if neurons != len(data.classes):
        message = f"--output {plan.output}: {neurons} neurons for the {len(data.classes)} classes of {data.path}"
        raise ModelError(
            f"{message}: expected one for each", hint="give the population as many neurons, such as by --set"
        )


def _check_sensor(data: Recordings, shape: tuple[int, ...], plan: TrainingPlan, hint: str) -> None:
    width, height = data.sensor_size(setting="another shape of the population")
    rows, columns = (-(-side // plan.scale) for side in (height, width))
    if shape[-2:] != (rows, columns):
        seen = f"{width}x{height} px" + (f" by {plan.scale}" if plan.scale > 1 else "")
        message = (
            f"--input {plan.input}: shape {list(shape)}: recordings of {seen} have {rows} rows and {columns} columns"
        )
        expected = [*shape[:-2], rows, columns]
        raise ModelError(f"{data.path}: {message}: expected the shape {expected}", hint=hint)


def moved(
    events: Events,
    population: str,
    shape: tuple[int, ...],
    shift: int,
    warp: float,
    rng: np.random.Generator,
    mirror: float = 0.0,
) -> Events:
    """Move, warp and mirror each recording at random; events that leave the field are lost.

    Args:
        events: a batch.
        population: of the pixels.
        shape: theirs.
        shift: px on each axis, at most.
        warp: by how much each is turned (rad), made larger and sheared (shares) about the middle, at most.
        rng: draws.
        mirror: share of them that are mirrored, left to right.
    """
    from neuro_torch import Events

    train, (rows, columns) = events.trains[population], shape[-2:]
    down, right = rng.integers(-shift, shift + 1, (2, events.batch))
    recording = np.repeat(np.arange(events.batch), np.diff(train.ends))
    place, x = np.divmod(train.neuron.astype(np.int64), columns)
    sheet, y = np.divmod(place, rows)
    if mirror:
        x = np.where((rng.random(events.batch) < mirror)[recording], columns - 1 - x, x)
    if warp:
        middle = (columns - 1) / 2, (rows - 1) / 2
        by = rng.uniform(-warp, warp, (3, events.batch))
        x, y = _warped(x - middle[0], y - middle[1], by, train.ends)
        x, y = (np.rint(each + m).astype(np.int64) for each, m in zip((x, y), middle, strict=True))
    x, y = x + right[recording], y + down[recording]
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    neuron = ((sheet * rows + y) * columns + x)[inside].astype(np.int32)
    step, recording = train.step[inside], recording[inside]
    if warp or mirror:  # pixels may have come to one, and lie in another order
        return Events(events.batch, events.steps, {population: (recording, step, neuron)})
    ends = np.concatenate(([0], np.cumsum(np.bincount(recording, minlength=events.batch))))
    return Events.of_trains(events.steps, {population: type(train)(ends, step, neuron)})


def _warped(x: Floats, y: Floats, by: Floats, ends: Ints) -> tuple[Floats, Floats]:
    """Places about the middle, turned by an angle, made larger by a share, and sheared by a share.

    Args:
        x: of all events, to the right.
        y: of all events, downwards.
        by: angle, growth and shear of each recording, (3, recordings).
        ends: events of recording b are `ends[b] : ends[b + 1]`.
    """
    turn, growth, shear = by
    cos, sin, larger = np.cos(turn), np.sin(turn), 1.0 + growth
    rows = larger * (cos + shear * sin), larger * (shear * cos - sin), larger * sin, larger * cos
    a, b, c, d = (np.repeat(row, np.diff(ends)) for row in rows)
    return a * x + b * y, c * x + d * y
