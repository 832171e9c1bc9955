"""Golden cases of lava's fixed-point processes as networks of Loihi 2, compared bit for bit.

A file has several cases by name. Its arrays are named `CASE__NAME`, with time as the first axis. Step k of a file, from
0, is step k + 1 of a simulation. In a file the first input `a_in` reaches a neuron in step 0. A simulation emits this
input in step 1, and the input arrives in step 2. So a simulation with `a_in` lags behind the file by a further step.

| kind of case | recognised by its array, parameter or name | compared |
| --- | --- | --- |
| connections | array `a`, without `dw` | sums of arriving messages, which `graded_vector` emits |
| LIF, with reset, ternary | `du` | u, v and spikes |
| RF, RF_IZ | `sin_decay` | real, imag and spikes |
| SigmaDelta, Delta, Sigma | `act_mode`; `spike_exp`; the name | all states and messages |
| graded vectors, product | the name | messages |
| learning | `dw` | weights, tags, traces, and sums of arriving messages |
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import neuro.run.compiled
from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import (
    Neuron,
    delta_encoder,
    graded_product,
    graded_spike_train,
    graded_vector,
    loihi2_lif,
    loihi2_rf,
    loihi2_rf_iz,
    loihi2_ternary_lif,
    sigma_decoder,
    sigma_delta,
)
from neuro.model.rules import all_to_all, one_to_one, pairs, synapses_of
from neuro.model.synapses import Synapse, loihi2_convolution, loihi2_learning, loihi2_static, static
from neuro.model.synapses.loihi_rule import POST, PRE
from neuro.program.backend import Backend
from neuro.testing.golden import Golden, Result, equal, failure

Array = NDArray[Any]


def is_of_loihi2(facts: Mapping[str, Any]) -> bool:
    """Return whether a file is a mapping from names to cases of lava's processes."""
    return bool(facts) and "cases" not in facts and all(isinstance(case, Mapping) for case in facts.values())


def compare_loihi2(golden: Golden, backend: str | Backend) -> Iterator[Result]:
    """Run each case of a file and compare all its recorded arrays."""
    for name, case in golden.facts.items():
        prefix = f"{name}__"
        arrays = {k.removeprefix(prefix): v for k, v in golden.arrays.items() if k.startswith(prefix)}
        compared = _learning if "dw" in case else _connections if "a" in arrays else _neurons
        try:
            yield from compared(name, case, arrays, backend)
        except ModelError as error:
            yield failure(str(error), name)


def _connections(
    name: str, case: Mapping[str, Any], arrays: Mapping[str, Array], backend: str | Backend
) -> Iterator[Result]:
    """Compare the sums of messages that arrive through a dense, sparse or convolution connection."""
    expected, arrays = arrays["a"], _with_messages(case, arrays)
    net = Network("connections", resolution=1.0)
    if "padding" in case:
        pre, post, weight = _convolution(case, arrays)
        synapse: Synapse = loihi2_convolution()
        expected = expected.transpose(0, 3, 2, 1).reshape(len(expected), -1)
        x = arrays["x"].transpose(0, 3, 2, 1).reshape(len(arrays["x"]), -1)
        delay: Any = 1.0
    elif arrays["W"].ndim == 3:  # a convolution in time: the last kernel acts first
        lag, post, pre = np.nonzero(arrays["W"][::-1])
        weight, x, delay = arrays["W"][::-1][lag, post, pre], arrays["x"], lag + 1.0
        synapse = loihi2_convolution(wraps=False)
    else:
        post, pre = np.nonzero(arrays["W"])
        weight, synapse, x = arrays["W"][post, pre], _synapse(case, arrays["W"]), arrays["x"]
        delay = arrays["D"][post, pre] + 1.0 if "D" in arrays else 1.0
    _add_input(net, x)
    net.population("out", expected.shape[1], graded_vector())
    net.connect("in", "out", pairs(pre=pre, post=post), synapse, weight=weight.astype(np.float64), delay=delay)
    recordings = _run(net, len(expected), (), backend)
    yield equal(name, "a", recordings["s"], expected)


def _convolution(case: Mapping[str, Any], arrays: Mapping[str, Array]) -> tuple[Array, Array, Array]:
    """Return the synapses of a convolution from arrays in lava's order (width, height, channels); flip the kernels."""
    kernel = arrays["W"][:, ::-1, ::-1, :].transpose(0, 3, 2, 1).astype(np.float64)
    _, width, height, channels = arrays["x"].shape
    stride, padding, dilation = ((case[w][1], case[w][0]) for w in ("stride", "padding", "dilation"))
    return synapses_of((channels, height, width), kernel, stride, padding, dilation, int(case["groups"]))


