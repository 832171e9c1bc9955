"""Values of a point put into a network: parameters of its file, of populations, of projections and their rules."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from neuro.core.choice import Choice
from neuro.core.english import a
from neuro.core.errors import ModelError, nearest, unknown
from neuro.core.quantities import word_of
from neuro.model.network import Network
from neuro.model.parts import Population, Projection

RUN = ("backend", "for")
"""Words of the run itself that a sweep may go through."""

PREFIXES = ("backend", "chip")
"""`backend.OPTION` is an option of the backend, `chip.costs.NAME` or `chip.limits.NAME` a figure of its table."""


def sorted_out(
    point: Mapping[str, Any], parameters: Iterable[str]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """A point as parameters of the file, words of the run, and values of parts.

    Raises:
        ModelError: a name without a dot is neither.
    """
    own, run, parts = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for name, value in point.items():
        if name in parameters:
            own[name] = value
        elif name in RUN or name.partition(".")[0] in PREFIXES:
            run[name] = value
        elif "." in name:
            parts[name] = value
        else:
            known = (*parameters, *RUN)
            hint = f"{nearest(name, known)}; of a part: POPULATION.PARAMETER, PROJECTION.weight"
            raise ModelError(f"unknown parameter '{name}'", hint=hint)
    return own, run, parts


def changed(net: Network, values: Mapping[str, Any]) -> Network:
    """A network with other values of parts.

    Args:
        net: the network; it stays as it is.
        values: by `POPULATION.PARAMETER`; `PROJECTION.weight`, `.delay`, or a parameter of its synapse model or of its
            connection rule.

    Raises:
        ModelError: there is no such part or parameter, or a value is out of bounds.
    """
    if not values:
        return net
    other = copy.copy(net)
    other.populations, other.projections = dict(net.populations), dict(net.projections)
    for name, value in values.items():
        part, _, word = name.rpartition(".")
        if part in other.populations:
            other.populations[part] = _population(other.populations[part], word, value)
        elif part in other.projections:
            other.projections[part] = _projection(other, other.projections[part], word, value)
        else:
            raise unknown("population or projection", part, (*other.populations, *other.projections))
    return other


def _population(part: Population, word: str, value: Any) -> Population:
    names = _names(part.model)
    if word not in names:
        raise unknown(f"parameter of '{part.name}', {a(part.model.name)},", word, names)
    return replace(part, model=replace(part.model, **{names[word]: value}))


def _projection(net: Network, part: Projection, word: str, value: Any) -> Projection:
    if word in ("weight", "delay"):
        fresh = copy.copy(net)
        fresh.projections = {}
        fresh.place = part.origin
        ends = [view if view is not None else net.populations[name] for name, view in _ends(part)]
        words = {"weight": part.weight, "delay": part.delay, word: value}
        return fresh.connect(ends[0], ends[1], part.rule, part.synapse, name=part.name, **words)
    synapse, rule = _names(part.synapse), _names(part.rule)
    if word in synapse:
        return replace(part, synapse=replace(part.synapse, **{synapse[word]: value}))
    if word in rule:
        return replace(part, rule=replace(part.rule, **{rule[word]: value}))
    raise unknown(f"parameter of '{part.name}'", word, ("weight", "delay", *synapse, *rule))


def _ends(part: Projection) -> tuple[tuple[str, Any], tuple[str, Any]]:
    return (part.source, part.source_view), (part.target, part.target_view)


def _names(choice: Choice) -> dict[str, str]:
    """Fields of a choice by the words that users write."""
    return {word_of(entry.name): entry.name for entry in fields(choice)}
