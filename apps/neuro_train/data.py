"""Recordings as batches of spikes, with the index of the class of each, or with targets of each step."""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError
from neuro.apps import record_input, unknown
from neuro_events.dataset import UNKNOWN
from neuro_events.parts import windowed
from neuro_train.plan import TrainingPlan, corner

if TYPE_CHECKING:
    from neuro_events import Recordings
    from neuro_torch import Events


Ints = npt.NDArray[np.int64]
Report = Callable[[str, int, int], None]
"""Function that is called with the activity, the finished and the total number of its units."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchData:
    """Recordings as a batch for a network, with labels or targets.

    Attributes:
        events: all recordings as one batch.
        labels: with classes, (recordings,) output neuron of the class. With targets, (recordings, steps, neurons)
            demanded potentials of the output at the end of each step, mV, NaN for no demand.
        classes: names of the classes; empty with targets.
        shape: shape of the population of pixels.
        digest: hash of the recordings.
        n_events: (recordings,) number of events that became spikes; None if the file contains spikes.
    """

    events: Events
    labels: npt.NDArray[Any]
    classes: tuple[str, ...]
    shape: tuple[int, ...]
    digest: str
    n_events: Ints | None = None

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, chosen: Ints) -> BatchData:
        """Return some of the recordings."""
        n_events = None if self.n_events is None else self.n_events[chosen]
        events = self.events[chosen.tolist()]
        return BatchData(events, self.labels[chosen], self.classes, self.shape, self.digest, n_events)

    @property
    def variance(self) -> float:
        """Variance of the targets about the mean of each neuron, mV^2; 0 if all neurons have constant targets."""
        targets = self.labels[..., ~np.isnan(self.labels).all(axis=(0, 1))]
        if (np.nanmin(targets, axis=(0, 1)) == np.nanmax(targets, axis=(0, 1))).all():
            return 0.0
        return float(np.nanmean((targets - np.nanmean(targets, axis=(0, 1))) ** 2))


def leaving_out(recordings: Recordings, patterns: Sequence[str]) -> Recordings:
    """Return the recordings whose names match no pattern, such as "*i.aedat"."""
    indices = [k for k, r in enumerate(recordings) if not any(fnmatchcase(r.name, glob) for glob in patterns)]
    if len(recordings) and not indices:
        options = " ".join(f"--without {pattern}" for pattern in patterns)
        message = f"{options}: leaves out all of the {len(recordings)} recordings of {recordings.path}"
        raise ModelError(f"{message}: expected some of each class", hint=f"a name is, e.g., '{recordings[0].name}'")
    return recordings.take(indices)


def check_network(net: neuro.Network, plan: TrainingPlan) -> None:
    """Check that a network has the input and the output of a plan.

    Raises:
        ModelError: a population is missing or has the wrong kind.
    """
    for option, name in (("input", plan.input), ("output", plan.output)):
        if name not in net.populations:
            raise unknown(f"population for --{option}", name, net.populations)
    pixels = net.populations[plan.input]
    if not isinstance(pixels.model, neuro.spike_generator):
        message = f"--input {plan.input}: found {pixels.model.name}: expected a spike_generator, which emits the events"
        raise ModelError(message)
    shape = pixels.shape
    if plan.loss == "mse":
        return
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
        message = f"--input {plan.input}: shape {list(shape)}"
        hint = "--loss mse, which learns targets, takes any shape"
        raise ModelError(f"{message}: expected [2, rows, columns], OFF then ON, or [rows, columns]", hint=hint)


def show(
    net: neuro.Network,
    data: Recordings,
    plan: TrainingPlan,
    report: Report,
    hint: str = "set it in the file, or by --set; --window centred shows a part of a larger sensor",
) -> BatchData:
    """Read recordings as spikes of a network's input.

    Args:
        net: network with the input and the output of the plan.
        data: the recordings.
        plan: settings of the training.
        report: called with the number of read recordings.
        hint: hint of the error for a sensor of another size than the input.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: a recording has no class, the numbers of classes and output neurons differ, the sensor has another
            size than the input, or too much of a recording lies outside of the window.
    """
    from neuro_torch import Events

    shape = tuple(int(side) for side in net.populations[plan.input].shape)
    if not len(data):
        raise ModelError(f"{data.path}: has no recordings: expected recordings of each class")
    for item in data:
        if item.label == UNKNOWN:
            message = f"{item.path}: its class is not known: expected recordings in folders of classes"
            raise ModelError(message, hint="use a Train.zip with 0/a.bin, 1/b.bin, ... or a MANIFEST.csv")
    neurons = math.prod(int(side) for side in net.populations[plan.output].shape)
    if neurons != len(data.classes):
        message = f"--output {plan.output}: {neurons} neurons for the {len(data.classes)} classes of {data.path}"
        raise ModelError(f"{message}: expected one for each", hint="set the number of neurons in the file, or by --set")
    if plan.window is None:
        width, height = data.sensor_size(setting="another shape of the population")
        rows, columns = (-(-side // plan.scale) for side in (height, width))
        if shape[-2:] != (rows, columns):
            size = f"{width}x{height} px" + (f" by {plan.scale}" if plan.scale > 1 else "")
            message = f"--input {plan.input}: shape {list(shape)}: recordings of {size} have {rows} rows"
            message += f" and {columns} columns"
            expected = [*shape[:-2], rows, columns]
            raise ModelError(f"{data.path}: {message}: expected the shape {expected}", hint=hint)
    timing: Any = {"shape": shape, "step": net.resolution, "duration": plan.duration}
    timing |= {"scale": plan.scale, "start": plan.start}
    parts, n_events = [], []
    for k in range(len(data)):
        events = data[k].load()
        if plan.window is not None:
            part = corner(plan.window), plan.start, plan.duration, str(data[k].path)
            events = windowed(events, (shape[-1] * plan.scale, shape[-2] * plan.scale), *part)
        parts.append(Events.of_recordings([events], plan.input, **timing))
        since_ms = (events.t - events.t[:1]) / 1000.0 - plan.start
        n_events.append(np.count_nonzero((since_ms >= 0.0) & (since_ms < plan.duration)))
        report("reading recordings", k + 1, len(data))
    joined = Events.join(parts)
    if not joined.trains[plan.input].step.size:
        interval = f"{plan.start:g} to {plan.start + plan.duration:g} ms"
        message = f"{data.path}: no recording has an event from {interval}: expected events to learn from"
        raise ModelError(message, hint="--start and --duration say which part of each recording is used")
    return BatchData(joined, data.labels, data.classes, shape, data.fingerprint()[:32], np.array(n_events, np.int64))


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
        population: name of the population of pixels.
        shape: shape of this population.
        shift: largest shift along each axis, px.
        warp: largest rotation about the middle in rad, and largest relative change of size and shear.
        rng: random generator.
        mirror: share of the recordings that are mirrored, left to right.
    """
    from neuro_torch import Events

    train, (rows, columns) = events.trains[population], shape[-2:]
    down, right = rng.integers(-shift, shift + 1, (2, events.batch))
    recording = np.repeat(np.arange(events.batch), np.diff(train.ends))
    row, x = np.divmod(train.neuron.astype(np.int64), columns)
    sheet, y = np.divmod(row, rows)
    if mirror:
        x = np.where((rng.random(events.batch) < mirror)[recording], columns - 1 - x, x)
    if warp:
        # rotation, growth and shear about the middle
        turn, growth, shear = rng.uniform(-warp, warp, (3, events.batch))
        cos, sin, larger = np.cos(turn), np.sin(turn), 1.0 + growth
        matrix = larger * (cos + shear * sin), larger * (shear * cos - sin), larger * sin, larger * cos
        a, b, c, d = (entry[recording] for entry in matrix)
        middle = (columns - 1) / 2, (rows - 1) / 2
        right_of, below = x - middle[0], y - middle[1]
        x = np.rint(a * right_of + b * below + middle[0]).astype(np.int64)
        y = np.rint(c * right_of + d * below + middle[1]).astype(np.int64)
    x, y = x + right[recording], y + down[recording]
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    neuron = ((sheet * rows + y) * columns + x)[inside].astype(np.int32)
    step, recording = train.step[inside], recording[inside]
    if warp or mirror:  # pixels may coincide or have another order
        return Events(events.batch, events.steps, {population: (recording, step, neuron)})
    ends = np.concatenate(([0], np.cumsum(np.bincount(recording, minlength=events.batch))))
    return Events.of_trains(events.steps, {population: type(train)(ends, step, neuron)})


