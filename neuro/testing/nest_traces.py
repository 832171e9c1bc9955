"""Golden cases of NEST: the network of a case is built and run, and the results are compared.

| kind | recognised by | compared |
| --- | --- | --- |
| neuron | `neuron` and `inputs` | spikes and every recorded state |
| network | `neuron` and the array `src` | spikes and V_m of the first neurons |
| stdp | `synapse` of model stdp_synapse | the weight sent at each pre spike, final weight and trace |
| pairs | `synapse` of another model of PAIRS | the weight sent at each pre spike, final weight |
| dopamine | `synapse` of model stdp_dopamine_synapse | as for stdp, and w, c, n, K+ over time |

Files of chips are recognised and compared by `neuro.testing.chip_traces`.

With `deliver_interval` > 1, NEST updates a synapse only at delivery points and records an old state between them. Rows
are therefore compared at the delivery points only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro.run.compiled
import neuro.run.simulation
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import MODELS, Neuron, dc_generator, iaf_psc_delta, spike_generator
from neuro.model.rules import all_to_all, one_to_one, pairs
from neuro.model.synapses import (
    Synapse,
    stdp,
    stdp_dopa,
    stdp_nn_pre_centered,
    stdp_nn_restr,
    stdp_nn_symm,
    stdp_pl_hom,
    stdp_triplet,
    vogels_sprekeler,
)
from neuro.program.backend import Backend, find_backend, unreadable
from neuro.program.program import Floats, Ints
from neuro.testing.chip_traces import chip_of, compare_chip
from neuro.testing.golden import LIMIT, Golden, Result, close

LIMITS = {"hh_psc_alpha": 1e-6, "aeif_cond_exp": 1e-3, "mat2_psc_exp": 1e-11}
"""Accepted deviations by model; 1e-9 for other models. With adaptive steps, rounding errors grow with each spike."""

NEST_V_M = -70.0
"""Initial V_m of NEST's integrate-and-fire neurons, mV."""
STRONG = 1e12
"""Threshold that only the driver's spikes reach, mV; their weight is twice as large."""

PAIRS: Mapping[str, type[Synapse]] = {
    "stdp_nn_symm_synapse": stdp_nn_symm,
    "stdp_nn_restr_synapse": stdp_nn_restr,
    "stdp_nn_pre_centered_synapse": stdp_nn_pre_centered,
    "stdp_pl_synapse_hom": stdp_pl_hom,
    "stdp_triplet_synapse": stdp_triplet,
    "vogels_sprekeler_synapse": vogels_sprekeler,
}
"""Synapse models for NEST's synapses that learn from pairs of spikes."""


def compare(golden: Golden, backend: str | Backend) -> list[Result]:
    """Run a case on a backend and compare every quantity.

    Raises:
        ModelError: the kind of the case is unknown, or its network cannot be built.
        KeyError, TypeError, ValueError, IndexError, AttributeError: a part of the case is missing or malformed.
    """
    facts = golden.facts
    if chip_of(facts):
        return list(compare_chip(golden, backend))
    if "synapse" in facts:
        model = facts["synapse"]["model"]
        if model == "stdp_synapse":
            return _compare_stdp(golden, backend)
        if model in PAIRS:
            return _compare_pairs(golden, backend)
        if model == "stdp_dopamine_synapse":
            return _compare_dopamine(golden, backend)
        expected = ["stdp_synapse", "stdp_dopamine_synapse", *PAIRS]
        raise ModelError(f"a synapse of model '{model}': expected {', '.join(expected)}")
    if "neuron" in facts and "src" in golden.arrays:
        return _compare_network(golden, backend)
    if "neuron" in facts and "inputs" in facts:
        return _compare_neuron(golden, backend)
    raise ModelError("found a case of unknown kind: expected 'neuron' with 'inputs' or 'src', or 'synapse'")


# neurons


def _compare_neuron(golden: Golden, backend: str | Backend) -> list[Result]:
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    net = Network("neuron", resolution=clock.resolution)
    _add_neurons(net, 1, facts["neuron"])
    for number, source in enumerate(facts["inputs"].values()):
        name = f"input_{number}"
        if "amplitude_pA" in source:
            times = {"start": float(source["start_ms"]), "stop": float(source["stop_ms"])}
            net.population(name, 1, dc_generator(amplitude=source["amplitude_pA"], **times))
        else:
            net.population(name, 1, spike_generator(spike_times=[_exact(source["spike_times_ms"], clock)]))
        net.connect(name, "neurons", one_to_one(), weight=source.get("weight", 1.0), delay=source["delay_ms"])
    hidden = unreadable(find_backend(backend) if isinstance(backend, str) else backend)
    recorded = [name for name in arrays if name not in ("times_ms", "spikes_ms", *hidden)]
    for name in recorded:
        net.probe(name, "neurons", name)
    sim = neuro.run.compiled.compile(net, backend)
    sim.run(facts["t_sim_ms"])
    rows = _steps(arrays["times_ms"], clock) - 1 if recorded else np.zeros(0, dtype=np.int64)
    ids = np.zeros_like(arrays["spikes_ms"], dtype=int)
    results = [_spikes(sim.spikes("neurons"), arrays["spikes_ms"], ids, clock)]
    limit = LIMITS.get(facts["neuron"]["model"], LIMIT)
    return results + [close(name, sim.trace(name)[1][rows, 0], arrays[name], limit) for name in recorded]


