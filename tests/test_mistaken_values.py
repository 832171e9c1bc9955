"""Every function that users call, with what no one should give it: one error in words, or what is said below."""

import math
import os

import numpy as np
import pytest

import neuro
from neuro import ModelError, events
from neuro.core.checks import argument

HUGE = 10**400
ODD = [
    "10",
    True,
    None,
    b"1",
    HUGE,
    math.nan,
    math.inf,
    -1,
    [1.0],
    np.array(["a"]),
    int,
    neuro.uniform,
    print,
    1j,
    {},
]
"""Values that are no time, name, weight, path or backend."""


@pytest.fixture(scope="module")
def net():
    net = neuro.Network("n", resolution=1.0)
    net.population("g", 2, neuro.spike_generator())
    net.population("a", 2, neuro.iaf_psc_delta())
    net.connect("g", "a", neuro.one_to_one(), name="w")
    return net


@pytest.fixture(scope="module")
def sim(net):
    return neuro.compile(net, backend="reference")


def told(call, *args, **words):
    """The message of the error of a call."""
    with pytest.raises(ModelError) as error:
        call(*args, **words)
    return str(error.value)


def test_times(sim):
    for given, shown in {"10": "'10'", True: "true", None: "None", b"1": "b'1'", HUGE: "1e400 or more"}.items():
        assert told(sim.run, given) == f"run = {shown}: expected a time in ms"
        assert told(sim.forget, given) == f"forget = {shown}: expected a time in ms"
        if given is not None:
            assert told(sim.spikes, "a", since=given) == f"since = {shown}: expected a time in ms"
    assert told(sim.run, math.nan) == "run = .nan: expected a time in ms"
    assert told(sim.forget, math.nan) == "forget = .nan: expected a time in ms"
    assert told(sim.run, [1.0]) == "run = [1]: expected a time in ms"
    assert sim.time == 0.0
    sim.forget(math.inf)
    sim.forget(-1)


def test_spikes_to_inject(sim):
    for given, shown in ((["1"], "['1']"), ([True], "[true]"), ([None], "[None]"), ([HUGE], "[1e400 or more]")):
        assert told(sim.inject, "g", given, [0]) == f"times: found {shown}: expected numbers"
    assert told(sim.inject, "g", [1.0], [True]) == "ids: found bool: expected whole numbers"


@pytest.mark.parametrize(
    ("more", "number", "bound"),
    [
        ({"at_least": 0}, 2**31, ">= 0 and <= 2147483647"),
        ({"at_least": 0}, np.uint64(2**63), ">= 0 and <= 2147483647"),
        ({"at_least": 0}, 2**70, ">= 0 and <= 2147483647"),
        ({"at_least": 0}, -(2**31), ">= 0"),
        ({}, 2**31, "<= 2147483647"),
        ({}, -(2**31), ">= -2147483647"),
        ({}, np.int64(-(2**63)), ">= -2147483647"),
        ({"at_least": 0, "at_most": 2**63 - 1}, 2**63, ">= 0 and <= 9223372036854775807"),
    ],
)
def test_a_whole_number_beyond_a_bound_names_the_bound(more, number, bound):
    assert told(argument, "n", number, kind="integer", **more) == f"n = {number}: expected a whole number {bound}"


def test_the_largest_whole_numbers_are_accepted():
    assert argument("n", 2**31 - 1, kind="integer", at_least=0) == 2**31 - 1
    assert argument("n", -(2**31) + 1, kind="integer") == -(2**31) + 1
    assert argument("n", 2**63 - 1, kind="integer", at_least=0, at_most=2**63 - 1) == 2**63 - 1


def test_neurons_and_payloads_beyond_a_bound_name_the_bound():
    message = told(neuro.pairs, [2**31], [0])
    assert message.endswith("pairs.pre[0] = 2147483648: expected whole numbers >= 0 and <= 2147483647")
    message = told(neuro.spike_train, spikes=[[1.0, 2**31]])
    assert "1 ms of neuron 2147483648, above 2147483647: expected" in message
    message = told(neuro.graded_spike_train, spikes=[[1.0, 0, -(2**31)]])
    assert "1 ms of neuron 0 with payload -2147483648, below -2147483647: expected" in message
    net = neuro.Network("n")
    net.population("payloads", 2, neuro.graded_spike_train())
    net.population("plain", 2, neuro.spike_generator())
    sim = neuro.compile(net)
    expected = "expected a whole number from -2147483647 to 2147483647"
    for payload, shown in ((-(2**31), "-2147483648"), (2**31, "2147483648"), (2**70, "1.1805916207174113e+21")):
        assert told(sim.inject, "payloads", [1.0], [0], [payload]) == f"payloads[0] = {shown}: {expected}"
    sim.inject("payloads", [1.0, 1.0], [0, 1], [2**31 - 1, -(2**31) + 1])
    for neuron in (2**31, 2**70):
        assert told(sim.inject, "plain", [1.0], [neuron]) == f"ids[0] = {neuron}: expected a neuron from 0 to 1"