Array = npt.NDArray[Any]
LARGEST = 1e15
"""Largest absolute target, mV; the square of a larger error overflows float32."""
HINT = "numpy.savez(path, spikes=..., targets=...)"


def read(path: Path, net: neuro.Network, plan: TrainingPlan) -> BatchData:
    """Read recordings with targets from a ``.npz``.

    `spikes` are 0 or 1, (recordings, steps, neurons of the input), also with the axes of the input's shape. `targets`
    are the demanded potentials of the output at the end of each step in mV, (recordings, steps, neurons), NaN for no
    demand.

    Raises:
        ModelError: the file cannot be read, lacks an array, or the arrays do not fit the network.
    """
    from neuro_torch import Events

    record_input(path)
    try:
        content = path.read_bytes()
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            spikes, targets = file["spikes"], np.asarray(file["targets"], dtype=np.float64)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror or error}", hint=HINT) from None
    except (ValueError, TypeError, AttributeError, EOFError, BadZipFile):
        raise ModelError(f"{path}: is not an .npz file: expected one with spikes and targets", hint=HINT) from None
    except KeyError as error:
        raise ModelError(f"{path}: {error.args[0]}: expected spikes and targets", hint=HINT) from None
    inward, outward = (tuple(int(side) for side in net.populations[name].shape) for name in (plan.input, plan.output))
    sizes = int(np.prod(inward)), int(np.prod(outward))
    for name, array, size in (("spikes", spikes, sizes[0]), ("targets", targets, sizes[1])):
        if array.ndim >= 2 and not len(array):
            raise ModelError(f"{path}: {name}: found no recording: expected at least one", hint=HINT)
        if array.ndim < 3 or not array.shape[1] or array[0, 0].size != size or array.shape[:2] != spikes.shape[:2]:
            expected = f"(recordings, steps, {size}), with equal numbers in spikes and targets"
            raise ModelError(f"{path}: {name}: found the shape {array.shape}: expected {expected}", hint=HINT)
    if (large := np.abs(targets) > LARGEST).any():
        recording, step = np.argwhere(large)[0][:2]
        message = f"{path}: targets: recording {recording}, step {step}: found {targets[large][0]:g}"
        raise ModelError(f"{message}: expected at most {LARGEST:g} mV, or NaN for no demand", hint=HINT)
    if np.isnan(targets).all():
        raise ModelError(f"{path}: targets: all are NaN: expected some numbers in mV", hint=HINT)
    if not spikes.any():
        raise ModelError(f"{path}: spikes: all are 0: expected a recording with an event", hint=HINT)
    events = Events.of_dense({plan.input: spikes.reshape(*spikes.shape[:2], -1)})
    digest = hashlib.sha256(content).hexdigest()[:32]
    wanted_mV = targets.astype(np.float32).reshape(*targets.shape[:2], -1)
    return BatchData(events, wanted_mV, (), inward, digest)


