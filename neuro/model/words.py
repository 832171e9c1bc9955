"""Networks and parts as people read them: what was said, units, no place in a file and no long array."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import PurePath
from typing import Any

import numpy as np

from neuro.core.choice import Choice
from neuro.core.errors import some
from neuro.core.quantities import word_of
from neuro.core.tables import Table, as_html, as_text
from neuro.core.values import FromFile, same, shown

_LISTED = 6
_UNITS = {"every": "ms"}


def one_line(part: Any) -> str:
    """A part as a call would make it: what is not as by default, without its place in a file."""
    said = (
        f"{field.name}={repr(value) if isinstance(value, (str, Choice)) else in_words(value)}"
        for field, value in _said(part)
    )
    return f"{type(part).__name__}({', '.join([repr(part.name), *said])})"


def in_full(part: Any) -> str:
    """A part with all parameters of what it is made of, and their units."""
    return as_text(f"{part.word} '{part.name}'", _tables(part))


def in_html(part: Any) -> str:
    """The same for a notebook."""
    return as_html(f"{part.word} '{part.name}'", _tables(part))


def _tables(part: Any) -> list[Table]:
    if part.word == "projection":
        rows = _of_projection(part)
    elif part.word == "population":
        rows = _of_population(part)
    else:
        rows = ((field.name, in_words(value), _UNITS.get(field.name, "")) for field, value in _said(part))
    made_of = [getattr(part, field.name) for field in fields(part)]
    parameters = (_parameters(each) for each in made_of if isinstance(each, Choice))
    return [Table("", ("word", "value", "unit"), tuple(rows)), *parameters]


def _of_population(part: Any) -> Iterator[tuple[str, str, str]]:
    units = {state.name: state.unit for state in part.model.states}
    for field, value in _said(part):
        if field.name == "initial":
            yield from ((f"{name} at 0 ms", in_words(each), units[name]) for name, each in value.items())
        else:
            yield field.name, in_words(value), ""


def _of_projection(part: Any) -> Iterator[tuple[str, str, str]]:
    pre, post = part.between or (None, None)
    sides = (("from", part.source, part.source_view, pre), ("to", part.target, part.target_view, post))
    for word, name, view, population in sides:
        shape = None if population is None else population.sizes
        if view is not None:
            shape = None if shape is None or neurons(population) is None else view.shape
        of = name if view is None else repr(view)
        yield word, of if shape is None else f"{of}, shape {in_words(list(shape))}", ""
    yield "rule", in_words(part.rule), ""
    made = None if pre is None or post is None else synapses(part, pre, post)
    if made is not None:
        yield "synapses", f"{made:,}", ""
    yield "synapse", in_words(part.synapse), ""
    current = pre is not None and pre.model.role == "current"
    yield "weight", in_words(part.weight), "" if post is None or current else getattr(post.model, "weight_unit", "")
    yield "delay", in_words(part.delay), "ms"


def neurons(part: Any) -> int | None:
    """The size of a population; None where a grid or a recording decides it."""
    sizes = [axis for axis in part.sizes if isinstance(axis, int)]
    return math.prod(sizes) if len(sizes) == len(part.sizes) else None


def synapses(part: Any, source: Any, target: Any) -> int | None:
    """How many synapses a projection between these populations makes; None where that is drawn or follows later."""
    pre, post = neurons(source), neurons(target)
    if pre is None or post is None:
        return None
    pre = pre if part.source_view is None else len(part.source_view)
    post = post if part.target_view is None else len(part.target_view)
    same = part.source == part.target
    # Between views of one population as many autapses are left out as neurons are in both.
    if same and not (part.source_view is None and part.target_view is None):
        return None
    made: int | None = part.rule.synapses(pre, post, same)
    return made


def _parameters(choice: Choice) -> Table:
    changed = {word_of(name) for name in choice.changed()}
    defaults = {word: in_words(value) for word, value in choice.defaults().items() if word in changed}
    units = {word: q.unit for word, q in choice.quantities().items()}
    rows = ((word, in_words(value), units[word], defaults.get(word, "")) for word, value in choice.parameters().items())
    return Table(choice.name, ("parameter", ">value", "unit", ">default"), tuple(rows))


def _said(part: Any) -> Iterator[tuple[Any, Any]]:
    for field in fields(part):
        value = getattr(part, field.name)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in ("name", "origin", "between") and (default is MISSING or not same(value, default)):
            yield field, value


def in_words(value: Any) -> str:
    """A value in few words: of an array its range, of a choice what differs from its defaults."""
    values = value.values if isinstance(value, FromFile) else value
    if isinstance(values, np.ndarray) and values.size > _LISTED and values.dtype.kind in "fiu":
        return f"{values.min():g} .. {values.max():g} ({values.size:,} values)"
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        return shown(values.tolist())
    if isinstance(value, Choice):
        if len(fields(value)) == 1 and value.changed():  # as of_distance, which is of one thing alone
            return f"{value.name}({in_words(next(iter(value.changed().values())))})"
        words = ", ".join(f"{word_of(name)}={in_words(each)}" for name, each in value.changed().items())
        return f"{value.name}({words})" if words else value.name
    if isinstance(value, str):
        return value
    return str(value) if isinstance(value, PurePath) else shown(value)


_UNKNOWN = "-"


def heading(net: Any) -> str:
    """The name of a network and its size."""
    sizes = [neurons(part) for part in net.populations.values()]
    size = "" if None in sizes else f"{some(sum(filter(None, sizes)), 'neuron')} in "
    return f"{net.name}: {size}{some(len(sizes), 'population')}, resolution {net.resolution:g} ms"


def tables(net: Any) -> list[Table]:
    """What a network consists of, as it was described; a kind of part that it has none of has no rows."""
    return [
        Table("populations", ("name", "model", "shape", "parameters"), tuple(_populations(net))),
        Table(
            "projections",
            ("name", "from", "to", "rule", ">synapses", "synapse", ">weight", ">delay (ms)"),
            tuple(_projections(net)),
        ),
        _signals(net),
        Table("groups", ("name", "what"), tuple((part.name, in_words(part.choice)) for part in net.groups.values())),
        Table("probes", ("name", "of", "record", ">every (ms)"), tuple(_probes(net))),
        Table("trials", ("what",), _section(net.trials_section)),
        Table("readout", ("what",), _section(net.readout_section)),
        Table("world", ("what",), _section(net.world_section)),
    ]


def _section(section: Any) -> tuple[tuple[str], ...]:
    """A row of what a section says; none where there is no such section."""
    if section is None:
        return ()
    return ((", ".join(f"{word_of(name)}={in_words(value)}" for name, value in section.changed().items()),),)


def _signals(net: Any) -> Table:
    """The signals with their sources."""
    columns = (
        ("name", "to", "values") if any(part.values is not None for part in net.signals.values()) else ("name", "to")
    )
    rows = (tuple(in_words(part.value(word)) for word in columns) for part in net.signals.values())
    return Table("signals", columns, tuple(rows))


def _populations(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.populations.values():
        units = {word: q.unit for word, q in part.model.quantities().items()}
        units |= {state.name: state.unit for state in part.model.states}
        said = {word_of(name): value for name, value in part.model.changed().items()}
        words = [f"{word} = {in_words(value)} {units[word]}".rstrip() for word, value in said.items()]
        words += [f"{word} at 0 ms = {in_words(value)} {units[word]}".rstrip() for word, value in part.initial.items()]
        shape = " x ".join(f"{axis:,}" if isinstance(axis, int) else axis for axis in part.shape)
        yield part.name, part.model.name, shape, ", ".join(words)


def _projections(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.projections.values():
        made = synapses(part, net.populations[part.source], net.populations[part.target])
        yield (
            part.name,
            part.source if part.source_view is None else repr(part.source_view),
            part.target if part.target_view is None else repr(part.target_view),
            in_words(part.rule),
            _UNKNOWN if made is None else f"{made:,}",
            in_words(part.synapse),
            in_words(part.weight),
            in_words(part.delay),
        )


def _probes(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.probes.values():
        every = "" if part.record == "spikes" else in_words(part.every) if part.every else f"{net.resolution:g}"
        every = every if part.at is None else f"at {part.at.replace('_', ' ')}"
        record = part.record if isinstance(part.record, str) else ", ".join(part.record)
        of = part.of if part.view is None else repr(part.view)
        ends = (("from", part.pre), ("to", part.post))
        of += "".join(f" {word} {view}" for word, view in ends if view is not None)
        yield part.name, of, f"mean {record}" if part.mean else record, every
