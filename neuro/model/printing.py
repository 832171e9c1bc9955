"""Networks and their parts as people read them: what was said, units, no place in a file and no long array."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from neuro.core.choice import Choice
from neuro.core.quantities import word_of
from neuro.core.tables import Table, as_text
from neuro.core.values import FromFile, same, shown
from neuro.model.parts import Description, Part, Population, Projection

_LISTED = 6
_UNKNOWN = "-"


def heading(net: Description) -> str:
    """The name of a network and its size."""
    sizes = [neurons(part) for part in net.populations.values()]
    some = "" if None in sizes else f"{sum(filter(None, sizes)):,} neurons in "
    return f"{net.name}: {some}{_count(len(sizes), 'population')}, resolution {net.resolution:g} ms"


def tables(net: Description) -> list[Table]:
    """What a network consists of, as it was described; a kind of part that it has none of has no rows."""
    trials = net.trials_section
    said = ", ".join(f"{word_of(name)}={_value(value)}" for name, value in trials.changed().items()) if trials else ""
    return [
        Table("populations", ("name", "model", "shape", "parameters"), tuple(_populations(net))),
        Table(
            "projections",
            ("name", "from", "to", "rule", ">synapses", "synapse", ">weight", ">delay (ms)"),
            tuple(_projections(net)),
        ),
        Table("signals", ("name", "to"), tuple((part.name, _value(part.to)) for part in net.signals.values())),
        Table("groups", ("name", "what"), tuple((part.name, _value(part.choice)) for part in net.groups.values())),
        Table("probes", ("name", "of", "record", ">every (ms)"), tuple(_probes(net))),
        Table("trials", ("what",), ((said,),) if trials else ()),
    ]


def neurons(part: Population) -> int | None:
    """The size of a population; None where a grid decides it."""
    sizes = [axis for axis in part.shape if isinstance(axis, int)]
    return math.prod(sizes) if len(sizes) == len(part.shape) else None


def one_line(part: Part) -> str:
    """A part as a call would make it: what is not as by default, without its place in a file."""
    said = (
        f"{field.name}={repr(value) if isinstance(value, (str, Choice)) else _value(value)}"
        for field, value in _said(part)
    )
    return f"{type(part).__name__}({', '.join([repr(part.name), *said])})"


def in_full(part: Part) -> str:
    """A part with all parameters of what it is made of, and their units."""
    rows = tuple((field.name, _value(value)) for field, value in _said(part))
    made_of = [getattr(part, field.name) for field in fields(part)]
    return as_text(
        f"{part.word} '{part.name}'",
        [Table("", ("word", "value"), rows), *(_parameters(each) for each in made_of if isinstance(each, Choice))],
    )


def _parameters(choice: Choice) -> Table:
    changed = {word_of(name) for name in choice.changed()}
    defaults = {word: _value(value) for word, value in choice.defaults().items() if word in changed}
    units = {word: q.unit for word, q in choice.quantities().items()}
    rows = ((word, _value(value), units[word], defaults.get(word, "")) for word, value in choice.parameters().items())
    return Table(choice.name, ("parameter", ">value", "unit", ">default"), tuple(rows))


def _said(part: Part) -> Iterator[tuple[Any, Any]]:
    for field in fields(part):
        value = getattr(part, field.name)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in ("name", "origin") and (default is MISSING or not same(value, default)):
            yield field, value


def _populations(net: Description) -> Iterator[tuple[str, ...]]:
    for part in net.populations.values():
        units = {word: q.unit for word, q in part.model.quantities().items()}
        units |= {state.name: state.unit for state in part.model.states}
        said = {word_of(name): value for name, value in part.model.changed().items()}
        told = [f"{word} = {_value(value)} {units[word]}".rstrip() for word, value in said.items()]
        told += [f"{word} at 0 ms = {_value(value)} {units[word]}".rstrip() for word, value in part.initial.items()]
        yield part.name, part.model.name, _shape(part.shape), ", ".join(told)


def _projections(net: Description) -> Iterator[tuple[str, ...]]:
    for part in net.projections.values():
        synapses = _synapses(net, part)
        yield (
            part.name,
            _value(part.source),
            _value(part.target),
            _value(part.rule),
            _UNKNOWN if synapses is None else f"{synapses:,}",
            _value(part.synapse),
            _value(part.weight),
            _value(part.delay),
        )


def _synapses(net: Description, part: Projection) -> int | None:
    pre, post = (neurons(net.populations[name]) for name in (part.source, part.target))
    return None if pre is None or post is None else part.rule.synapses(pre, post, part.source == part.target)


def _probes(net: Description) -> Iterator[tuple[str, ...]]:
    for part in net.probes.values():
        every = "" if part.record == "spikes" else _value(part.every) if part.every else f"{net.resolution:g}"
        yield part.name, _value(part.of), _value(part.record), every


def _shape(shape: tuple[int | str, ...]) -> str:
    return " x ".join(f"{axis:,}" if isinstance(axis, int) else axis for axis in shape)


def _value(value: Any) -> str:
    """A value in few words: of an array its range, of a choice what differs from its defaults."""
    values = value.values if isinstance(value, FromFile) else value
    if isinstance(values, np.ndarray) and values.size > _LISTED and values.dtype.kind in "fiu":
        return f"{values.min():g} .. {values.max():g} ({values.size:,} values)"
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        return shown(values.tolist())
    if isinstance(value, Choice):
        told = ", ".join(f"{word_of(name)}={_value(each)}" for name, each in value.changed().items())
        return f"{value.name}({told})" if told else value.name
    return value if isinstance(value, str) else shown(value)


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'s' * (n != 1)}"