def test_compile(net):
    for given, shown in ((None, "None"), (1, "1"), (neuro.iaf_psc_delta, "iaf_psc_delta"), ([], "[]")):
        expected = "expected the name of a backend, or a backend itself"
        assert told(neuro.compile, net, backend=given) == f"backend = {shown}: {expected}"
    most = max(64, os.cpu_count())
    for given, shown in ((20_000, "20000"), (0, "0"), (True, "true"), ("2", "'2'"), (HUGE, "1e400 or more")):
        message = told(neuro.compile, net, threads=given)
        assert message.partition("\n")[0] == f"threads = {shown}: expected a whole number >= 1 and <= {most}"
    assert told(neuro.compile, net, seed=2**63) == "seed = 9223372036854775808: expected a whole number >= 0 and < 2^63"
    assert told(neuro.compile, net, seed=True) == "seed = true: expected a whole number >= 0"


def test_paths(sim, net, tmp_path):
    for call in (neuro.load, sim.save, sim.restore, net.save):
        for given in (None, 3, b"a", True):
            assert told(call, given) == f"path = {given!r}: expected the name of a file"
        assert told(call, "a\0b") == "path = 'a\\x00b': expected the name of a file, without a zero byte"
    assert told(neuro.load, tmp_path) == f"{tmp_path}: found a folder: expected a YAML file"
    assert told(sim.restore, tmp_path) == f"{tmp_path}: is a folder: expected a state written by sim.save"
    os.mkfifo(tmp_path / "p")
    assert (
        told(sim.restore, tmp_path / "p")
        == f"{tmp_path / 'p'}: is neither file nor folder: expected a state written by sim.save"
    )


def test_parameters(net, tmp_path):
    net.save(tmp_path / "n.yaml")
    for given, shown in ((3, "3"), ([1], "[1]"), ("", "''")):
        message = told(neuro.load, tmp_path / "n.yaml", params=given)
        assert message == f"{tmp_path / 'n.yaml'}: params = {shown}: expected a mapping from names to values"
    where = told(neuro.iaf_psc_exp, tau_m=HUGE)
    assert where.endswith("iaf_psc_exp.tau_m = 1e400 or more: expected a number > 0 ms")
    assert told(neuro.iaf_psc_exp, tau_m=[HUGE]).endswith("tau_m[0] = 1e400 or more: expected a number > 0 ms")
    class_ = told(neuro.iaf_psc_exp, tau_m=neuro.uniform)
    assert class_.endswith("iaf_psc_exp.tau_m = uniform: expected a number > 0 ms\n  hint: write uniform(...)")
    assert "uniform: found 2 values without a name: expected uniform(name=value)" in told(neuro.uniform, 1, 2)


def test_weights():
    net = neuro.Network("n")
    a = net.population("a", 2, neuro.iaf_psc_delta())
    message = told(net.connect, a, a, neuro.one_to_one(), weight=neuro.uniform)
    assert message.endswith("weight = uniform: expected a number\n  hint: write uniform(...)")
    assert "expected a synapse such as neuro.static()" in told(net.connect, a, a, neuro.one_to_one(), {})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (10_000_000_000, "shape = 10000000000: expected at most 2147483647 elements"),
        ([3, 2**40], "shape = 1099511627776: expected at most 2147483647 elements"),
        ("0x10", "shape = '0x10': expected whole numbers >= 1 or auto\n  hint: write 16: numbers here are decimal"),
        (HUGE, "shape = 1e400 or more: expected whole numbers >= 1 or auto"),
    ],
)
def test_shapes(given, message):
    assert told(neuro.Network("n").population, "a", given, neuro.iaf_psc_delta()).endswith(f"population 'a': {message}")


def test_numbers_in_other_bases():
    for text, number in (("0x10", 16), ("0o17", 15), ("0B11", 3)):
        message = told(neuro.iaf_psc_exp, tau_m=text)
        assert message.endswith(f"\n  hint: write {number}: numbers here are decimal")


