"""The compiler from a `Network` to a `Program`: check, then resolve each part to flat arrays, steps and indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from neuro.coding.codes import CODES, RATE_CODES
from neuro.compiler.cameras import cameras_of
from neuro.compiler.check import check_conductance, check_network, check_values, receptor_of, receptor_of_current
from neuro.compiler.connect import Blocks
from neuro.compiler.connections import Connections
from neuro.compiler.divided import Divided, join_blocks
from neuro.compiler.inputs import check_trains, schedule_of, with_generators
from neuro.compiler.memory import SynapseBuffers, check_memory, many_synapses, packed, synapse_buffers
from neuro.compiler.pairs import MANY, Geometry, geometry_of
from neuro.compiler.probes import check_probes, resolve_probes, resolve_synapse_probes
from neuro.compiler.shapes import Shape, end_of, grid_of, own_places, resolve_shapes, size
from neuro.compiler.synapses import Drawing
from neuro.compiler.trials import resolve_trials
from neuro.compiler.undrawn import undrawn, wired
from neuro.compiler.values import LONGEST_DELAY, Steps, one_delay, per_neuron, too_long_delay
from neuro.core.checks import check
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.system import mapped, uncollected
from neuro.model.distributions import DISTRIBUTIONS, Distribution
from neuro.model.network import Network
from neuro.model.neurons import (
    MODELS,
    CurrentGenerator,
    Generator,
    Model,
    Neuron,
    event_camera,
    graded_spike_train,
    poisson_generator,
    spike_generator,
    spike_train,
)
from neuro.model.parts import Population, Projection, naming_the_part, refuse
from neuro.model.rules import BACKEND, RULES, NamedRule, from_file, grid
from neuro.model.sections import largest_in_world
from neuro.model.signals import SOURCES
from neuro.model.space import PROFILES
from neuro.model.synapses import SYNAPSES, DelayRule, Modulated, MoveRule, Synapse
from neuro.program import program as resolved
from neuro.program.compact import CompactProjection, SharedProjection
from neuro.program.program import WHOLE, Floats, Ints, Share, Stream

NO_INTS: Ints = np.zeros(0, dtype=np.int64)


@uncollected()
def compile_network(
    net: Network, seed: int, threads: int = 1, share: Share = WHOLE, backend_draws: bool = False
) -> resolved.Program:
    """Check and compile a network.

    Args:
        net: the network; it is not changed.
        seed: seed of all random numbers, in the network and during a run.
        threads: number of threads that draw connections; the draws do not depend on it.
        share: the synapses to draw, selected by target neurons. All other parts are complete in each share.
        backend_draws: whether the backend draws the synapses of rules with `draw: backend`.

    Raises:
        ModelError: no backend can run the network.
    """
    # The meaning of names is fixed from here on. A part registered later under a name of this network would make a
    # saved state belong to another network.
    for registry in (MODELS, SYNAPSES, RULES, DISTRIBUTIONS, PROFILES, SOURCES, CODES, RATE_CODES):
        registry.close("a network was compiled")
    clock = Clock(net.resolution)
    # Recordings come first: the sensor of a camera determines a shape, and grids follow from the shape.
    camera_parts = [part for part in net.populations.values() if isinstance(part.model, event_camera)]
    cameras = cameras_of(net, camera_parts, clock) if camera_parts else {}
    shapes = resolve_shapes(net, {name: camera.shape for name, camera in cameras.items()})
    check_network(net, shapes)
    # Before any allocation: a network that does not fit is refused in microseconds, not when memory is full.
    drawn_here = {name: part for name, part in net.projections.items() if not (backend_draws and _is_for_backend(part))}
    share.agree(lambda: check_memory(net, shapes, share.number, drawn_here))
    if net.probes:
        check_probes(net, shapes, clock)
    declared = {name: part.model.name for name, part in net.populations.items()}
    sources = {p.of: net.projections[p.of].source for p in net.probes.values() if p.at and p.of in net.projections}
    recorded = {sources.get(p.of, p.of) for p in net.probes.values() if p.of in sources or p.record == "spikes"}
    signals: tuple[resolved.Signal, ...] = ()
    if any(part.values is not None for part in net.signals.values()):
        from neuro.compiler.signals import populations_read, resolve_signals

        signals = resolve_signals(net, shapes, clock, seed)
        recorded |= populations_read(net, signals)
    # Codes become spikes here, so that no later step and no backend needs them; `declared` has the original names.
    net = with_generators(net, shapes, clock, seed)
    section = net.trials_section
    trials = None if section is None else resolve_trials(net, section, shapes, clock)
    resolver = _Resolver(net, shapes, clock, seed)
    populations = tuple(
        resolver.population(part, cameras.get(name), declared[name], name in recorded)
        for name, part in net.populations.items()
    )
    many = many_synapses(drawn_here.values(), shapes, MANY)
    # Synapses are drawn into one array where sizes are known. The first access to memory can take longer than the
    # draws, and a copy would need twice the memory.
    buffers = synapse_buffers(drawn_here, shapes) if many and share.number == 1 else None
    # Projections are drawn in parallel; with fewer projections than threads, also the blocks of a projection.
    threads_of_each = max(1, threads // max(1, len(net.projections)))

    def projection(part: Projection) -> resolved.Projection:
        own = None if buffers is None else buffers.get(part.name)
        with naming_the_part(part):
            return resolver.projection(part, many, own, share, threads_of_each, backend_draws and _is_for_backend(part))

    resolved_projections = mapped(projection, list(net.projections.values()), threads)
    if share.number == 1:
        projections = packed(resolved_projections, buffers, many)
    else:
        projections = _with_totals(share.agree(lambda: tuple(resolved_projections)), share)
    names = resolver.names
    program = resolved.Program(
        name=net.name,
        resolution=net.resolution,
        seed=seed,
        min_delay=min((d for p in projections for d in _delays(p, net.resolution)), default=1),
        populations=populations,
        projections=projections,
        signals=signals
        or tuple(
            resolved.Signal(s.name, names[s.to], s.origin, in_world=largest_in_world(net.world_section, s.name))
            for s in net.signals.values()
        ),
        groups=tuple(resolved.Group(g.name, names[g.choice.of], g.choice, g.origin) for g in net.groups.values()),
        probes=resolve_probes(net, shapes, clock) if net.probes else (),
        trials=trials,
        share=share,
    )
    if net.probes:
        program = replace(program, synapse_probes=resolve_synapse_probes(net, program, shapes, clock))
    check_trains(program)
    return program


def _is_for_backend(part: Projection) -> bool:
    """Return whether the description leaves the synapses to a backend with its own connection rules."""
    return isinstance(part.rule, NamedRule) and part.rule.draw == BACKEND


def _with_totals(projections: Sequence[resolved.Projection], share: Share) -> tuple[resolved.Projection, ...]:
    """Return the same projections, with the sizes and the spans of delays over all shares."""
    own_totals = np.array([(part.size, *part.delay_span) for part in projections], dtype=np.int64).reshape(-1, 3)
    all_totals = share.gather(own_totals[None])

    def whole(part: resolved.Projection, counts: Ints) -> resolved.Projection:
        if part.share.number == 1 or not counts[:, 0].any():
            return part
        non_empty = counts[counts[:, 0] > 0]
        return replace(
            part, size=int(non_empty[:, 0].sum()), span=(int(non_empty[:, 1].min()), int(non_empty[:, 2].max()))
        )

    return tuple(whole(part, all_totals[:, k]) for k, part in enumerate(projections))


def _delays(part: resolved.Projection, resolution: float) -> tuple[int, ...]:
    if not part.size:
        return ()
    shortest, _ = part.delay_range(resolution)
    return (shortest, part.dopamine_delay) if part.dopamine >= 0 else (shortest,)


class _Resolver:
    """Resolver of the populations and projections of a checked network.

    Args:
        net: the network, with generators in place of codes and cameras.
        shapes: shapes of its populations.
        clock: clock of the network.
        seed: seed of all random numbers.

    Attributes:
        names, signals: the index of each population and of each signal by its name.
        shared_values: values of populations without draws, by model and shape.
    """

    def __init__(self, net: Network, shapes: Mapping[str, Shape], clock: Clock, seed: int) -> None:
        self.net, self.shapes, self.clock, self.seed = net, shapes, clock, seed
        self.names = {name: index for index, name in enumerate(net.populations)}
        self.signals: dict[str | None, int] = {None: -1, **{name: index for index, name in enumerate(net.signals)}}
        self.shared_values: dict[tuple[int, Shape], dict[str, Any]] = {}

    def population(self, part: Population, stream: Stream | None, declared: str, is_read: bool) -> resolved.Population:
        """Resolve a population. Populations of one model and shape without draws share `shared_values`."""
        model, shape = part.model, self.shapes[part.name]
        # Resolving 200,000 small populations one by one takes seconds, but they have only a few models.
        values = None if part.initial else self.shared_values.get((id(model), shape))
        if values is None:
            with naming_the_part(part):
                values = self._values(part, shape)
            is_random = any(isinstance(value, Distribution) for value in model.parameters().values())
            if not part.initial and values["schedule"] is None and not is_random:
                self.shared_values[id(model), shape] = values
        is_read = is_read or not (isinstance(model, poisson_generator) or stream is not None)
        return resolved.Population(
            **values | {"parameters": {**values["parameters"]}, "initial": {**values["initial"]}},
            name=part.name,
            records=is_read and not isinstance(model, CurrentGenerator),
            origin=part.origin,
            stream=stream,
            declared="" if declared == model.name else declared,
        )

    def _values(self, part: Population, shape: Shape) -> dict[str, Any]:
        """Return the values of a population: parameters, initial states, schedules and listed spikes."""
        model, clock = part.model, self.clock
        parameters: dict[str, Floats] = {}
        start, stop = 0, NEVER
        timed = isinstance(model, Generator) and model.timed
        values = model.parameters()
        for word, quantity in model.quantities().items():
            if quantity.kind in ("number", "integer", "boolean") and not (timed and word in ("start", "stop")):
                key = (self.seed, "parameter", f"{part.name}.{word}")
                parameters[word] = per_neuron(values[word], shape, f"{model.name}.{word}", key)
        check_values(model, parameters, clock)
        if timed:
            start, stop = (clock.step(getattr(model, word), f"{model.name}.{word}") for word in ("start", "stop"))
        steps, ids, payloads = _listed_spikes(model, size(shape), clock)
        schedule = schedule_of(model, size(shape), clock)
        initial: dict[str, Floats] = {state.name: np.zeros(1) for state in model.states}
        if isinstance(model, (Neuron, Generator)):
            for name, value in model.initial(parameters).items():
                # + 0.0 turns -0.0 into 0.0, because backends use the sign bit for "nothing arrived".
                initial[name] = np.asarray(value, dtype=np.float64).reshape(-1) + 0.0
        for name, value in part.initial.items():
            if any(state.follows for state in model.states if state.name == name):
                raise ModelError(f"initial.{name} follows from the other states: set those", path=("initial", name))
            key = (self.seed, "initial", f"{part.name}.{name}")
            initial[name] = per_neuron(value, shape, f"initial.{name}", key)
        for state in model.states:
            if state.at_least is not None or state.at_most is not None:
                first = initial[state.name]
                check(state.quantity(), first if first.size > 1 else float(first[0]), f"initial.{state.name}")
        return {
            "model": model,
            "kind": model.role,
            "shape": shape,
            "size": size(shape),
            "parameters": parameters,
            "initial": initial,
            "spike_steps": steps,
            "spike_ids": ids,
            "spike_payloads": payloads,
            "start": start,
            "stop": stop,
            "schedule": schedule,
        }

    def projection(
        self,
        part: Projection,
        many: bool,
        buffers: SynapseBuffers | None,
        share: Share,
        threads: int,
        is_for_backend: bool,
    ) -> resolved.Projection:
        """Resolve a projection.

        Args:
            part: the projection.
            many: whether the network has many synapses.
            buffers: memory that may be used for the synapses of this projection.
            share: the share of the synapses to draw.
            threads: number of threads that draw.
            is_for_backend: whether the backend draws the synapses.

        Raises:
            ModelError: the synapses cannot be made.
        """
        clock = self.clock
        pre, post = self.net.populations[part.source], self.net.populations[part.target]
        current, carries = pre.model.role == "current", "current" if pre.model.role == "current" else "spikes"
        sizes = grid_of(part, self.shapes) if isinstance(part.rule, grid) else None
        if sizes is not None and not isinstance(part.delay, float):
            refuse(part, "delay: a shared kernel has one delay: expected a number", word="delay")
        source = end_of(part.source_view, self.shapes[part.source])
        target = end_of(part.target_view, self.shapes[part.target])
        ids = own_places(source, target) if part.source == part.target else None

        # Called only by rules and values that depend on distance; other projections need no positions.
        @cache
        def get_geometry() -> Geometry:
            return geometry_of(pre, post, self.shapes)

        # Currents use few synapses, and kernels have few weights, so each share has all of them.
        if is_for_backend or sizes is not None or current:
            share = WHOLE
        target_range = None if share.number == 1 else share.of(target.size)
        described = None
        if is_for_backend:
            described, synapses = undrawn(part, source.size, target.size, clock)
        else:
            geometry_of_views = cache(lambda: get_geometry().subset(source.ids, target.ids))
            blocks = Blocks(
                part.rule, source.shape, target.shape, ids, sizes, (self.seed, "connect", part.name), geometry_of_views
            )
            ends, ordered = (source, target), many and not part.synapse.learns
            read_file = partial(wired, part, part.rule, (pre, post), ends) if isinstance(part.rule, from_file) else None
            drawing = Divided if read_file is None and len(blocks.all) > 1 else Drawing
            synapses = drawing(
                part, blocks, read_file, ends, clock, self.seed, get_geometry, ordered, target_range, threads
            ).synapses(buffers)
        connections, delay, weight, rule = synapses.connections, synapses.delay, synapses.weight, synapses.rule
        # The weights of a shared kernel can learn, so the array has an entry for each weight from the start.
        if sizes is not None and weight.size == 1:
            weight = np.repeat(weight, connections.size)
        _check_weights(rule, weight, connections if share.number > 1 else None)
        _check_delays(rule, delay, clock)
        receptor = receptor_of_current(part.synapse, post, pre.name) if current else receptor_of(part.synapse, post)
        check_conductance(receptor, *synapses.weights)
        signal, gate, dopamine, one_to_one, dopamine_delay = -1, -1, -1, False, 1
        if isinstance(rule, MoveRule):
            signal, gate = self.signals[rule.signal], self.signals[rule.gate]
        if isinstance(rule, Modulated):
            signal = self.signals[rule.signal]
            dopamine = -1 if rule.dopamine is None else self.names[rule.dopamine]
            one_to_one = rule.dopamine_rule == "one_to_one"
            if rule.dopamine_delay is not None:
                dopamine_delay = int(one_delay(rule.dopamine_delay, clock, f"{rule.name}.dopamine_delay")[0])
        kind = resolved.Projection if share.number == 1 else SharedProjection
        projection = kind(
            name=part.name,
            source=self.names[part.source],
            target=self.names[part.target],
            carries=carries,
            layout=connections.layout,
            row_ends=connections.row_ends,
            targets=connections.targets,
            weight=weight,
            delay=delay,
            size=connections.size,
            grid=sizes,
            synapse=rule,
            receptor=receptor,
            signal=signal,
            dopamine=dopamine,
            dopamine_one_to_one=one_to_one,
            dopamine_delay=dopamine_delay,
            origin=part.origin,
            span=synapses.span,
            gate=gate,
            by_delay=synapses.by_delay,
            whole_layout=synapses.whole_layout,
            share=share,
            undrawn=described,
        )
        if not synapses.blocks:
            return projection
        return CompactProjection.of_blocks(projection, synapses.blocks, partial(join_blocks, weight.size == 0))


def _listed_spikes(model: Model, neurons: int, clock: Clock) -> tuple[Ints, Ints, Ints]:
    """Return the listed spikes of a generator by step, then neuron, and payloads for a graded generator."""
    if isinstance(model, spike_train | graded_spike_train):
        rows = np.asarray(model.spikes, dtype=np.float64).reshape(-1, 3 if model.graded else 2)
        times, ids, payloads = rows[:, 0], rows[:, 1], rows[:, 2:].ravel()
        bad = np.flatnonzero(ids >= neurons)
        if bad.size:
            raise ModelError(
                f"{model.name}.spikes[{bad[0]}] is of neuron {ids[bad[0]]:g}: "
                f"expected a neuron from 0 to {neurons - 1}",
                hint=f"shape: {int(ids.max()) + 1} includes all neurons",
                path=(model.name, "spikes"),
                about=("shape",),
            )
        steps, order = clock.steps(times, f"{model.name}.spikes"), np.lexsort((ids, times))
        return steps[order], ids[order].astype(np.int64), payloads[order if model.graded else ()].astype(np.int64)
    if not isinstance(model, spike_generator) or not model.spike_times:
        return NO_INTS, NO_INTS, NO_INTS
    trains = [clock.steps(t, f"spike_generator.spike_times[{i}]") for i, t in enumerate(model.spike_times)]
    sources = np.repeat(np.arange(len(trains), dtype=np.int64), [len(train) for train in trains])
    all_steps = np.concatenate(trains)
    # By step, then neuron: the order in which every backend emits, and so the order of all sums.
    order = np.lexsort((sources, all_steps))
    return all_steps[order], sources[order], NO_INTS


def _check_weights(rule: Synapse, weight: Floats, connections: Connections | None) -> None:
    """Refuse weights out of the bounds of a rule.

    For a share the message names the neurons of the synapse instead of its index.
    """
    bad = rule.outside(weight)
    if bad is not None:
        raised = f", or raise {rule.name}.Wmax" if "Wmax" in rule.parameters() else ""
        place = f"[{bad}]" if connections is None else " of synapse {} -> {}".format(*connections.ends(bad))
        value = weight[bad if weight.size > 1 else 0]
        hint = "give the distribution 'low' and 'high'" + raised
        message = f"weight{place} = {value:g}: expected {rule.expected_weight(bad)}"
        raise ModelError(message, hint=hint, path=("weight",), about=("Wmax", "low", "high"))


def _check_delays(rule: Synapse, delay: Steps, clock: Clock) -> None:
    """Refuse delays out of the bounds of a rule for delays, and delays above one step for learning by moves."""
    if isinstance(rule, MoveRule) and np.any(delay != 1):
        one_step = f"{clock.resolution:g} ms, one step, with {rule.name}"
        message = f"delay = {clock.ms(int(delay.max())):g} ms: expected {one_step}"
        raise ModelError(message, hint="delay the input with a parrot_neuron", path=("delay",))
    if not isinstance(rule, DelayRule):
        return
    _, most = rule.delay_range(clock.resolution)
    if most > LONGEST_DELAY:
        raise too_long_delay(f"{rule.name}.d_max", most, clock)
    delays_ms = clock.array_ms(delay.astype(np.int64))
    bad = np.flatnonzero((delays_ms < rule.d_min) | (delays_ms > rule.d_max))
    if bad.size:
        message = (
            f"delay[{bad[0]}] = {delays_ms[bad[0]]:g} ms: expected {rule.d_min:g} to {rule.d_max:g} ms, "
            f"the bounds of {rule.name}"
        )
        hint = f"set {rule.name}.d_min and d_max"
        raise ModelError(message, hint=hint, path=("delay",), about=("d_min", "d_max"))