def probe(output: str) -> str:
    """Return the name of the probe that records the output's potentials."""
    return f"{output}_V_m"


def r_squared(values: Array, targets: Array) -> float:
    """Return R2, the explained share of the targets' variance, as the mean over the neurons whose targets vary.

    1 is perfect; the mean of the targets as a prediction gives 0. NaN if no neuron's targets vary.

    Args:
        values: (..., neurons) predictions.
        targets: (..., neurons), NaN for no demand.
    """
    targets = np.asarray(targets, dtype=np.float64)
    sample_axes = tuple(range(targets.ndim - 1))
    has_targets = ~np.isnan(targets).all(axis=sample_axes)
    values, targets = np.asarray(values)[..., has_targets], targets[..., has_targets]
    varies = np.nanmin(targets, axis=sample_axes) < np.nanmax(targets, axis=sample_axes)
    values, targets = values[..., varies], targets[..., varies]
    if not targets.size:
        return float("nan")
    errors = np.nanmean((values - targets) ** 2, axis=sample_axes)
    return float(np.mean(1.0 - errors / np.nanvar(targets, axis=sample_axes)))


def r_squared_text(value: float) -> str:
    """Return R2 with three digits, or the reason why it is undefined."""
    return "no R2 (constant targets)" if np.isnan(value) else f"R2 {value:.3f}"
