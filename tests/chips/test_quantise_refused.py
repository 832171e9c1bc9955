"""What a chip lacks and every limit of it: what is just inside runs, what is just beyond is refused with a way out."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro.chips import chip, quantise
from neuro.core.errors import ModelError
from one_projection import delta, exp, one, refusals

CASES = yaml.safe_load((Path(__file__).with_name("refusals.yaml")).read_text())
OWN = {"exp": exp, "delta": delta}
HELD = ("scales", "exponents", "shifts")


def put(words, value):
    """Words with a value in place of X."""
    if isinstance(words, dict):
        return {name: put(each, value) for name, each in words.items()}
    return value if words == "X" else words


def made(name, words):
    return OWN.get(name, getattr(neuro, name, None))(**words)


def refused(on, options, **words):
    """What a chip refuses of the network that a case describes."""
    parts = {each: made(*words.pop(each).popitem()) for each in ("synapse", "generator") if each in words}
    model = next(name for name in words if name in OWN or hasattr(neuro, name))
    return refusals(one(made(model, words.pop(model)), **parts, **words), on, **options)


@pytest.mark.parametrize("case", CASES)
def test_what_is_refused(case):
    net = {**CASES[case]["net"]}
    on, *inside, beyond = net.pop("chip"), *net.pop("X", [None])
    for value, told in ((beyond, [CASES[case]["told"]]), *((each, []) for each in inside)):
        words = put(net, value)
        options = {name: words.pop(name) for name in HELD if name in words}
        found = refused(on, options, **words)
        assert [f"{what}: {why}" for what, why, _ in found] == told
        assert [way for _, _, way in found] == [CASES[case]["hint"]] * len(told)


@pytest.mark.parametrize("v_th", [0.0, -5.0])
def test_a_threshold_that_is_not_above_rest(v_th):
    program = one(delta(V_reset=-20.0, V_th=v_th), weight=0.0)
    (reset, _, _), threshold = refusals(program, "loihi")
    assert reset == "population 'out': V_reset = -20 mV"
    assert threshold == (
        f"population 'out': V_th = {v_th:g} mV",
        "the threshold register is unsigned, so V_th must be above E_L = 0 mV",
        "raise V_th or lower E_L, or run on spinnaker",
    )
    assert refusals(program, "spinnaker") == []


@pytest.mark.parametrize(
    ("model", "synapse", "low", "high", "why", "way"),
    [
        *(
            (neuro.loihi_lif(), neuro.loihi_static(sign_mode=mode), low, high, f"mantissa in sign mode {mode}", "raise")
            for mode, low, high in (("mixed", -256, 254), ("excitatory", 0, 255), ("inhibitory", -255, 0))
        ),
        (neuro.spinnaker_lif(), neuro.static(), -65535, 65535, "word", "change exc_shift or inh_shift"),
    ],
)
def test_weights_that_are_registers(model, synapse, low, high, why, way):
    def found(weight):
        return refusals(one(model, weight=float(weight), synapse=synapse), model.chip)

    assert found(low) == found(high) == []
    for beyond in (low - 1, high + 1, 0.5 * (low + high) + 0.25):
        ((what, said, hint),) = found(beyond)
        assert what == f"projection 'in_out': weight = {beyond:g}"
        assert said == f"a {why} is a whole number from {low} to {high}"
        assert hint.startswith(way)


def test_a_kernel_onto_neurons_that_differ():
    net = neuro.Network("grid", resolution=1.0)
    net.population("in", (1, 4, 4), neuro.spike_generator(spike_times=[[]] * 16))
    net.population("out", (2, 3, 3), exp(tau_m=np.linspace(5.0, 20.0, 18).reshape(2, 3, 3)))
    net.connect("in", "out", neuro.grid((2, 2)), weight=np.arange(8.0).reshape(2, 1, 2, 2), delay=1.0, name="k")
    way = "give the neurons the same time constants and C_m"
    text = ("projection 'k': a shared kernel onto neurons that differ", "a kernel has one scale", way)
    for name in ("loihi", "spinnaker"):
        assert refusals(neuro.compile(net, "reference").program, name) == [text]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_thresholds_that_adapted_elsewhere_are_taken():
    def net(model):
        net = neuro.Network("adapted", resolution=1.0)
        net.population("noise", 20, neuro.poisson_generator(rate=150.0))
        net.population("cells", 4, model)
        net.connect("noise", "cells", neuro.all_to_all(), weight=300.0, delay=1.0)
        return net

    shared = {"tau_syn_ex": 5.0, "tau_syn_in": 5.0}
    adapting = neuro.iaf_psc_exp_adaptive_threshold(**shared)
    ((what, _, way),) = refusals(neuro.compile(net(adapting)).program, "loihi")
    assert what == "population 'cells': iaf_psc_exp_adaptive_threshold"
    assert way == "adapt on event, then give iaf_psc_exp the V_th of each neuron that is V_th + theta there"
    sim = neuro.compile(net(adapting), seed=1)
    sim.run(200.0)
    raised = sim.get("cells", "V_th") + sim.get("cells", "theta")
    assert (raised > adapting.V_th).all()
    on_chip = neuro.compile(net(neuro.iaf_psc_exp(V_th=raised, **shared)), "loihi", seed=1)
    assert on_chip.get("cells", "V_th").tolist() == raised.tolist()


# options

SHIFTS = "the shifts of excitatory and inhibitory slots, two whole numbers up to 15"
OPTIONS = [
    ("loihi", {"scale": {}}, "backend 'loihi' has no option 'scale'\n  hint: did you mean 'scales'?"),
    (
        "loihi",
        {"shifts": {"out": (1, 1)}},
        "backend 'loihi' has no option 'shifts'\n"
        "  hint: known: exponents, neurons_per_core, order, scales, signals, strict",
    ),
    (
        "spinnaker",
        {"exponents": {"in_out": 1}},
        "backend 'spinnaker' has no option 'exponents'\n  hint: known: neurons_per_core, order, shifts, strict",
    ),
    ("loihi", {"scales": 3.0}, "scales = 3.0: expected values by name, such as {'exc': ...}"),
    ("loihi", {"scales": {"aut": 1.0}}, "scales: unknown part 'aut'\n  hint: did you mean 'out'?"),
    (
        "loihi",
        {"scales": {"in": 1.0}},
        "scales['in']: a spike_generator: expected populations of iaf_psc_exp or iaf_psc_delta",
    ),
    *(
        (name, {option: {part: value}}, f"{option}['{part}'] = {value!r}: expected {expected}")
        for name, option, part, expected, values in (
            ("loihi", "scales", "out", "units per mV, a number > 0", (0.0, np.nan, np.inf, "big")),
            ("loihi", "exponents", "in_out", "a weight exponent, a whole number from -8 to 7", (8, -9, 1.0)),
            ("loihi", "signals", "in_out", "the largest dopamine that the signal sets in 1/ms, a number > 0", (0.0,)),
            ("spinnaker", "shifts", "out", SHIFTS, ((0, 16), 3)),
        )
        for value in values
    ),
]


@pytest.mark.parametrize(("name", "options", "text"), OPTIONS)
def test_options(name, options, text):
    with pytest.raises(ModelError) as error:
        quantise(one(delta()), chip(name), **options)
    assert str(error.value) == text


def test_options_at_their_bounds():
    program = one(delta(), weight=0.001)
    for exponent in (-8, 7, np.int64(0)):
        assert quantise(program, chip("loihi"), exponents={"in_out": exponent}).projections[0].exponent == exponent
    for shifts in ((0, 15), [15, 0]):
        registers = quantise(program, chip("spinnaker"), shifts={"out": shifts}).populations[1].registers
        assert [registers["exc_shift"][0], registers["inh_shift"][0]] == list(shifts)


def test_a_chip_without_arithmetic():
    with pytest.raises(ModelError) as error:
        quantise(one(delta()), chip("truenorth"))
    assert str(error.value) == (
        "chip 'truenorth' has no arithmetic here: expected one of loihi, loihi2, spinnaker\n"
        "  hint: its limits and costs serve placing and energy only"
    )
