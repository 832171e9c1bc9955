"""What of a network learns: names and words as a user gives them, resolved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from neuro.core.errors import ModelError, unknown
from neuro.model.neurons import Neuron
from neuro.program.program import Program

Words = Mapping[str, tuple[str, ...]]
"""By projection or population what of it learns."""

FIXED = ("t_ref", "refractory_input", "tau_minus")
"""Parameters that count steps or choose, and so have no gradient, and one that only rules of pairs read."""


def trainable(program: Program, given: Iterable[str] | Mapping[str, Iterable[str] | str]) -> tuple[Words, Words]:
    """The words of projections, "weight" and "delay", and those of populations, their parameters.

    Args:
        program: the network.
        given: names of projections, whose weights learn; or by name of a projection or a population what of it learns.

    Raises:
        ModelError: nothing is named, or something that cannot learn.
    """
    asked = {given: "weight"} if isinstance(given, str) else given
    if not isinstance(asked, Iterable) or not all(isinstance(name, str) for name in asked):
        raise ModelError(f"trainable = {given!r}: expected names of projections")
    words = dict(asked) if isinstance(asked, Mapping) else dict.fromkeys(asked, "weight")
    projections = [part.name for part in program.projections if part.carries == "spikes"]
    neurons = {part.name: part for part in program.populations if isinstance(part.model, Neuron)}
    if not projections and not words:
        message = f"network '{program.name}': no projection carries spikes: expected one, whose weights learn"
        raise ModelError(message, hint="net.connect makes one")
    if not words:
        hint = f"known: {', '.join(projections)}"
        raise ModelError("trainable: found no projection: expected at least one", hint=hint)
    found: tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]] = ({}, {})
    for name, word in words.items():
        each = (word,) if isinstance(word, str) else tuple(word) if isinstance(word, Iterable) else ()
        if not each:
            raise ModelError(f"trainable: '{name}': found {word!r}: expected what of it learns, such as 'weight'")
        if name in projections:
            for one in each:
                if one not in ("weight", "delay"):
                    raise unknown(f"word of projection '{name}' that learns", one, ["weight", "delay"])
            _check_delay(program, name, each)
            found[0][name] = each
        elif name in neurons and isinstance(asked, Mapping):
            if "weight" in each:
                message = f"'{name}' is a population, whose neurons have no weight: expected the name of a projection"
                raise ModelError(f"trainable: {message}", hint=f"known: {', '.join(projections)}")
            _check_parameters(name, each, neurons[name].parameters)
            found[1][name] = each
        else:
            known = [*projections, *neurons] if isinstance(asked, Mapping) else projections
            raise unknown("projection", name, known)
    return found


def _check_delay(program: Program, name: str, words: tuple[str, ...]) -> None:
    part = next(part for part in program.projections if part.name == name)
    if "delay" in words and part.grid is not None:
        message = f"trainable: '{name}': synapses of a grid share their delay, which has no gradient"
        raise ModelError(f"{message}: expected its weight alone")


def _check_parameters(population: str, words: tuple[str, ...], known: Mapping[str, Any]) -> None:
    for word in words:
        if word in FIXED:
            raise ModelError(f"trainable: '{population}': {word} has no gradient: expected another parameter")
        if word not in known:
            raise unknown(f"parameter of '{population}'", word, [each for each in known if each not in FIXED])
