"""Networks and parts as text and HTML for people.

Values that differ from defaults are shown with units, long arrays are shown as ranges, and origins are omitted.
"""

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

_MOST_LISTED = 6
_UNITS = {"every": "ms"}


def one_line(part: Any) -> str:
    """Return a part as a Python call that creates the part, without values equal to the defaults."""
    arguments = (
        f"{field.name}={repr(value) if isinstance(value, (str, Choice)) else in_words(value)}"
        for field, value in _set_fields(part)
    )
    return f"{type(part).__name__}({', '.join([repr(part.name), *arguments])})"


def in_full(part: Any) -> str:
    """Return a part as a table, with all parameters of the models and the units."""
    return as_text(f"{part.word} '{part.name}'", _tables(part))


def in_html(part: Any) -> str:
    """Return a part as HTML tables for a notebook."""
    return as_html(f"{part.word} '{part.name}'", _tables(part))


def _tables(part: Any) -> list[Table]:
    if part.word == "projection":
        rows = _projection_rows(part)
    elif part.word == "population":
        rows = _population_rows(part)
    else:
        rows = ((field.name, in_words(value), _UNITS.get(field.name, "")) for field, value in _set_fields(part))
    values = [getattr(part, field.name) for field in fields(part)]
    parameters = (_parameters(choice) for choice in values if isinstance(choice, Choice))
    return [Table("", ("word", "value", "unit"), tuple(rows)), *parameters]


def _population_rows(part: Any) -> Iterator[tuple[str, str, str]]:
    units = {state.name: state.unit for state in part.model.states}
    for field, value in _set_fields(part):
        if field.name == "initial":
            yield from ((f"{name} at 0 ms", in_words(state_value), units[name]) for name, state_value in value.items())
        else:
            yield field.name, in_words(value), ""


def _projection_rows(part: Any) -> Iterator[tuple[str, str, str]]:
    pre, post = part.between or (None, None)
    sides = (("from", part.source, part.source_view, pre), ("to", part.target, part.target_view, post))
    for word, name, view, population in sides:
        shape = None if population is None else population.sizes
        if view is not None:
            shape = None if shape is None or neurons(population) is None else view.shape
        neurons_text = name if view is None else repr(view)
        yield word, neurons_text if shape is None else f"{neurons_text}, shape {in_words(list(shape))}", ""
    yield "rule", in_words(part.rule), ""
    n_synapses = None if pre is None or post is None else synapses(part, pre, post)
    if n_synapses is not None:
        yield "synapses", f"{n_synapses:,}", ""
    yield "synapse", in_words(part.synapse), ""
    is_current = pre is not None and pre.model.role == "current"
    yield "weight", in_words(part.weight), "" if post is None or is_current else getattr(post.model, "weight_unit", "")
    yield "delay", in_words(part.delay), "ms"


def neurons(part: Any) -> int | None:
    """Return the size of a population, or None if a grid or a recording decides it."""
    sizes = [axis for axis in part.sizes if isinstance(axis, int)]
    return math.prod(sizes) if len(sizes) == len(part.sizes) else None


def synapses(part: Any, source: Any, target: Any) -> int | None:
    """Return the number of synapses of a projection, or None if it is random or not known before compilation."""
    pre, post = neurons(source), neurons(target)
    if pre is None or post is None:
        return None
    pre = pre if part.source_view is None else len(part.source_view)
    post = post if part.target_view is None else len(part.target_view)
    is_recurrent = part.source == part.target
    # The number of excluded autapses between two views of one population depends on the shared neurons.
    if is_recurrent and not (part.source_view is None and part.target_view is None):
        return None
    n_synapses: int | None = part.rule.synapses(pre, post, is_recurrent)
    return n_synapses


def _parameters(choice: Choice) -> Table:
    changed = {word_of(name) for name in choice.changed()}
    defaults = {word: in_words(value) for word, value in choice.defaults().items() if word in changed}
    units = {word: q.unit for word, q in choice.quantities().items()}
    rows = ((word, in_words(value), units[word], defaults.get(word, "")) for word, value in choice.parameters().items())
    return Table(choice.name, ("parameter", ">value", "unit", ">default"), tuple(rows))