def _neurons(
    name: str, case: Mapping[str, Any], arrays: Mapping[str, Array], backend: str | Backend
) -> Iterator[Result]:
    """Compare the states and messages of neurons with recorded inputs."""
    expected = {word: array for word, array in arrays.items() if word in STATES or word == "s"}
    size, steps = arrays["s"].shape[1], len(arrays["s"])
    net = Network("neurons", resolution=1.0)
    net.population("out", size, _model(name, case, arrays))
    lag = "x" not in arrays
    for word, receptor in INPUTS.items():
        if word in arrays:
            _add_input(net, arrays[word], word)
            net.connect(word, "out", one_to_one(), static(receptor=receptor), weight=1.0, delay=1.0)
    if not lag:
        _add_input(net, _with_messages(case["dense"], arrays)["x"])
        post, pre = np.nonzero(arrays["W"])
        weights = arrays["W"][post, pre].astype(np.float64)
        net.connect(
            "in", "out", pairs(pre=pre, post=post), _synapse(case["dense"], arrays["W"]), weight=weights, delay=1.0
        )
    states = [state.name for state in net.populations["out"].model.states]
    recordings = _run(net, steps + lag, [word for word in expected if word in states], backend, lag)
    for word, array in expected.items():
        if word in recordings:
            yield equal(name, word, recordings[word][lag:], array)


INPUTS = {"a_in": None, "a_real_in": "real", "a_imag_in": "imag", "a_in1": "first", "a_in2": "second"}
"""Inputs of a neuron and their receptors."""