def _compare_network(golden: Golden, backend: str | Backend) -> list[Result]:
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    n = int(facts["neuron"]["n"])
    net = Network("network", resolution=clock.resolution)
    _add_neurons(net, n, facts["neuron"])
    steps = _steps(arrays["in_t_ms"], clock)
    times = [clock.array_ms(np.sort(steps[arrays["in_id"] == i])) for i in range(n)]
    net.population("input", n, spike_generator(spike_times=times))
    net.connect("input", "neurons", one_to_one(), weight=facts["in_weight_pA"], delay=facts["in_delay_ms"])
    net.connect(
        "neurons",
        "neurons",
        pairs(pre=arrays["src"], post=arrays["tgt"]),
        weight=arrays["weight_pA"],
        delay=_exact(arrays["delay_ms"], clock),
    )
    net.probe("V_m", "neurons", "V_m")
    sim = neuro.run.compiled.compile(net, backend)
    sim.run(facts["t_sim_ms"])
    rows, columns = arrays["V_sample"].shape
    return [
        _spikes(sim.spikes("neurons"), arrays["spike_t_ms"], arrays["spike_id"], clock),
        close("V_m", sim.trace("V_m")[1][:rows, :columns], arrays["V_sample"]),
    ]


def _add_neurons(net: Network, n: int, facts: Mapping[str, Any]) -> None:
    """Add neurons from NEST's parameters. Initial values come from `initial`, and from parameters that are states."""
    kind = MODELS.get(facts["model"])
    if kind is None or not issubclass(kind, Neuron):
        raise ModelError(f"unknown neuron model '{facts['model']}': expected a model of neuro with NEST's name")
    states = {state.name for state in kind.states if not state.follows}
    parameters = {word: value if isinstance(value, bool) else float(value) for word, value in facts["params"].items()}
    if not parameters.pop("consistent_integration", True):
        raise ModelError("consistent_integration: false: expected true")
    initial_values = {"V_m": parameters.get("E_L", NEST_V_M)} if "E_L" in kind.quantities() else {}
    initial_values |= {word: parameters.pop(word) for word in list(parameters) if word in states}
    initial = facts.get("initial", {"V_m": NEST_V_M} if "E_L" in kind.quantities() else {})
    if isinstance(initial, Mapping):
        initial_values |= {word: float(value) for word, value in initial.items() if word in states}
    model = kind.from_words(parameters)
    assert isinstance(model, Neuron)
    net.population("neurons", n, model, initial=initial_values)


# synapses


def _compare_stdp(golden: Golden, backend: str | Backend) -> list[Result]:
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    names = ("tau_plus", "alpha", "mu_plus", "mu_minus", "Wmax")
    rule = stdp(lambda_=facts["synapse"]["lambda"], **{word: facts["synapse"][word] for word in names})
    net = _synapse_network(golden, rule, 1)
    sim = neuro.run.compiled.compile(net, backend)
    pre = _steps(arrays["w_times_ms"], clock)
    weights = [sim.get("pre_post", "weight")[0] for _ in _walk(sim, pre + 1, clock)]
    end = clock.step(facts["t_sim_ms"], "t_sim_ms")
    for _ in _walk(sim, [max(end, int(pre[-1]) + 1)], clock):
        pass
    since_pre = sim.time - clock.ms(int(pre[-1]))
    k_plus = sim.get("pre_post", "K_plus")[0] * np.exp(since_pre / facts["synapse"]["tau_plus"])
    final_values = np.array([sim.get("pre_post", "weight")[0], k_plus])  # NEST shows K+ as of the last pre spike
    return [
        close("w_after", np.array(weights), arrays["w_after"]),
        close("final", final_values[: arrays["final"].size], arrays["final"]),
    ]


def _compare_pairs(golden: Golden, backend: str | Backend) -> list[Result]:
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    synapse_facts = {
        "pre_at_start": True,
        "tau_minus_triplet": facts["synapse"].get("tau_minus_triplet_ms"),
        **facts["synapse"],
    }
    kind = PAIRS[synapse_facts["model"]]
    rule = kind.from_words({word: synapse_facts[word] for word in kind.numbers()})
    sim = neuro.run.compiled.compile(_synapse_network(golden, rule, 1), backend)
    weights = []
    for _ in _walk(sim, _steps(arrays["w_times_ms"], clock) + 1, clock):
        weights.append(sim.get("pre_post", "weight")[0])
    actual = np.array(weights)
    return [close("w_after", actual, arrays["w_after"]), close("final", actual[-1:], arrays["final"])]