@pytest.mark.parametrize("value", ODD, ids=lambda value: type(value).__name__)
def test_no_name(sim, value):
    """What is the name of nothing is told like an unknown name, also where it cannot be looked up."""
    for call in (sim.set, sim.weights, sim.trace):
        assert told(call, value).startswith("unknown ")
    assert told(sim.get, value, "V_m").startswith("unknown population or projection '")
    assert told(sim.get, "a", value).startswith("population 'a': unknown parameter or state '")
    assert told(sim.get, "w", value).startswith("projection 'w': unknown state of synapses '")
    assert told(sim.signal, value, 1.0).startswith("unknown signal '")
    assert told(sim.inject, value, [1.0], [0]).startswith("unknown population '")
    assert told(sim.set_weights, value, 1.0).startswith("unknown projection '")


@pytest.mark.parametrize("value", [v for v in ODD if v is not True], ids=lambda value: type(value).__name__)
def test_no_flag(sim, value):
    for what, call in {"reset: weights": sim.reset, "raw": lambda raw: sim.get("a", "V_m", raw=raw)}.items():
        assert told(call, value).startswith(f"{what} ")


@pytest.mark.parametrize("value", [v for v in ODD if v not in (-1, math.inf)], ids=lambda value: type(value).__name__)
def test_no_number(sim, value):
    told(sim.set, "a", V_th=value)
    if value != [1.0]:
        told(sim.set_weights, "w", value)


def test_shapes_of_what_is_injected(sim):
    shape = "an array of shape [1, 1]: expected a list, one for each spike"
    assert told(sim.inject, "g", [[7.0]], [[0]]) == f"times: {shape}"
    assert told(sim.inject, "g", [7.0], [[0]]) == f"ids: {shape}"


def test_weights_that_would_be_drawn(sim):
    assert told(sim.set_weights, "w", neuro.uniform(low=0.5, high=2.0)) == (
        "weights of 'w' = uniform(low=0.5, high=2): expected a number or an array\n"
        "  hint: a distribution is drawn where connections are made: net.connect(..., weight=...)"
    )


@pytest.mark.parametrize(
    ("given", "shown"), [(np.zeros(2), "array of shape (2,)"), ([], "[]"), (0, "0"), ("", "''")], ids=repr
)
def test_initial_states(given, shown):
    message = told(neuro.Network("n").population, "a", 2, neuro.iaf_psc_exp(), initial=given)
    assert message.endswith(f"population 'a': found {shown}: expected states by name such as {{'V_m': -60.0}}")


def test_masked_arrays(sim):
    """What lies under a mask is no value."""
    half = np.ma.array([1.0, 2.0], mask=[False, True])
    masked = "is masked: expected values for all\n  hint: fill it: values.filled(...)"
    assert told(sim.set, "a", V_m=half) == f"a.V_m[1] {masked}"
    assert told(sim.set, "a", V_m=[np.ma.masked, 1.0]) == f"a.V_m[0] {masked}"
    assert told(sim.set_weights, "w", half) == f"weights of 'w'[1] {masked}"
    assert told(sim.inject, "g", half, [0, 1]) == f"times[1] {masked}"
    assert told(sim.inject, "g", [1.0, 2.0], half.astype(int)) == f"ids[1] {masked}"
    assert told(neuro.iaf_psc_exp, tau_m=half).endswith(f"iaf_psc_exp.tau_m[1] {masked}")
    assert told(events.Events, half.astype(int), [0, 0], [0, 0], [0, 1], (2, 2)) == f"t[1] {masked}"
    sim.set("a", V_m=np.ma.array([1.0, 2.0], mask=False))
    assert sim.get("a", "V_m").tolist() == [1.0, 2.0]


def test_a_masked_signal():
    net = neuro.Network("n")
    net.signal("reward", to=net.population("a", 2, neuro.iaf_psc_delta()))
    half = np.ma.array([1.0, 2.0], mask=[True, False])
    message = told(neuro.compile(net, backend="reference").signal, "reward", half)
    assert message.startswith("signal 'reward'[0] is masked: expected values for all")


def test_a_chip_that_is_not_quite_strict():
    net = neuro.Network("n", resolution=1.0)
    net.population("a", 2, neuro.iaf_psc_delta())
    message = told(neuro.compile, net, backend="loihi", strict="yes")
    assert message == "strict = 'yes': expected true or false\n  hint: write true"


def test_unsorted_events():
    assert told(events.Events, [3, 2], [0, 0], [0, 0], [0, 1], (2, 2)) == "event 1: time runs back from 3 to 2 us"
    assert told(events.Events, [0.5], [0], [0], [0], (2, 2)).startswith("t ")