def _learning(
    name: str, case: Mapping[str, Any], arrays: Mapping[str, Array], backend: str | Backend
) -> Iterator[Result]:
    """Compare weights, tags and traces after each step, and the sums of arriving messages.

    A teacher makes the targets fire as in the file: its messages cancel the expected input and add a strong input for
    each expected spike. So the state u of a target is the received input minus the expected input, plus
    the strong input at an expected spike.
    """
    post, x, expected_input = arrays["post"], arrays["x"], arrays["a"].astype(np.int64)
    n_post, n_pre = post.shape[1], x.shape[1]
    net = Network("learning", resolution=1.0)
    _add_input(net, x)
    _add_input(net, (post * FIRES - expected_input)[1:], "teacher")
    net.population("out", n_post, loihi2_lif(du=4095, dv=4096, vth=FIRES // 2))
    net.connect("teacher", "out", one_to_one(), static(), weight=1.0, delay=1.0)
    parameters = {"epoch": case["t_epoch"], "graded": GRADED[case["graded"]]}
    parameters["sign_mode"] = case.get("sign_mode", "MIXED").lower()
    parameters |= {"x1_impulse": 0} if parameters["graded"] != "impulse" else {}  # as lava sets it
    parameters |= {word: case[word] for word in loihi2_learning.quantities() if word in case and word not in parameters}
    weight = arrays["W0"].T.astype(np.float64).ravel()
    net.connect("in", "out", all_to_all(), loihi2_learning(**parameters), weight=weight, delay=1.0, name="rule")
    net.probe("u", "out", "u")
    recorded = {"weights": "weight", "tag_1": "t"} | {word: word for word in (*PRE, *POST)}
    sim = neuro.run.compiled.compile(net, backend)
    series: dict[str, list[Array]] = {word: [] for word in recorded if word in arrays}
    for _ in range(len(x)):
        sim.run(1.0)
        for word, rows in series.items():
            values = sim.get("rule", recorded[word]).reshape(n_pre, n_post).T
            rows.append(values[0] if word in PRE else values[:, 0] if word in POST else values)
    for word, rows in series.items():
        yield equal(name, word, np.array(rows).astype(np.int64), arrays[word])
    arrived = np.rint(sim.trace("u")[1]).astype(np.int64) // 64 - post * FIRES + expected_input
    yield equal(name, "a", arrived, expected_input)


FIRES = 1000
"""Input that makes the target neurons of `_learning` fire; their threshold is half of this value."""
GRADED = {
    "USE_REGULAR_IMPULSE": "impulse",
    "OVERWRITE": "overwrite",
    "ADD_WITH_SATURATION": "add_with_saturation",
    "ADD_WITHOUT_SATURATION": "add_without_saturation",
}
"""Values of `graded` of loihi2_learning by lava's names."""
STATES = ("u", "v", "real", "imag", "sigma", "act", "residue", "error")
"""Arrays of a case that are states of its neurons."""


def _model(name: str, case: Mapping[str, Any], arrays: Mapping[str, Array]) -> Neuron:
    """Return the neuron model of a case, with the parameters of the case."""
    if "du" in case:
        model = loihi2_ternary_lif if "vth_hi" in case else loihi2_lif
        parameters: dict[str, Any] = {word: case[word] for word in model.quantities() if word in case}
        parameters |= {word: arrays[word].astype(np.float64) for word in model.quantities() if word in arrays}
        if "reset_offset" in parameters and "x" not in arrays:
            parameters["reset_offset"] += 1  # the simulation is delayed by a step
        return model(**parameters)
    if "sin_decay" in case:
        resonator = loihi2_rf_iz if "iz" in name else loihi2_rf
        bits = 12 - case.get("decay_bits", 12)
        parameters = {word: case[word] << bits for word in ("sin_decay", "cos_decay")}
        return resonator(**parameters, state_exp=case["state_exp"], vth=case["vth_eff"] / 2.0 ** case["state_exp"])
    if "spike_exp" in case:
        exponents = {word: case[word] for word in ("spike_exp", "state_exp")}
        unit = 2.0 ** sum(exponents.values())
        parameters = {**exponents, "vth": case["vth_eff"] / unit, "cum_error": case["cum_error"]}
        if "act_mode" not in case:
            return delta_encoder(**parameters)
        bias = np.asarray(case.get("bias_eff", 0), dtype=np.float64) / unit
        return sigma_delta(**parameters, bias=bias if bias.ndim else float(bias), relu=case["act_mode"] == "RELU")
    if name.startswith("graded"):
        return graded_vector(vth=case["vth"], relu="relu" in name)
    if name.startswith("prod"):
        return graded_product(vth=case["vth"], exp=case["exp"])
    if name.startswith("sigma"):
        return sigma_decoder()
    raise ModelError("unknown case: expected a case of one of lava's processes that neuro has")


def _synapse(case: Mapping[str, Any], weights: Array) -> Synapse:
    """Return the synapse model of a case; a missing sign mode follows from the signs of the weights."""
    parameters = {word: case[word] for word in ("weight_exp", "num_weight_bits") if word in case}
    sign_mode = "EXCITATORY" if weights.min() >= 0 else "INHIBITORY" if weights.max() <= 0 else "MIXED"
    return loihi2_static(**parameters, sign_mode=case.get("sign_mode", sign_mode).lower())


def _with_messages(case: Mapping[str, Any], arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return the arrays, with `x` as the messages that a connection receives. A message without payload bits is 1."""
    binary = case.get("num_message_bits") == 0
    return {**arrays, "x": (arrays["x"] != 0).astype(np.int64) if binary else arrays["x"]}


def _add_input(net: Network, values: Array, name: str = "in") -> None:
    """Add a generator that emits the values, shape (steps, neurons), as payloads; 0 is no spike."""
    steps, ids = np.nonzero(values)
    rows = np.stack([steps + 1, ids, values[steps, ids]], axis=1).astype(np.float64)
    net.population(name, values.shape[1], graded_spike_train(spikes=rows))


def _run(net: Network, steps: int, states: Any, backend: str | Backend, lag: bool = False) -> dict[str, Array]:
    """Run a network and return the states by name, and the payloads as "s", all of shape (steps, neurons).

    With `lag` the simulation is one step behind the file, so the bias is 0 in the first step.
    """
    for state in states:
        net.probe(state, "out", state)
    sim = neuro.run.compiled.compile(net, backend)
    biases = [word for word in ("bias", "bias_mant") if lag and word in net.populations["out"].model.quantities()]
    if biases:
        zeros: dict[str, Any] = dict.fromkeys(biases, 0.0)
        values: dict[str, Any] = {word: sim.get("out", word) for word in biases}
        sim.set("out", **zeros)
        sim.run(1.0)
        sim.set("out", **values)
    sim.run(float(steps) - sim.time)
    recordings = {state: np.rint(sim.trace(state)[1]).astype(np.int64) for state in states}
    out = net.populations["out"]
    messages: Array = np.zeros((steps, int(net.populations["out"].shape[0])), dtype=np.int64)
    times, ids, payloads = sim.payloads("out") if out.model.graded else (*sim.spikes("out"), 1)
    messages[np.rint(times).astype(np.int64) - 1, ids] = payloads
    return recordings | {"s": messages}
