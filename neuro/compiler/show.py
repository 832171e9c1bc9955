"""A compiled network as tables for people, and as text for comparisons: equal programs have equal text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER, Clock
from neuro.core.tables import Table
from neuro.model.network import Network
from neuro.program.program import Floats, Group, Population, Program, Projection, Trials

_MAX_LISTED = 8


def tables(net: Network, program: Program) -> list[Table]:
    """Return tables of populations, projections, other parts and memory.

    Args:
        net: the network with the connection rules.
        program: compiled form of the network.
    """
    clock = Clock(program.resolution)
    first_tables = [
        Table("populations", ("name", "model", "shape", ">neurons"), tuple(map(_population_row, program.populations))),
        Table(
            "projections",
            ("name", "from", "to", "rule", ">synapses", ">weight", ">delay (ms)", "synapse", ">bytes"),
            tuple(_projection_row(net, program, part, clock) for part in program.projections),
        ),
    ]
    other_rows = tuple(_rest(program, clock))
    if other_rows:
        first_tables.append(Table("more", ("kind", "name", "of", "what"), other_rows))
    neurons = sum(_bytes(*p.parameters.values(), *p.initial.values()) for p in program.populations)
    synapses = sum(_projection_bytes(p) for p in program.projections)
    total = (("neurons", _grouped(neurons)), ("synapses", _grouped(synapses)))
    return [*first_tables, Table("memory", ("what", ">bytes"), total)]


def program_text(program: Program) -> str:
    """Return a compiled network as text, line by line; equal programs give equal text."""
    return "\n".join(_lines(program)) + "\n"


def summary(values: NDArray[Any]) -> str:
    """Return an array as short text: all values of a short array, else range and mean."""
    flat = values.ravel()
    if flat.size == 1:
        return f"{flat[0]:g}"
    if not flat.size:
        return "none"
    if flat.size <= _MAX_LISTED:
        return "[" + ", ".join(f"{value:g}" for value in flat) + "]"
    return f"{flat.min():g} .. {flat.max():g}, mean {flat.mean():.6g}, {flat.size} values"


def _population_row(part: Population) -> tuple[str, ...]:
    return part.name, part.model_name, " x ".join(map(str, part.shape)), _grouped(part.size)


def _projection_row(net: Network, program: Program, part: Projection, clock: Clock) -> tuple[str, ...]:
    return (
        part.name,
        program.populations[part.source].name,
        program.populations[part.target].name,
        _rule_text(net, part),
        _grouped(part.size),
        _range(part.weight),
        _range(clock.array_ms(part.delay.astype(np.int64))),
        part.synapse.name if part.receptor is None else f"{part.synapse.name} to {part.receptor.name}",
        _grouped(_projection_bytes(part)),
    )


def _rule_text(net: Network, part: Projection) -> str:
    rule = net.projections[part.name].rule
    return "pairs" if rule.name == "pairs" else repr(rule).replace("()", "")


def _range(values: Floats) -> str:
    low, high = (values.min(), values.max()) if values.size else (0.0, 0.0)
    return "" if not values.size else f"{low:g}" if low == high else f"{low:g} .. {high:g}"


def _rest(program: Program, clock: Clock) -> Iterator[tuple[str, str, str, str]]:
    name = [part.name for part in program.populations]
    for signal in program.signals:
        yield "signal", signal.name, name[signal.target], "one value for each neuron"
    for group in program.groups:
        yield "group", group.name, name[group.population], _group_text(group)
    for probe in program.probes:
        interval = "" if probe.record == "spikes" else f" every {clock.ms(probe.every):g} ms"
        yield "probe", probe.name, name[probe.population], ("mean " if probe.mean else "") + probe.record + interval
    for part in program.synapse_probes:
        when = f" every {clock.ms(part.every):g} ms" if part.every else " at pre spikes"
        chosen = "" if part.synapses is None else f", {part.synapses.size:,} synapses"
        of = program.projections[part.projection].name
        yield "probe", part.name, of, ("mean " if part.mean else "") + part.record + when + chosen
    if program.trials is not None:
        yield "trials", "", name[program.trials.output], _trials_text(program.trials, name, clock)


def _group_text(group: Group) -> str:
    return f"{group.choice.name}: {group.choice.summary()}"


def _trials_text(trials: Trials, name: list[str], clock: Clock) -> str:
    stop = "to the decision" if trials.stop_at_decision else "to the end"
    labels = f", {trials.maps // trials.maps_per_label} labels" if trials.maps_per_label else ""
    return f"{clock.ms(trials.duration):g} ms from {name[trials.input]}, {stop}, {trials.maps} maps{labels}"


def _lines(program: Program) -> Iterator[str]:
    yield f"program {program.name}"
    yield f"  resolution {program.resolution:g} ms, seed {program.seed}, smallest delay {program.min_delay} steps"
    for number, population in enumerate(program.populations):
        yield from _population_lines(number, population)
    for number, projection in enumerate(program.projections):
        yield from _projection_lines(number, projection)
    for number, signal in enumerate(program.signals):
        yield f"signal {number} {signal.name}: to population {signal.target}"
    for number, group in enumerate(program.groups):
        yield f"group {number} {group.name}: population {group.population}, {_group_text(group)}"
    for number, probe in enumerate(program.probes):
        mean = "mean " if probe.mean else ""
        message = f"population {probe.population}, {mean}{probe.record}, every {probe.every} steps"
        yield f"probe {number} {probe.name}: {message}"
    for number, part in enumerate(program.synapse_probes):
        mean, chosen = "mean " if part.mean else "", "all" if part.synapses is None else summary(part.synapses)
        message = f"projection {part.projection}, {mean}{part.record}, every {part.every} steps, synapses {chosen}"
        yield f"synapse probe {number} {part.name}: {message}"
    if program.trials is not None:
        yield from _trials_lines(program.trials)


def _population_lines(number: int, part: Population) -> Iterator[str]:
    spikes = "spikes kept" if part.records else "spikes not kept"
    yield f"population {number} {part.name}: {part.model_name}, shape {list(part.shape)}, {part.size} neurons, {spikes}"
    for word, values in part.parameters.items():
        yield f"  {word} = {summary(values)}"
    for word, values in part.initial.items():
        yield f"  {word} at step 0 = {summary(values)}"
    if part.spike_steps.size:
        yield f"  spikes at steps {summary(part.spike_steps)} of neurons {summary(part.spike_ids)}"
    if part.start or part.stop < NEVER:
        yield f"  emits in steps {part.start} < k <= {'never' if part.stop >= NEVER else part.stop}"


def _projection_lines(number: int, part: Projection) -> Iterator[str]:
    yield f"projection {number} {part.name}: {part.source} -> {part.target}, {part.layout}, {part.size} synapses"
    if part.layout == "csr":
        yield f"  synapses of a source = {summary(np.diff(part.row_ends))}"
        yield f"  targets = {summary(part.targets)}"
    if part.grid is not None:
        grid = part.grid
        yield f"  from {grid.channels} x {grid.height} x {grid.width} to {grid.maps} x {grid.rows} x {grid.columns}"
        border = f"{grid.top}" if grid.top == grid.left else f"{grid.top} x {grid.left}"
        kind = ", depthwise" if grid.depthwise else ""
        yield f"  kernel {grid.kernel_height} x {grid.kernel_width}, stride {grid.stride}, padding {border}{kind}"
    yield f"  weight = {summary(part.weight)}"
    yield f"  delay = {summary(part.delay)} steps"
    if part.receptor is not None:
        yield f"  receptor {part.receptor.index} {part.receptor.name}"
    if part.synapse.learns:
        values = part.synapse.parameters()
        numbers = (f"{word} {summary(np.asarray(values[word], dtype=np.float64))}" for word in part.synapse.numbers())
        yield f"  {part.synapse.name}: " + ", ".join(numbers)
    if part.signal >= 0:
        yield f"  dopamine from signal {part.signal}"
    if part.dopamine >= 0:
        rule = "one_to_one" if part.dopamine_one_to_one else "all_to_all"
        yield f"  dopamine from population {part.dopamine}, {rule}, delay {part.dopamine_delay} steps"


def _trials_lines(part: Trials) -> Iterator[str]:
    stop = "decision" if part.stop_at_decision else "end"
    yield f"trials: population {part.input} -> {part.output}, group {part.group}, {part.duration} ticks, to the {stop}"
    yield f"  maps {part.maps}, of each label {part.maps_per_label}"
    yield "  reward correct {:g}, wrong {:g}, silent {:g}".format(*part.reward)
    unit = "trial" if part.dropout_per_trial else "sample"
    yield f"  dropout {part.dropout:g} of each {unit},  decay {part.dropout_decay:g}"
    yield f"  reset {', '.join(part.reset) or 'nothing'}"


def _projection_bytes(part: Projection) -> int:
    return _bytes(part.row_ends, part.targets, part.weight, part.delay)


def _bytes(*arrays: NDArray[Any]) -> int:
    return sum(array.nbytes for array in arrays)


def _grouped(number: int) -> str:
    return f"{number:,}"
