"""The recordings and the readout of a prediction: their collection, their checks, and the spikes of the recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from neuro import ModelError, Network, Readout, spike_generator
from neuro.apps import AUTO, CENTRED, DECIDED_BY, Clock, Population, check_pixels, pixel_spikes, shown, unknown
from neuro_events import Events, recordings
from neuro_events.dataset import UNKNOWN, Sample
from neuro_events.parts import windowed

_NEVER = 1e20
"""Threshold, mV. A neuron with this threshold or a higher one never fires; graphs of NIR use 1e20 for such neurons."""


@dataclass(frozen=True, slots=True, eq=False)
class AskedRecordings:
    """Recordings from several files and folders.

    Attributes:
        samples: the recordings.
        labels: name of the class of each recording; None if labels were not requested.
        classes: names of all classes, in order.
    """

    samples: tuple[Sample, ...]
    labels: tuple[str, ...] | None
    classes: tuple[str, ...]


def gather(paths: Iterable[Path], part: str | None, labelled: bool) -> AskedRecordings:
    """Collect recordings.

    Args:
        paths: recordings, folders or zips of class folders, HDF5 data sets.
        part: part of a data set, e.g. "Test"; single recordings have no parts.
        labelled: whether the class of each recording is needed. The class of a single recording is its folder's name.

    Raises:
        EventFileError: there is no recording, or the part does not exist.
        ModelError: the class of a recording is unknown.
    """
    samples, labels, classes = list[Sample](), list[str](), dict[str, None]()
    for path in paths:
        source = recordings(path, part=part)
        is_single = source.layout == "recording"
        classes |= dict.fromkeys([path.resolve().parent.name] if is_single else source.classes)
        samples += source
        for item in source if labelled else ():
            if not is_single and item.label == UNKNOWN:
                raise ModelError(f"{item.path}: its class is not known: expected recordings in folders of classes")
            labels.append(path.resolve().parent.name if is_single else source.classes[item.label])
    return AskedRecordings(tuple(samples), tuple(labels) if labelled else None, tuple(classes))


def with_classes(readout: Readout, has_names: bool, classes: Sequence[str]) -> Readout:
    """Return a readout with the classes of the recordings, if the neurons have no names of their own.

    Args:
        readout: the readout; its classes are numbers if the neurons have no names.
        has_names: whether the neurons have names.
        classes: classes of the recordings, in order. They are used if there are as many classes as neurons.
    """
    if has_names or set(classes) <= set(readout.classes) or len(classes) != len(readout.classes):
        return readout
    return replace(readout, classes=tuple(classes))


def readout_of(net: Network, **options: Any) -> Readout:
    """Return a network's readout. Arguments and errors are those of `neuro.predict`; unnamed classes are numbered."""
    settings = {} if net.readout_section is None else net.readout_section.parameters()
    settings |= {word: value for word, value in options.items() if value is not None}
    readout = Readout.from_words({"input": _input(net), "output": _output(net)} | settings)
    _check_clear(net, readout)
    for word in ("input", "output"):
        if (name := getattr(readout, word)) not in net.populations:
            raise unknown(f"population for --{word}", name, net.populations)
    _check_input(net.populations[readout.input], readout.input)
    output, option = net.populations[readout.output], f"--output {readout.output}"
    if output.model.role != "neuron":
        raise ModelError(f"{option}: found {output.model.name}: expected neurons")
    if readout.decide is None:
        readout = replace(readout, decide="counts" if fires(output) else "potential")
    elif readout.decide != "potential" and not fires(output):
        message = f"--decide {readout.decide}: the neurons of '{readout.output}' never fire"
        raise ModelError(f"{message}: expected {DECIDED_BY[1]}", hint="--decide potential takes the highest mean V_m")
    neurons, names = _size(output), readout.classes
    if names is not None and (len(names) != neurons or len(set(names)) < neurons):
        message = f"{option}: {neurons} neurons and the classes {', '.join(names)}"
        raise ModelError(f"{message}: expected as many different names as neurons")
    return replace(readout, classes=tuple(map(str, range(neurons))) if names is None else names)


def _input(net: Network) -> str:
    """Return the only population that recordings can be shown to; "" if there are several."""
    inputs = [name for name, part in net.populations.items() if isinstance(part.model, spike_generator)]
    return inputs[0] if len(inputs) == 1 else ""


def _output(net: Network) -> str:
    """Return the only population of neurons with a probe, or without targets; "" if there are several."""
    neurons = {name for name, part in net.populations.items() if part.model.role == "neuron"}
    probed = {probe.of for probe in net.probes.values()} & neurons
    unconnected = neurons - {part.source for part in net.projections.values() if part.source != part.target}
    outputs = probed if len(probed) == 1 else unconnected
    return next(iter(outputs)) if len(outputs) == 1 else ""


def _check_clear(net: Network, readout: Readout) -> None:
    """Raise an error if the network does not determine the input or the output."""
    roles = {"input": "spike_generator", "output": "population of neurons that is probed, or that sends to no other,"}
    for word, role in roles.items():
        if not getattr(readout, word):
            names = ", ".join(f"'{name}'" for name in net.populations)
            message = f"--{word} is missing: expected exactly one {role} among {names}"
            raise ModelError(message, hint=f"--{word} NAME selects a population")


