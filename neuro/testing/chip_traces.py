"""Golden cases of chips: the registers of a network, compared bit for bit.

| kind | recognised by | compared |
| --- | --- | --- |
| loihi2 | cases by name | see `neuro.testing.loihi2_traces` |
| loihi, single neurons | `cases` with `du` | u, v and spikes of every case |
| loihi, feedforward | `params` with `du1`, arrays `w1`, `w2` | u, v and spikes of both layers, also without bias |
| spinnaker | `cases` with `registers` | v, g_exc, g_inh and spikes of every case |
| spinnaker, learning | `cases` with `rows` | weights and all other states after every call of the machine's programs |

Step k of a file, from 0, is step k + 1 of a simulation. If the emulators that recorded a case disagree, the case is
compared with the emulator whose rules this project follows. On Loihi each weight is shifted separately and its lowest
bits are dropped towards 0, as in Brian2Loihi and nengo-loihi, so arrays of nengo-loihi have precedence. `u_wrap` and
`v_clip_low` follow lava and nengo-loihi.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro.run.compiled
import neuro.run.simulation
from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import loihi_lif, spike_generator, spinnaker_lif
from neuro.model.rules import pairs
from neuro.model.synapses import Synapse, loihi_static
from neuro.program.backend import Backend, OverflowWarning, Replays, find_backend
from neuro.program.program import Floats
from neuro.testing.golden import Golden, Result, equal
from neuro.testing.loihi2_traces import compare_loihi2, is_of_loihi2

FOLLOWED = "nengo_loihi"
"""Emulator whose arrays are compared if the emulators disagree."""


def chip_of(facts: Mapping[str, Any]) -> str:
    """Return the name of the chip whose traces a file has, or ""."""
    cases = facts.get("cases")
    if is_of_loihi2(facts):
        return "loihi2"
    case = cases[0] if isinstance(cases, list) and cases and isinstance(cases[0], Mapping) else {}
    if "registers" in case or "rows" in case:
        return "spinnaker"
    params = facts.get("params")
    return "loihi" if "du" in case or (isinstance(params, Mapping) and "du1" in params) else ""


def compare_chip(golden: Golden, backend: str | Backend) -> Iterator[Result]:
    """Run each case of a chip's file and compare all recorded registers.

    Raises:
        ModelError: a network cannot be built.
        KeyError, TypeError, ValueError, IndexError, AttributeError: a part of the file is missing or malformed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", neuro.run.compiled.ApproximationWarning)
        warnings.simplefilter("ignore", OverflowWarning)
        if chip_of(golden.facts) == "loihi2":
            yield from compare_loihi2(golden, backend)
        elif "params" in golden.facts:
            for biased in (True, False):
                yield from _feedforward(golden, backend, biased)
        elif chip_of(golden.facts) == "spinnaker":
            for case in golden.facts["cases"]:
                yield from (_replayed if "rows" in case else _spinnaker)(case, golden.arrays, backend)
        else:
            for case in golden.facts["cases"]:
                yield from _single(case, golden.arrays, backend)


def _single(case: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], backend: str | Backend) -> Iterator[Result]:
    """Run a Loihi neuron with listed input spikes and compare its registers."""
    net = Network("single", resolution=1.0)
    weights = np.array(case["weights"], dtype=np.float64)
    _add_sources(net, case["spikes"], weights.size)
    parameters = ("du", "dv", "vth", "bias_mant", "bias_exp", "refractory")
    net.population("out", 1, loihi_lif(**{word: case[word] for word in parameters}))
    delays = np.array(case.get("delays", np.zeros(weights.size)), dtype=np.float64) + 1.0
    _connect(net, "in", "out", weights[None, :], _synapse(case), delays)
    sim = _run(net, int(case["T"]), {"out": ("u", "v")}, backend)
    for name in ("u", "v", "s"):
        yield equal(
            case["name"], name, _trace(sim, "out", name, int(case["T"]))[:, 0], _expected(arrays, case["name"], name)
        )


def _feedforward(golden: Golden, backend: str | Backend, biased: bool) -> Iterator[Result]:
    """Run two layers on Loihi, with or without bias, and compare the registers of both."""
    p, arrays = golden.facts["params"], golden.arrays
    steps = int(p["T"])
    net = Network("feedforward", resolution=1.0)
    _add_sources(net, arrays["in_spikes"].tolist(), int(p["ni"]))
    for layer, source in ((1, "in"), (2, "layer1")):
        bias = {"bias_mant": p[f"bias{layer}"], "bias_exp": p[f"bexp{layer}"]} if biased else {}
        cells = loihi_lif(du=p[f"du{layer}"], dv=p[f"dv{layer}"], vth=p[f"vth{layer}"], **bias)
        net.population(f"layer{layer}", int(p[f"n{layer}"]), cells)
        weights = arrays[f"w{layer}"].astype(np.float64)
        _connect(net, source, f"layer{layer}", weights, loihi_static(weight_exp=p[f"wexp{layer}"]), 1.0)
    sim = _run(net, steps, {"layer1": ("u", "v"), "layer2": ("u", "v")}, backend)
    prefix = "" if biased else "nobias_"
    for layer in (1, 2):
        for name in ("u", "v", "s"):
            actual = _trace(sim, f"layer{layer}", name, steps)
            yield equal(f"{prefix}layer{layer}", name, actual, arrays[f"{prefix}{name}{layer}"])


