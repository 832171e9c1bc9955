"""The question to a network: its recordings with their classes, its input and output, and the spikes of its input."""

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
    """Find the recordings.

    Args:
        paths: recordings, folders or zips of class folders, HDF5 data sets.
        part: of data with parts only this one; a single recording has none.
        labelled: whether the class of each is known; a single recording has the name of its folder.

    Raises:
        EventFileError: there is nothing, or a part is not there.
        ModelError: a class is not known.
    """
    samples, labels, classes = list[Sample](), list[str](), dict[str, None]()
    for path in paths:
        found = recordings(path, part=part)
        alone = found.layout == "recording"
        classes |= dict.fromkeys([path.resolve().parent.name] if alone else found.classes)
        samples += found
        for item in found if labelled else ():
            if not alone and item.label == UNKNOWN:
                raise ModelError(f"{item.path}: its class is not known: expected recordings in folders of classes")
            labels.append(path.resolve().parent.name if alone else found.classes[item.label])
    return AskedRecordings(tuple(samples), tuple(labels) if labelled else None, tuple(classes))


def with_classes(readout: Readout, named: bool, found: Sequence[str]) -> Readout:
    """How a network is asked whose neurons may have no names: then they have those of the recordings.

    Args:
        readout: its classes are numbers where they have no names.
        named: whether they have.
        found: the classes of the recordings, in order; as many as neurons, or numbers of neurons.
    """
    if named or set(found) <= set(readout.classes) or len(found) != len(readout.classes):
        return readout
    return replace(readout, classes=tuple(found))


def readout_of(net: Network, **words: Any) -> Readout:
    """How a network is asked; arguments and errors as of `neuro.predict`. The classes have names, numbers at least."""
    known = {} if net.readout_section is None else net.readout_section.parameters()
    known |= {word: value for word, value in words.items() if value is not None}
    found = Readout.from_words({"input": _input(net), "output": _output(net)} | known)
    _check_clear(net, found)
    for word in ("input", "output"):
        if (name := getattr(found, word)) not in net.populations:
            raise unknown(f"population for --{word}", name, net.populations)
    _check_input(net.populations[found.input], found.input)
    output, what = net.populations[found.output], f"--output {found.output}"
    if output.model.role != "neuron":
        raise ModelError(f"{what}: found {output.model.name}: expected neurons")
    if found.decide is None:
        found = replace(found, decide="counts" if fires(output) else "potential")
    elif found.decide != "potential" and not fires(output):
        message = f"--decide {found.decide}: the neurons of '{found.output}' never fire"
        raise ModelError(f"{message}: expected {DECIDED_BY[1]}", hint="--decide potential takes the highest mean V_m")
    neurons, names = _size(output), found.classes
    if names is not None and (len(names) != neurons or len(set(names)) < neurons):
        message = f"{what}: {neurons} neurons and the classes {', '.join(names)}"
        raise ModelError(f"{message}: expected as many different names as neurons")
    return replace(found, classes=tuple(map(str, range(neurons))) if names is None else names)


def _input(net: Network) -> str:
    """The only population that recordings can be shown to; "" if that is not clear."""
    found = [name for name, part in net.populations.items() if isinstance(part.model, spike_generator)]
    return found[0] if len(found) == 1 else ""


def _output(net: Network) -> str:
    """The only population of neurons that is probed, or that sends to no other; "" if that is not clear."""
    neurons = {name for name, part in net.populations.items() if part.model.role == "neuron"}
    probed = {probe.of for probe in net.probes.values()} & neurons
    last = neurons - {part.source for part in net.projections.values() if part.source != part.target}
    found = probed if len(probed) == 1 else last
    return next(iter(found)) if len(found) == 1 else ""


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
    """Whether any neuron of a population can reach its threshold."""
    threshold = getattr(part.model, "V_th", 0.0)
    values = getattr(threshold, "values", threshold)  # of a file
    return not isinstance(values, (int, float, np.ndarray)) or bool(np.any(np.asarray(values) < _NEVER))


def _size(part: Population) -> int:
    if AUTO in part.shape:
        raise ModelError(f"--output {part.name}: shape {list(part.shape)}: expected numbers, a neuron for each class")
    return math.prod(int(side) for side in part.shape)


Ints = npt.NDArray[np.int64]


class Pixels:
    """What recordings make the input of a network emit.

    Args:
        net: the network.
        readout: how it is asked.

    Attributes:
        steps: for which the network runs, None where that is up to each recording.
    """

    def __init__(self, net: Network, readout: Readout) -> None:
        self._readout, self._h = readout, net.resolution
        self._shape = tuple(int(side) for side in net.populations[readout.input].shape)
        self.steps = None if readout.duration is None else Clock(self._h).step(readout.duration, "--for")
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
        """Steps from 0 on and neurons."""
        asked = self._readout
        if asked.window is not None:
            rows, columns = self._shape[-2:]
            at = None if asked.window == (CENTRED,) else asked.window
            length = (int(events.t[-1] - events.t[0]) + 1) / 1000.0 if len(events) else 0.0
            seen = length if self.steps is None else self.steps * self._h
            events = windowed(events, (columns * asked.scale, rows * asked.scale), at, asked.start, seen, name)
        elif len(events) and not self._fits((int(events.x.max()) + 1, int(events.y.max()) + 1)):
            self._refuse((int(events.x.max()) + 1, int(events.y.max()) + 1), name)
        step, neuron = pixel_spikes(
            events, self._shape, self._h, steps=self.steps, scale=asked.scale, start=asked.start
        )
        if not asked.merge:
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
    """What the recording of index k is called."""
    return str(getattr(item, "path", f"recording {k}"))
