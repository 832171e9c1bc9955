"""Golden cases of lava's fixed-point processes as networks of Loihi 2, compared bit for bit.

A file holds many cases by name, arrays `CASE__NAME`, time first. Step k of a file, from 0, is step k + 1 of a
simulation; what a case gives as the input `a_in` of a neuron is emitted one step before, so all steps are one later.

| kind | known by | compared |
| --- | --- | --- |
| connections | array `a` | what arrives: `graded_vector` sends it |
| LIF, with reset, ternary | `du` | u, v and spikes |
| RF, RF_IZ | `sin_decay` | real, imag and spikes |
| SigmaDelta, Delta, Sigma | `act_mode`; `spike_exp`; the name | all states and messages |
| graded vectors, product | the name | messages |
| learning | `dw` | weights, tags, traces, and what arrives |
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
    """Whether a file has cases of lava's processes by name."""
    return bool(facts) and "cases" not in facts and all(isinstance(case, Mapping) for case in facts.values())


def compare_loihi2(golden: Golden, backend: str | Backend) -> Iterator[Result]:
    """Run every case of a file and compare all that it recorded."""
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
    expected, arrays = arrays["a"], _heard(case, arrays)
    net = Network("connections", resolution=1.0)
    if "padding" in case:
        pre, post, weight = _convolution(case, arrays)
        synapse: Synapse = loihi2_convolution()
        expected = expected.transpose(0, 3, 2, 1).reshape(len(expected), -1)
        x = arrays["x"].transpose(0, 3, 2, 1).reshape(len(arrays["x"]), -1)
        delay: Any = 1.0
    elif arrays["W"].ndim == 3:  # a convolution in time: the last of its kernels acts first
        late, post, pre = np.nonzero(arrays["W"][::-1])
        weight, x, delay = arrays["W"][::-1][late, post, pre], arrays["x"], late + 1.0
        synapse = loihi2_convolution(wraps=False)
    else:
        post, pre = np.nonzero(arrays["W"])
        weight, synapse, x = arrays["W"][post, pre], _synapse(case, arrays["W"]), arrays["x"]
        delay = arrays["D"][post, pre] + 1.0 if "D" in arrays else 1.0
    _add_input(net, x)
    net.population("out", expected.shape[1], graded_vector())
    net.connect("in", "out", pairs(pre=pre, post=post), synapse, weight=weight.astype(np.float64), delay=delay)
    found = _run(net, len(expected), (), backend)
    yield equal(name, "a", found["s"], expected)


def _convolution(case: Mapping[str, Any], arrays: Mapping[str, Array]) -> tuple[Array, Array, Array]:
    """Synapses of a convolution with arrays in lava's order: width, height, channels; kernels are flipped."""
    kernel = arrays["W"][:, ::-1, ::-1, :].transpose(0, 3, 2, 1).astype(np.float64)
    _, width, height, channels = arrays["x"].shape
    stride, padding, dilation = ((case[w][1], case[w][0]) for w in ("stride", "padding", "dilation"))
    return synapses_of((channels, height, width), kernel, stride, padding, dilation, int(case["groups"]))


def _neurons(
    name: str, case: Mapping[str, Any], arrays: Mapping[str, Array], backend: str | Backend
) -> Iterator[Result]:
    expected = {word: array for word, array in arrays.items() if word in STATES or word == "s"}
    size, steps = arrays["s"].shape[1], len(arrays["s"])
    net = Network("neurons", resolution=1.0)
    net.population("out", size, _model(name, case, arrays))
    late = "x" not in arrays
    for word, receptor in INPUTS.items():
        if word in arrays:
            _add_input(net, arrays[word], word)
            net.connect(word, "out", one_to_one(), static(receptor=receptor), weight=1.0, delay=1.0)
    if not late:
        _add_input(net, _heard(case["dense"], arrays)["x"])
        post, pre = np.nonzero(arrays["W"])
        weights = arrays["W"][post, pre].astype(np.float64)
        net.connect(
            "in", "out", pairs(pre=pre, post=post), _synapse(case["dense"], arrays["W"]), weight=weights, delay=1.0
        )
    known = [each.name for each in net.populations["out"].model.states]
    found = _run(net, steps + late, [word for word in expected if word in known], backend, late)
    for word, array in expected.items():
        if word in found:
            yield equal(name, word, found[word][late:], array)


INPUTS = {"a_in": None, "a_real_in": "real", "a_imag_in": "imag", "a_in1": "first", "a_in2": "second"}
"""Inputs of a neuron and their receptors."""


