"""Networks as people read them: tables of what was said."""

from __future__ import annotations

from collections.abc import Iterator

from neuro.core.english import some
from neuro.core.quantities import word_of
from neuro.core.tables import Table
from neuro.model.parts import Description
from neuro.model.words import in_words, neurons, synapses

_UNKNOWN = "-"


def heading(net: Description) -> str:
    """The name of a network and its size."""
    sizes = [neurons(part) for part in net.populations.values()]
    size = "" if None in sizes else f"{some(sum(filter(None, sizes)), 'neuron')} in "
    return f"{net.name}: {size}{some(len(sizes), 'population')}, resolution {net.resolution:g} ms"


def tables(net: Description) -> list[Table]:
    """What a network consists of, as it was described; a kind of part that it has none of has no rows."""
    trials = net.trials_section
    said = ", ".join(f"{word_of(name)}={in_words(value)}" for name, value in trials.changed().items()) if trials else ""
    return [
        Table("populations", ("name", "model", "shape", "parameters"), tuple(_populations(net))),
        Table(
            "projections",
            ("name", "from", "to", "rule", ">synapses", "synapse", ">weight", ">delay (ms)"),
            tuple(_projections(net)),
        ),
        Table("signals", ("name", "to"), tuple((part.name, in_words(part.to)) for part in net.signals.values())),
        Table("groups", ("name", "what"), tuple((part.name, in_words(part.choice)) for part in net.groups.values())),
        Table("probes", ("name", "of", "record", ">every (ms)"), tuple(_probes(net))),
        Table("trials", ("what",), ((said,),) if trials else ()),
    ]


def _populations(net: Description) -> Iterator[tuple[str, ...]]:
    for part in net.populations.values():
        units = {word: q.unit for word, q in part.model.quantities().items()}
        units |= {state.name: state.unit for state in part.model.states}
        said = {word_of(name): value for name, value in part.model.changed().items()}
        told = [f"{word} = {in_words(value)} {units[word]}".rstrip() for word, value in said.items()]
        told += [f"{word} at 0 ms = {in_words(value)} {units[word]}".rstrip() for word, value in part.initial.items()]
        yield part.name, part.model.name, _shape(part.shape), ", ".join(told)


def _projections(net: Description) -> Iterator[tuple[str, ...]]:
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


def _probes(net: Description) -> Iterator[tuple[str, ...]]:
    for part in net.probes.values():
        every = "" if part.record == "spikes" else in_words(part.every) if part.every else f"{net.resolution:g}"
        every = every if part.at is None else f"at {part.at.replace('_', ' ')}"
        record = part.record if isinstance(part.record, str) else ", ".join(part.record)
        of = part.of if part.view is None else repr(part.view)
        ends = (("from", part.pre), ("to", part.post))
        of += "".join(f" {word} {view}" for word, view in ends if view is not None)
        yield part.name, of, f"mean {record}" if part.mean else record, every


def _shape(shape: tuple[int | str, ...]) -> str:
    return " x ".join(f"{axis:,}" if isinstance(axis, int) else axis for axis in shape)
