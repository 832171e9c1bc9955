"""How a network is asked about recordings: what is said, and what follows from the network."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from neuro.coding.encoders import check_pixels
from neuro.core.errors import ModelError, unknown
from neuro.exchange.nir.nodes import NEVER
from neuro.model.network import Network
from neuro.model.neurons import spike_generator
from neuro.model.parts import AUTO, DECIDED_BY, Population, Readout


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
    return not isinstance(values, (int, float, np.ndarray)) or bool(np.any(np.asarray(values) < NEVER))


def _size(part: Population) -> int:
    if AUTO in part.shape:
        raise ModelError(f"--output {part.name}: shape {list(part.shape)}: expected numbers, a neuron for each class")
    return math.prod(int(side) for side in part.shape)