def _learning(
    name: str, case: Mapping[str, Any], arrays: Mapping[str, Array], backend: str | Backend
) -> Iterator[Result]:
    """Weights, tags and traces after each step, and what arrives.

    A teacher makes the targets fire as in the file: it takes away what should arrive, and adds what makes them fire.
    So u is what was not expected to arrive.
    """
    post, x, due = arrays["post"], arrays["x"], arrays["a"].astype(np.int64)
    n_post, n_pre = post.shape[1], x.shape[1]
    net = Network("learning", resolution=1.0)
    _add_input(net, x)
    _add_input(net, (post * FIRES - due)[1:], "teacher")
    net.population("out", n_post, loihi2_lif(du=4095, dv=4096, vth=FIRES // 2))
    net.connect("teacher", "out", one_to_one(), static(), weight=1.0, delay=1.0)
    words = {"epoch": case["t_epoch"], "graded": GRADED[case["graded"]]}
    words["sign_mode"] = case.get("sign_mode", "MIXED").lower()
    words |= {"x1_impulse": 0} if words["graded"] != "impulse" else {}  # as lava sets it
    words |= {word: case[word] for word in loihi2_learning.quantities() if word in case and word not in words}
    weight = arrays["W0"].T.astype(np.float64).ravel()
    net.connect("in", "out", all_to_all(), loihi2_learning(**words), weight=weight, delay=1.0, name="rule")
    net.probe("u", "out", "u")
    recorded = {"weights": "weight", "tag_1": "t"} | {word: word for word in (*PRE, *POST)}
    sim = neuro.run.compiled.compile(net, backend)
    found: dict[str, list[Array]] = {word: [] for word in recorded if word in arrays}
    for _ in range(len(x)):
        sim.run(1.0)
        for word, each in found.items():
            values = sim.get("rule", recorded[word]).reshape(n_pre, n_post).T
            each.append(values[0] if word in PRE else values[:, 0] if word in POST else values)
    for word, each in found.items():
        yield equal(name, word, np.array(each).astype(np.int64), arrays[word])
    yield equal(name, "a", np.rint(sim.trace("u")[1]).astype(np.int64) // 64 - post * FIRES + due, due)


FIRES = 1000
"""What makes a neuron fire that has a threshold of half of it and remembers nothing."""
GRADED = {
    "USE_REGULAR_IMPULSE": "impulse",
    "OVERWRITE": "overwrite",
    "ADD_WITH_SATURATION": "add_with_saturation",
    "ADD_WITHOUT_SATURATION": "add_without_saturation",
}
STATES = ("u", "v", "real", "imag", "sigma", "act", "residue", "error")


def _model(name: str, case: Mapping[str, Any], arrays: Mapping[str, Array]) -> Neuron:
    if "du" in case:
        model = loihi2_ternary_lif if "vth_hi" in case else loihi2_lif
        words: dict[str, Any] = {word: case[word] for word in model.quantities() if word in case}
        words |= {word: arrays[word].astype(np.float64) for word in model.quantities() if word in arrays}
        if "reset_offset" in words and "x" not in arrays:
            words["reset_offset"] += 1  # as all steps are one later
        return model(**words)
    if "sin_decay" in case:
        resonator = loihi2_rf_iz if "iz" in name else loihi2_rf
        bits = 12 - case.get("decay_bits", 12)
        words = {word: case[word] << bits for word in ("sin_decay", "cos_decay")}
        return resonator(**words, state_exp=case["state_exp"], vth=case["vth_eff"] / 2.0 ** case["state_exp"])
    if "spike_exp" in case:
        exponents = {word: case[word] for word in ("spike_exp", "state_exp")}
        unit = 2.0 ** sum(exponents.values())
        words = {**exponents, "vth": case["vth_eff"] / unit, "cum_error": case["cum_error"]}
        if "act_mode" not in case:
            return delta_encoder(**words)
        bias = np.asarray(case.get("bias_eff", 0), dtype=np.float64) / unit
        return sigma_delta(**words, bias=bias if bias.ndim else float(bias), relu=case["act_mode"] == "RELU")
    if name.startswith("graded"):
        return graded_vector(vth=case["vth"], relu="relu" in name)
    if name.startswith("prod"):
        return graded_product(vth=case["vth"], exp=case["exp"])
    if name.startswith("sigma"):
        return sigma_decoder()
    raise ModelError("not built: none of lava's processes that are built here has such a case")


def _synapse(case: Mapping[str, Any], weights: Array) -> Synapse:
    """Without a sign mode it is that of the weights."""
    words = {word: case[word] for word in ("weight_exp", "num_weight_bits") if word in case}
    found = "EXCITATORY" if weights.min() >= 0 else "INHIBITORY" if weights.max() <= 0 else "MIXED"
    return loihi2_static(**words, sign_mode=case.get("sign_mode", found).lower())


def _heard(case: Mapping[str, Any], arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Arrays with the input as a connection hears it: without bits for messages a spike is 1."""
    binary = case.get("num_message_bits") == 0
    return {**arrays, "x": (arrays["x"] != 0).astype(np.int64) if binary else arrays["x"]}


def _add_input(net: Network, values: Array, name: str = "in") -> None:
    """Values by step and neuron as payloads."""
    steps, ids = np.nonzero(values)
    rows = np.stack([steps + 1, ids, values[steps, ids]], axis=1).astype(np.float64)
    net.population(name, values.shape[1], graded_spike_train(spikes=rows))


def _run(net: Network, steps: int, states: Any, backend: str | Backend, late: bool = False) -> dict[str, Array]:
    """Registers by name, and payloads as "s", shape (steps, neurons); if `late` no bias acts in the first step."""
    for state in states:
        net.probe(state, "out", state)
    sim = neuro.run.compiled.compile(net, backend)
    biases = [word for word in ("bias", "bias_mant") if late and word in net.populations["out"].model.quantities()]
    if biases:
        none: dict[str, Any] = dict.fromkeys(biases, 0.0)
        kept: dict[str, Any] = {word: sim.get("out", word) for word in biases}
        sim.set("out", **none)
        sim.run(1.0)
        sim.set("out", **kept)
    sim.run(float(steps) - sim.time)
    found = {state: np.rint(sim.trace(state)[1]).astype(np.int64) for state in states}
    out = net.populations["out"]
    sent: Array = np.zeros((steps, int(net.populations["out"].shape[0])), dtype=np.int64)
    times, ids, payloads = sim.payloads("out") if out.model.graded else (*sim.spikes("out"), 1)
    sent[np.rint(times).astype(np.int64) - 1, ids] = payloads
    return found | {"s": sent}