def _spinnaker(case: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], backend: str | Backend) -> Iterator[Result]:
    """Run the neurons of a SpiNNaker case with listed input spikes and compare their registers."""
    net = Network("spinnaker", resolution=1.0)
    synapses = np.array(case["syn_u16"], dtype=np.int64).reshape(-1, 5)
    spikes = case["spikes"]
    _add_sources(net, spikes, 1 + max([i for i, _ in spikes] + synapses[:, 0].tolist(), default=0))
    shifts = {"exc_shift": case["shift"][0], "inh_shift": case["shift"][1]}
    net.population("out", int(case["n"]), spinnaker_lif(**case["registers"], **shifts))
    if synapses.size:
        pre, post, receptor, word, delay = synapses.T
        weight = np.where(receptor == 1, -word, word).astype(np.float64)
        net.connect("in", "out", pairs(pre=pre, post=post), weight=weight, delay=delay.astype(np.float64))
    steps = int(case["T"])
    sim = _run(net, steps, {"out": ("v", "g_exc", "g_inh")}, backend)
    for name, column in (("v", "v_post"), ("g_exc", "g_exc"), ("g_inh", "g_inh"), ("s", "spikes")):
        yield equal(case["name"], name, _trace(sim, "out", name, steps), arrays[f"{case['name']}__{column}"])


def _replayed(case: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], backend: str | Backend) -> Iterator[Result]:
    """Replay the calls of SpiNNaker's programs and compare the states after each call; no network is run."""
    replayer = find_backend(backend) if isinstance(backend, str) else backend
    if not isinstance(replayer, Replays):
        raise ModelError(f"backend '{replayer.name}' replays no calls of programs", hint="use backend 'spinnaker'")
    states = replayer.replay(case, arrays[f"{case['name']}__events"])
    for name, values in states.items():
        if (key := f"{case['name']}__{name}") in arrays:
            yield equal(case["name"], name, values, arrays[key])


def _add_sources(net: Network, spikes: Any, n: int) -> None:
    """Add generators that emit the listed (neuron, step) spikes."""
    times: list[list[float]] = [[] for _ in range(n)]
    for neuron, step in spikes:
        times[int(neuron)].append(int(step) + 1.0)
    net.population("in", n, spike_generator(spike_times=[sorted(row) for row in times]))


def _synapse(case: Mapping[str, Any]) -> Synapse:
    return loihi_static(
        weight_exp=case["weight_exp"], num_weight_bits=case["num_weight_bits"], sign_mode=case["sign_mode"].lower()
    )


def _connect(net: Network, source: str, target: str, weights: Floats, synapse: Synapse, delay: Any) -> None:
    """Connect by a matrix of mantissas, (post, pre), in which 0 means no synapse."""
    post, pre = np.nonzero(weights)
    delays = delay[pre] if np.ndim(delay) else delay
    net.connect(source, target, pairs(pre=pre, post=post), synapse, weight=weights[post, pre], delay=delays)


def _run(
    net: Network, steps: int, states: Mapping[str, tuple[str, ...]], backend: str | Backend
) -> neuro.run.simulation.Simulation:
    for population, names in states.items():
        for name in names:
            net.probe(f"{population}.{name}", population, name)
    sim = neuro.run.compiled.compile(net, backend)
    sim.run(float(steps))
    return sim


def _trace(sim: neuro.run.simulation.Simulation, population: str, name: str, steps: int) -> NDArray[np.int64]:
    """Return a register, or the spikes as 0 and 1, shape (steps, neurons)."""
    if name != "s":
        register: NDArray[np.int64] = np.rint(sim.trace(f"{population}.{name}")[1]).astype(np.int64)
        return register
    times, ids = sim.spikes(population)
    size = next(p.size for p in sim.program.populations if p.name == population)
    fired = np.zeros((steps, size), dtype=np.int64)
    fired[np.rint(times).astype(np.int64) - 1, ids] = 1
    return fired


def _expected(arrays: Mapping[str, NDArray[Any]], case: str, name: str) -> NDArray[Any]:
    """Return the recorded array, or the array of the preferred emulator if the emulators disagree."""
    return arrays.get(f"{case}__{name}__{FOLLOWED}", arrays[f"{case}__{name}"])
