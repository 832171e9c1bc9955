"""Recordings with their classes, and the readout of a network: input, output, and the spikes of the input."""

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
"""A threshold in mV above which a neuron counts as one that never fires, as in graphs of NIR."""


@dataclass(frozen=True, slots=True, eq=False)
class AskedRecordings:
    """Recordings of several places.

    Attributes:
        samples: the recordings.
        labels: the name of the class of each; None where it is not asked for.
        classes: those that were found, in order.
    """

    samples: tuple[Sample, ...]
    labels: tuple[str, ...] | None
    classes: tuple[str, ...]


def gather(paths: Iterable[Path], part: str | None, labelled: bool) -> AskedRecordings:
    """Collect recordings.

    Args:
        paths: recordings, folders or zips of class folders, HDF5 data sets.
        part: part of data with parts; a single recording has none.
        labelled: the class of each recording is needed; a single recording has the name of its folder.

    Raises:
        EventFileError: there is no recording, or the part does not exist.
        ModelError: the class of a recording is unknown.
    """
    samples, labels, classes = list[Sample](), list[str](), dict[str, None]()
    for path in paths:
        source = recordings(path, part=part)
        alone = source.layout == "recording"
        classes |= dict.fromkeys([path.resolve().parent.name] if alone else source.classes)
        samples += source
        for item in source if labelled else ():
            if not alone and item.label == UNKNOWN:
                raise ModelError(f"{item.path}: its class is not known: expected recordings in folders of classes")
            labels.append(path.resolve().parent.name if alone else source.classes[item.label])
    return AskedRecordings(tuple(samples), tuple(labels) if labelled else None, tuple(classes))


def with_classes(readout: Readout, has_names: bool, classes: Sequence[str]) -> Readout:
    """Return a readout with the classes of the recordings, if the neurons have no names of their own.

    Args:
        readout: its classes are numbers if the neurons have no names.
        has_names: the neurons have names.
        classes: classes of the recordings, in order; as many as neurons, or numbers of neurons.
    """
    if has_names or set(classes) <= set(readout.classes) or len(classes) != len(readout.classes):
        return readout
    return replace(readout, classes=tuple(classes))


def readout_of(net: Network, **words: Any) -> Readout:
    """Return a network's readout, with the arguments and errors of `neuro.predict`; classes are named or numbered."""
    settings = {} if net.readout_section is None else net.readout_section.parameters()
    settings |= {word: value for word, value in words.items() if value is not None}
    readout = Readout.from_words({"input": _input(net), "output": _output(net)} | settings)
    _check_clear(net, readout)
    for word in ("input", "output"):
        if (name := getattr(readout, word)) not in net.populations:
            raise unknown(f"population for --{word}", name, net.populations)
    _check_input(net.populations[readout.input], readout.input)
    output, what = net.populations[readout.output], f"--output {readout.output}"
    if output.model.role != "neuron":
        raise ModelError(f"{what}: found {output.model.name}: expected neurons")
    if readout.decide is None:
        readout = replace(readout, decide="counts" if fires(output) else "potential")
    elif readout.decide != "potential" and not fires(output):
        message = f"--decide {readout.decide}: the neurons of '{readout.output}' never fire"
        raise ModelError(f"{message}: expected {DECIDED_BY[1]}", hint="--decide potential takes the highest mean V_m")
    neurons, names = _size(output), readout.classes
    if names is not None and (len(names) != neurons or len(set(names)) < neurons):
        message = f"{what}: {neurons} neurons and the classes {', '.join(names)}"
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
    last = neurons - {part.source for part in net.projections.values() if part.source != part.target}
    outputs = probed if len(probed) == 1 else last
    return next(iter(outputs)) if len(outputs) == 1 else ""


def _check_clear(net: Network, readout: Readout) -> None:
    """Refuse to guess the input or the output."""
    roles = {"input": "spike_generator", "output": "population of neurons that is probed, or that sends to no other,"}
    for word, what in roles.items():
        if not getattr(readout, word):
            names = ", ".join(f"'{name}'" for name in net.populations)
            message = f"--{word} is not given: expected just one {what} among {names}"
            raise ModelError(message, hint=f"--{word} NAME takes one of them")


def _check_input(pixels: Population, name: str) -> None:
    if not isinstance(pixels.model, spike_generator):
        what = f"--input {name}: found {pixels.model.name}"
        raise ModelError(f"{what}: expected a spike_generator, whose spikes recordings are")
    try:
        check_pixels(pixels.shape)
    except ModelError as error:
        hint = "another shape of as many neurons in its file keeps their numbers"
        raise error.but(hint=hint).at(None, f"--input {name}") from None


def fires(part: Population) -> bool:
    """Return True if any neuron of a population can reach its threshold."""
    threshold = getattr(part.model, "V_th", 0.0)
    values = getattr(threshold, "values", threshold)  # of a file
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
        steps: steps of a run; None if each recording decides.
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
        """Refuse a recording that is damaged, or of another sensor."""
        events = load(item)
        size, stated = (item.sensor_size, True) if isinstance(item, Events) else item.sensor()
        if self._readout.window is None and stated:
            self._refuse(size, name)
        self.spikes(events, name)

    def spikes(self, events: Events, name: str) -> tuple[Ints, Ints]:
        """Return the steps, from 0 on, and the neurons of the spikes."""
        readout = self._readout
        if readout.window is not None:
            rows, columns = self._shape[-2:]
            at = None if readout.window == (CENTRED,) else readout.window
            length = (int(events.t[-1] - events.t[0]) + 1) / 1000.0 if len(events) else 0.0
            length_ms = length if self.steps is None else self.steps * self._h
            events = windowed(
                events, (columns * readout.scale, rows * readout.scale), at, readout.start, length_ms, name
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
        at_once = np.unique(step * size + neuron)
        return at_once // size, at_once % size

    def _fits(self, size: tuple[int, int]) -> bool:
        rows, columns = self._shape[-2:]
        return size[0] <= columns * self._readout.scale and size[1] <= rows * self._readout.scale

    def _refuse(self, size: tuple[int, int], name: str) -> None:
        """Refuse a sensor of another width and height than that of the pixels."""
        scale, (rows, columns) = self._readout.scale, self._shape[-2:]
        if tuple(-(-side // scale) for side in size) != (columns, rows):
            expected = f"{columns * scale}x{rows * scale} px, as --input {self._readout.input} has the shape"
            by = f" at scale {scale}" if scale > 1 else ""
            hint = "in its file 'readout: {..., window: centred}' shows a part of the sensor, 'scale: 2' joins pixels"
            message = f"{name}: found {size[0]}x{size[1]} px: expected {expected} {list(self._shape)}{by}"
            raise ModelError(message, hint=hint)


def load(item: Any) -> Events:
    """The events of a recording.

    Raises:
        EventFileError: it is damaged.
        ModelError: it is no recording.
    """
    if isinstance(item, Events):
        return item
    if not hasattr(item, "load"):
        hint = "neuro.events.recordings(path) finds them, [neuro.events.load(path)] is one"
        raise ModelError(f"recordings: found {shown(item)}: expected recordings, or the events of each", hint=hint)
    return cast(Sample, item).load()


def name_of(item: Any, k: int) -> str:
    """Return the name of the recording with index k."""
    return str(getattr(item, "path", f"recording {k}"))
