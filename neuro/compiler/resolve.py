"""From a `Network` to a `Program`: check, then resolve each part to flat arrays, steps and indices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.coding.codes import CODES, RATE_CODES
from neuro.compiler.cameras import cameras_of
from neuro.compiler.check import check_network, check_values, refuse, telling
from neuro.compiler.check_trials import resolve_trials
from neuro.compiler.connect import connect
from neuro.compiler.encoded import with_generators
from neuro.compiler.pack import packed
from neuro.compiler.receptors import check_conductance, receptor_of
from neuro.compiler.shapes import Shape, grid_of, resolve_shapes, size
from neuro.compiler.values import LONGEST_DELAY, delay_steps, one_delay, per_neuron, per_synapse, too_late
from neuro.core.checks import check
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.keyed_random import generator
from neuro.model.distributions import DISTRIBUTIONS
from neuro.model.network import Network
from neuro.model.neurons import MODELS, Neuron, dc_generator, poisson_generator, spike_generator
from neuro.model.parts import Population, Projection
from neuro.model.rules import RULES, grid
from neuro.model.synapses import SYNAPSES, DelayRule, Modulated
from neuro.program import program as resolved
from neuro.program.program import Floats, Ints
from neuro.program.streams import Stream


def compile_network(net: Network, seed: int) -> resolved.Program:
    """Check a network and resolve it.

    Args:
        net: the network; it is not changed.
        seed: of everything random, in the network and while it runs.

    Raises:
        ModelError: the network cannot be run by any backend.
    """
    for registry in (MODELS, SYNAPSES, RULES, DISTRIBUTIONS, CODES, RATE_CODES):
        registry.close("a network was compiled")
    clock = Clock(net.resolution)
    cameras = cameras_of(net, clock)
    shapes = resolve_shapes(net, {name: camera.shape for name, camera in cameras.items()})
    net = with_generators(net, shapes, clock, seed)
    check_network(net, shapes)
    trials = resolve_trials(net, shapes, clock)
    populations = tuple(
        _population(net, part, shapes[part.name], clock, seed, cameras.get(part.name))
        for part in net.populations.values()
    )
    projections = packed(tuple(_projection(net, part, shapes, clock, seed) for part in net.projections.values()))
    names = list(net.populations)
    return resolved.Program(
        name=net.name,
        resolution=net.resolution,
        seed=seed,
        min_delay=min((d for p in projections for d in _delays(p, net.resolution)), default=1),
        populations=populations,
        projections=projections,
        signals=tuple(resolved.Signal(s.name, names.index(s.to), s.origin) for s in net.signals.values()),
        groups=tuple(resolved.Group(g.name, names.index(g.choice.of), g.choice, g.origin) for g in net.groups.values()),
        probes=tuple(
            resolved.Probe(
                p.name, names.index(p.of), p.record, 1 if p.every is None else clock.step(p.every, "every"), p.origin
            )
            for p in net.probes.values()
        ),
        trials=trials,
    )


def _delays(part: resolved.Projection, resolution: float) -> tuple[int, ...]:
    if not part.size:
        return ()
    shortest, _ = part.delay_range(resolution)
    return (shortest, part.dopamine_delay) if part.dopamine >= 0 else (shortest,)


def _population(
    net: Network, part: Population, shape: Shape, clock: Clock, seed: int, stream: Stream | None
) -> resolved.Population:
    model = part.model
    parameters: dict[str, Floats] = {}
    start, stop = 0, NEVER
    fixed = ("start", "stop") if model.role in ("poisson", "current") else ()
    for word, quantity in model.quantities().items():
        if quantity.kind not in ("number", "integer", "boolean") or word in fixed:
            continue
        key = (seed, "parameter", f"{part.name}.{word}")
        with telling(part):
            parameters[word] = per_neuron(model.parameters()[word], shape, f"{model.name}.{word}", key)
    with telling(part):
        check_values(model, parameters, clock)
        if isinstance(model, (poisson_generator, dc_generator)):
            start, stop = clock.step(model.start, f"{model.name}.start"), clock.step(model.stop, f"{model.name}.stop")
        steps, ids = _listed_spikes(model, clock)
    return resolved.Population(
        name=part.name,
        model=model,
        kind=model.role,
        shape=shape,
        size=size(shape),
        parameters=parameters,
        initial=_initial(part, shape, parameters, seed),
        spike_steps=steps,
        spike_ids=ids,
        start=start,
        stop=stop,
        records=_records(net, part, stream),
        origin=part.origin,
        stream=stream,
    )


def _records(net: Network, part: Population, stream: Stream | None) -> bool:
    if isinstance(part.model, dc_generator):
        return False
    asked = any(p.of == part.name and p.record == "spikes" for p in net.probes.values())
    return asked or not (isinstance(part.model, poisson_generator) or stream is not None)


def _initial(part: Population, shape: Shape, parameters: Mapping[str, Floats], seed: int) -> dict[str, Floats]:
    start: dict[str, Floats] = {state.name: np.zeros(1) for state in part.model.states}
    if isinstance(part.model, Neuron):
        for name, value in part.model.initial(parameters).items():
            start[name] = np.asarray(value, dtype=np.float64).reshape(-1) + 0.0
    for name, value in part.initial.items():
        key = (seed, "initial", f"{part.name}.{name}")
        with telling(part):
            if any(state.follows for state in part.model.states if state.name == name):
                raise ModelError(f"initial.{name} follows from the other states: set those")
            start[name] = per_neuron(value, shape, f"initial.{name}", key)
    with telling(part):
        for state in part.model.states:
            if state.at_least is not None or state.at_most is not None:
                first = start[state.name]
                check(state.quantity(), first if first.size > 1 else float(first[0]), f"initial.{state.name}")
    return start


def _listed_spikes(model: object, clock: Clock) -> tuple[Ints, Ints]:
    none = np.zeros(0, dtype=np.int64)
    if not isinstance(model, spike_generator) or not model.spike_times:
        return none, none
    steps = [clock.steps(t, f"spike_generator.spike_times[{i}]") for i, t in enumerate(model.spike_times)]
    ids = np.repeat(np.arange(len(steps), dtype=np.int64), [len(s) for s in steps])
    together = np.concatenate(steps)
    order = np.lexsort((ids, together))
    return together[order], ids[order]


def _projection(
    net: Network, part: Projection, shapes: Mapping[str, Shape], clock: Clock, seed: int
) -> resolved.Projection:
    sizes = grid_of(part, shapes) if isinstance(part.rule, grid) else None
    if sizes is not None and not isinstance(part.delay, float):
        refuse(part, "delay: a shared kernel has one delay: expected a number")
    same = part.source == part.target
    with telling(part):
        found = connect(
            part.rule, shapes[part.source], shapes[part.target], same, sizes, generator(seed, "connect", part.name)
        )
        weight = per_synapse(part.weight, found, "weight", generator(seed, "weight", part.name))
        delay = delay_steps(part.delay, found, clock, "delay", generator(seed, "delay", part.name))
    if sizes is not None and weight.size == 1:
        weight = np.repeat(weight, found.size)
    check_stdp_weights(part, weight)
    _check_delays(part, delay, clock)
    carries = "current" if net.populations[part.source].model.role == "current" else "spikes"
    with telling(part):
        receptor = receptor_of(part.synapse, net.populations[part.target]) if carries == "spikes" else None
        check_conductance(receptor, weight)
    names = list(net.populations)
    rule = part.synapse
    signal, dopamine, one_to_one, later = -1, -1, False, 1
    if isinstance(rule, Modulated):
        signal = -1 if rule.signal is None else list(net.signals).index(rule.signal)
        dopamine = -1 if rule.dopamine is None else names.index(rule.dopamine)
        one_to_one = rule.dopamine_rule == "one_to_one"
        if rule.dopamine_delay is not None:
            with telling(part):
                later = int(one_delay(rule.dopamine_delay, clock, f"{rule.name}.dopamine_delay")[0])
    return resolved.Projection(
        name=part.name,
        source=names.index(part.source),
        target=names.index(part.target),
        carries=carries,
        layout=found.layout,
        row_ends=found.row_ends,
        targets=found.targets,
        weight=weight,
        delay=delay,
        size=found.size,
        grid=sizes,
        synapse=rule,
        receptor=receptor,
        signal=signal,
        dopamine=dopamine,
        dopamine_one_to_one=one_to_one,
        dopamine_delay=later,
        origin=part.origin,
    )


def check_stdp_weights(part: Projection, weight: Floats) -> None:
    """Weights that pairs change lie within their rule's bounds.

    Raises:
        ModelError: one does not; the first such is named.
    """
    if part.synapse.learns != "pairs":
        return
    low, high = part.synapse.bounds()
    bad = np.flatnonzero((weight < low) | (weight > high))
    if bad.size:
        raised = f", or raise {part.synapse.name}.Wmax" if "Wmax" in part.synapse.parameters() else ""
        raise ModelError(
            f"projection '{part.name}': weight[{bad[0]}] = {weight[bad[0]]:g}: "
            f"expected {part.synapse.expected_weight()}",
            where=part.origin,
            hint="give the distribution 'low' and 'high'" + raised,
        )


def _check_delays(part: Projection, delay: NDArray[np.int32], clock: Clock) -> None:
    """Delays that learn lie within their rule's bounds, and these are not too far."""
    rule = part.synapse
    if not isinstance(rule, DelayRule):
        return
    with telling(part):
        _, most = rule.delay_range(clock.resolution)
        if most > LONGEST_DELAY:
            raise too_late(f"{rule.name}.d_max", most, clock)
        late = clock.array_ms(delay.astype(np.int64))
        bad = np.flatnonzero((late < rule.d_min) | (late > rule.d_max))
        if bad.size:
            raise ModelError(
                f"delay[{bad[0]}] = {late[bad[0]]:g} ms: expected {rule.d_min:g} to {rule.d_max:g} ms, "
                f"the bounds of {rule.name}",
                hint=f"set {rule.name}.d_min and d_max",
            )