def _set_fields(part: Any) -> Iterator[tuple[Any, Any]]:
    """Yield each field with a value other than the default, and the value."""
    for field in fields(part):
        value = getattr(part, field.name)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in ("name", "origin", "between") and (default is MISSING or not same(value, default)):
            yield field, value


def in_words(value: Any) -> str:
    """Return a value in a few words: a long array as a range, a choice with the non-default parameters."""
    values = value.values if isinstance(value, FromFile) else value
    if isinstance(values, np.ndarray) and values.size > _MOST_LISTED and values.dtype.kind in "fiu":
        return f"{values.min():g} .. {values.max():g} ({values.size:,} values)"
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        return shown(values.tolist())
    if isinstance(value, Choice):
        if len(fields(value)) == 1 and value.changed():  # e.g. of_distance, whose only field needs no name
            return f"{value.name}({in_words(next(iter(value.changed().values())))})"
        words = ", ".join(f"{word_of(name)}={in_words(field_value)}" for name, field_value in value.changed().items())
        return f"{value.name}({words})" if words else value.name
    if isinstance(value, str):
        return value
    return str(value) if isinstance(value, PurePath) else shown(value)


_UNKNOWN = "-"


def heading(net: Any) -> str:
    """Return the name, size and resolution of a network."""
    sizes = [neurons(part) for part in net.populations.values()]
    size = "" if None in sizes else f"{some(sum(filter(None, sizes)), 'neuron')} in "
    return f"{net.name}: {size}{some(len(sizes), 'population')}, resolution {net.resolution:g} ms"


def tables(net: Any) -> list[Table]:
    """Return a table for each kind of part and each section. Tables of missing parts have no rows."""
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
    """Return one row with the non-default words of a section, or no row without a section."""
    if section is None:
        return ()
    return ((", ".join(f"{word_of(name)}={in_words(value)}" for name, value in section.changed().items()),),)


def _signals(net: Any) -> Table:
    """Return the table of signals, with a column of their sources if there are any."""
    columns = (
        ("name", "to", "values") if any(part.values is not None for part in net.signals.values()) else ("name", "to")
    )
    rows = (tuple(in_words(part.value(word)) for word in columns) for part in net.signals.values())
    return Table("signals", columns, tuple(rows))


def _populations(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.populations.values():
        units = {word: q.unit for word, q in part.model.quantities().items()}
        units |= {state.name: state.unit for state in part.model.states}
        changes = {word_of(name): value for name, value in part.model.changed().items()}
        words = [f"{word} = {in_words(value)} {units[word]}".rstrip() for word, value in changes.items()]
        words += [f"{word} at 0 ms = {in_words(value)} {units[word]}".rstrip() for word, value in part.initial.items()]
        shape = " x ".join(f"{axis:,}" if isinstance(axis, int) else axis for axis in part.shape)
        yield part.name, part.model.name, shape, ", ".join(words)


def _projections(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.projections.values():
        n_synapses = synapses(part, net.populations[part.source], net.populations[part.target])
        yield (
            part.name,
            part.source if part.source_view is None else repr(part.source_view),
            part.target if part.target_view is None else repr(part.target_view),
            in_words(part.rule),
            _UNKNOWN if n_synapses is None else f"{n_synapses:,}",
            in_words(part.synapse),
            in_words(part.weight),
            in_words(part.delay),
        )


def _probes(net: Any) -> Iterator[tuple[str, ...]]:
    for part in net.probes.values():
        interval = "" if part.record == "spikes" else in_words(part.every) if part.every else f"{net.resolution:g}"
        interval = interval if part.at is None else f"at {part.at.replace('_', ' ')}"
        record = part.record if isinstance(part.record, str) else ", ".join(part.record)
        neurons_text = part.of if part.view is None else repr(part.view)
        ends = (("from", part.pre), ("to", part.post))
        neurons_text += "".join(f" {word} {view}" for word, view in ends if view is not None)
        yield part.name, neurons_text, f"mean {record}" if part.mean else record, interval