def _check_input(pixels: Population, name: str) -> None:
    if not isinstance(pixels.model, spike_generator):
        option = f"--input {name}: found {pixels.model.name}"
        raise ModelError(f"{option}: expected a spike_generator, which emits the spikes of a recording")
    try:
        check_pixels(pixels.shape)
    except ModelError as error:
        hint = "change its shape in the network's file; with as many neurons, all keep their numbers"
        raise error.but(hint=hint).at(None, f"--input {name}") from None


def fires(part: Population) -> bool:
    """Return True if any neuron of a population can reach its threshold."""
    threshold = getattr(part.model, "V_th", 0.0)
    values = getattr(threshold, "values", threshold)  # the values of a threshold from a file
    return not isinstance(values, (int, float, np.ndarray)) or bool(np.any(np.asarray(values) < _NEVER))


def _size(part: Population) -> int:
    if AUTO in part.shape:
        raise ModelError(f"--output {part.name}: shape {list(part.shape)}: expected numbers, a neuron for each class")
    return math.prod(int(side) for side in part.shape)


Ints = npt.NDArray[np.int64]


class Pixels:
    """Conversion of recordings to spikes of a network's input.

    Args:
        net: the network.
        readout: the readout.

    Attributes:
        steps: number of steps of a run; None: each run is as long as its recording.
        events: number of events of the last recording that became spikes.
    """

    def __init__(self, net: Network, readout: Readout) -> None:
        self._readout, self._h = readout, net.resolution
        self._shape = tuple(int(side) for side in net.populations[readout.input].shape)
        self.steps = None if readout.duration is None else Clock(self._h).step(readout.duration, "--for")
        self.events = 0
        if self.steps == 0:
            raise ModelError(f"--for = {readout.duration:g} ms: expected at least a step of {self._h:g} ms")

    def check(self, item: Sample | Events, name: str) -> None:
        """Raise an error for a damaged recording, or for a recording whose sensor does not fit the pixels."""
        events = load(item)
        size, is_stated = (item.sensor_size, True) if isinstance(item, Events) else item.sensor()
        if self._readout.window is None and is_stated:
            self._refuse(size, name)
        self.spikes(events, name)

    def spikes(self, events: Events, name: str) -> tuple[Ints, Ints]:
        """Return the steps, from 0 on, and the neurons of the spikes."""
        readout = self._readout
        if readout.window is not None:
            rows, columns = self._shape[-2:]
            corner = None if readout.window == (CENTRED,) else readout.window
            length = (int(events.t[-1] - events.t[0]) + 1) / 1000.0 if len(events) else 0.0
            length_ms = length if self.steps is None else self.steps * self._h
            events = windowed(
                events, (columns * readout.scale, rows * readout.scale), corner, readout.start, length_ms, name
            )
        elif len(events) and not self._fits((int(events.x.max()) + 1, int(events.y.max()) + 1)):
            self._refuse((int(events.x.max()) + 1, int(events.y.max()) + 1), name)
        step, neuron = pixel_spikes(
            events, self._shape, self._h, steps=self.steps, scale=readout.scale, start=readout.start
        )
        self.events = len(step)
        if not readout.merge:
            return step, neuron
        size = math.prod(self._shape)
        spike_indices = np.unique(step * size + neuron)
        return spike_indices // size, spike_indices % size

    def _fits(self, size: tuple[int, int]) -> bool:
        rows, columns = self._shape[-2:]
        return size[0] <= columns * self._readout.scale and size[1] <= rows * self._readout.scale

    def _refuse(self, size: tuple[int, int], name: str) -> None:
        """Raise an error if the width or height of a sensor differs from that of the pixels."""
        scale, (rows, columns) = self._readout.scale, self._shape[-2:]
        if tuple(-(-side // scale) for side in size) != (columns, rows):
            expected = f"{columns * scale}x{rows * scale} px, as --input {self._readout.input} has the shape"
            scale_text = f" at scale {scale}" if scale > 1 else ""
            hint = "'window: centred' in the file's section readout shows a part of the sensor, 'scale: 2' joins pixels"
            message = f"{name}: found {size[0]}x{size[1]} px: expected {expected} {list(self._shape)}{scale_text}"
            raise ModelError(message, hint=hint)


def load(item: Any) -> Events:
    """Return the events of a recording.

    Raises:
        EventFileError: the recording is damaged.
        ModelError: the item is not a recording.
    """
    if isinstance(item, Events):
        return item
    if not hasattr(item, "load"):
        hint = "use neuro.events.recordings(path), or [neuro.events.load(path)] for a single recording"
        raise ModelError(f"recordings: found {shown(item)}: expected recordings or their events", hint=hint)
    return cast(Sample, item).load()


def name_of(item: Any, k: int) -> str:
    """Return the name of the recording with index k."""
    return str(getattr(item, "path", f"recording {k}"))