def _compare_dopamine(golden: Golden, backend: str | Backend) -> list[Result]:
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    names = ("A_plus", "A_minus", "tau_plus", "tau_c", "tau_n", "b", "Wmin", "Wmax")
    dopa = facts["dopa"]
    n_by_step = {clock.step(t, "set_n"): float(value) for t, value in facts.get("set_n", [])}
    source: dict[str, Any] = (
        {"signal": "n"} if n_by_step else {"dopamine": "dopa", "dopamine_delay": float(dopa["delay_ms"])}
    )
    parameters = {word: facts["synapse"][word] for word in names}
    rule = stdp_dopa(**parameters, deliver_interval=int(dopa["deliver_interval"]), **source)
    shortest = clock.step(dopa["min_delay_ms"], "min_delay_ms")
    net = _synapse_network(golden, rule, shortest)
    if n_by_step:
        net.signal("n", to="post")
    else:
        times = clock.array_ms(np.sort(_steps(arrays["dopa_ms"], clock)))
        net.population("dopa", 1, spike_generator(spike_times=[times]))
    sim = neuro.run.compiled.compile(net, backend)
    grid = shortest * int(dopa["deliver_interval"])
    rows = _steps(arrays["trace"][:, 0], clock)
    grid_rows = np.flatnonzero(rows % grid == 0)
    pre = _steps(arrays["w_times_ms"], clock)
    doses = _steps(arrays["dopa_ms"], clock) + clock.step(dopa["delay_ms"], "delay_ms") if n_by_step else pre[:0]
    read_values: dict[int, list[float]] = {}
    for step in _walk(
        sim, np.unique(np.concatenate((rows[grid_rows], pre, doses, list(n_by_step)))).astype(int), clock
    ):
        arrived = int(np.count_nonzero(doses == step))
        if arrived:
            sim.signal("n", sim.get("pre_post", "n") + arrived / facts["synapse"]["tau_n"])
        read_values[step] = [float(sim.get("pre_post", name)[0]) for name in ("weight", "c", "n", "K_plus")]
        if step in n_by_step:
            sim.signal("n", n_by_step[step])
    actual = np.array([read_values[int(step)] for step in rows[grid_rows]])
    results = [
        close(name, actual[:, column], arrays["trace"][grid_rows, column + 1])
        for column, name in enumerate(("w", "c", "n", "Kplus"))
    ]
    return [*results, close("w_after", np.array([read_values[int(step)][0] for step in pre]), arrays["w_after"])]


def _synapse_network(golden: Golden, rule: Synapse, shortest: int) -> Network:
    """Build a synapse between a neuron with listed spikes and a neuron that fires only after input from a driver.

    Args:
        golden: the case.
        rule: the synapse model.
        shortest: smallest delay of the network in steps; also the delay from the driver to the post neuron.
    """
    facts, arrays, clock = golden.facts, golden.arrays, golden.clock
    h = clock.resolution
    net = Network("synapse", resolution=h)
    net.population("pre", 1, spike_generator(spike_times=[_exact(arrays["pre_ms"], clock)]))
    times = clock.array_ms(_steps(arrays["post_ms"], clock) - shortest)
    net.population("driver", 1, spike_generator(spike_times=[times]))
    post_neuron = iaf_psc_delta(
        tau_m=h, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=STRONG, tau_minus=facts["synapse"]["tau_minus_ms"]
    )
    net.population("post", 1, post_neuron)
    net.connect("driver", "post", one_to_one(), weight=2.0 * STRONG, delay=clock.ms(shortest))
    weight, delay = float(facts["synapse"]["weight0"]), float(facts["synapse"]["delay_ms"])
    net.connect("pre", "post", all_to_all(), rule, weight=weight, delay=delay, name="pre_post")
    return net


def _walk(sim: neuro.run.simulation.Simulation, steps: Iterable[int], clock: Clock) -> Iterable[int]:
    """Run to each of the ascending steps, and yield the step after the simulation has reached it."""
    for step in steps:
        sim.run(clock.ms(int(step) - clock.step(sim.time, "time")))
        yield int(step)


# comparison


def _steps(times: NDArray[Any], clock: Clock) -> Ints:
    return clock.steps(np.asarray(times, dtype=np.float64), "times")


def _exact(times: Any, clock: Clock) -> Floats:
    """Round times to the nearest floats on the grid of steps."""
    return clock.array_ms(_steps(np.asarray(times), clock))


def _spikes(spikes: tuple[Floats, Ints], times: NDArray[Any], ids: NDArray[Any], clock: Clock) -> Result:
    """Compare spikes, (times, neurons), with the recorded times, ms, and neurons; their order does not matter."""
    actual = set(zip(_steps(spikes[0], clock).tolist(), spikes[1].tolist(), strict=True))
    expected = set(zip(_steps(times, clock).tolist(), np.asarray(ids).tolist(), strict=True))
    unequal = sorted(actual ^ expected)
    if not unequal:
        return Result("", "spikes", float(abs(len(spikes[0]) - len(times))), message="a spike is listed twice")
    step, neuron = unequal[0]
    problem = "is not expected" if unequal[0] in actual else "is missing"
    text = f"{len(unequal)} differ, first: neuron {neuron} at {clock.ms(step):g} ms {problem}"
    return Result("", "spikes", float(len(unequal)), message=text)
