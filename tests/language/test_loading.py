"""What a description means: the documented examples, values, defaults, parameters and includes."""

import math

import numpy as np
import pytest

import neuro
from beside import beside, evaluated
from neuro.model.distributions import normal, uniform

FOLLOWER, GRIDS, NEURONS, WHOLE = beside(__file__, "FOLLOWER", "GRIDS", "NEURONS", "WHOLE")


@pytest.fixture
def load(folder):
    def load(text, params=None, **others):
        for name, other in others.items():
            (folder / f"{name}.yaml").write_text(other)
        (folder / "net.yaml").write_text(text)
        return neuro.load("net.yaml", params)

    return load


def test_the_same_network_in_yaml_and_python(load):
    net = neuro.Network("follower", resolution=1.0)
    cells = net.population("cells", (8, 8), neuro.poisson_generator())
    motors = net.population("motors", (2, 2), neuro.iaf_psc_exp(tau_m=10.0, t_ref=2.0))
    net.signal("reward", to=motors)
    synapse = neuro.stdp_dopa(Wmax=3000.0, signal="reward")
    net.connect(cells, motors, neuro.all_to_all(), synapse, weight=1500.0, delay=1.0)
    net.probe("steering", motors)
    assert load(FOLLOWER) == net


def test_the_same_trials_in_yaml_and_python(load):
    net = neuro.Network()
    c1 = net.population("c1", (4, 17, 17), neuro.spike_generator())
    neurons = neuro.iaf_psc_delta(tau_m=math.inf, E_L=0.0, V_reset=0.0, V_th=30.0)
    s2 = net.population("s2", (20, "auto", "auto"), neurons)
    net.connect(c1, s2, neuro.grid((11, 11)), neuro.r_stdp(), weight=normal(mean=0.8, std=0.05))
    net.group("choice", neuro.winner_take_all(of=s2))
    net.trials(
        input="c1",
        duration=64.0,
        labels=neuro.labels(of="s2", maps_per_label=2),
        reward=neuro.reward(),
        dropout=neuro.dropout(of="s2", decay=0.7),
    )
    assert load(GRIDS) == net


def test_parts_know_their_place(load):
    net = load(FOLLOWER)
    assert str(net.populations["motors"].origin) == "net.yaml:7:3"
    assert str(net.projections["cells_motors"].origin) == "net.yaml:9:3"
    assert str(load(GRIDS).trials_origin) == "net.yaml:11:1"


@pytest.mark.parametrize(("text", "value"), evaluated(__file__, "WEIGHTS", globals()))
def test_weights(load, text, value):
    head = "neuro: 1\npopulations: {a: {model: parrot_neuron, shape: 1}}\n"
    weight = (
        load(f"{head}projections: {{p: {{from: a, to: a, rule: one_to_one, weight: {text}}}}}").projections["p"].weight
    )
    assert np.array_equal(weight, value) if isinstance(value, list) else weight == value


def test_defaults(load):
    head = "neuro: 1\npopulations: {a: {model: parrot_neuron, shape: 1}}\n"
    net = load(head + "projections: {p: {from: a, to: a, rule: one_to_one}}\nprobes: {v: {of: a}}")
    assert (net.name, net.resolution) == ("network", 0.1)
    part = net.projections["p"]
    assert (part.weight, part.delay, part.synapse) == (1.0, 1.0, neuro.static())
    assert (net.probes["v"].record, net.probes["v"].every) == ("spikes", None)


def test_words_that_other_readers_take_for_booleans(load):
    net = load("neuro: 1\nname: on\npopulations: {no: {model: parrot_neuron, shape: 1}}\nprobes: {yes: {of: no}}")
    assert (net.name, list(net.populations), net.probes["yes"].of) == ("on", ["no"], "no")


def test_a_gate_is_a_signal(load):
    head = "neuro: 1\npopulations: {a: {model: {pp_psc_delta: {}}, shape: 1}}\nsignals: {s: {to: a}, g: {to: a}}\n"
    rule = "synapse: {reinforce: {signal: s, gate: %s}}"
    net = load(f"{head}projections: {{p: {{from: a, to: a, rule: one_to_one, {rule % 'g'}}}}}")
    assert net.projections["p"].synapse.gate == "g"
    with pytest.raises(neuro.ModelError, match="unknown signal 'h'"):
        load(f"{head}projections: {{p: {{from: a, to: a, rule: one_to_one, {rule % 'h'}}}}}")


def test_parameters_stand_anywhere(load):
    text = """\
neuro: 1
name: $name
parameters: {name: x, n: 3, also: $n, kind: parrot_neuron, w: [1.0, $n], spread: {uniform: {low: 0.0, high: $n}}}
populations: {a: {model: $kind, shape: [$also, $n]}}
projections:
  p: {from: a, to: a, rule: one_to_one, weight: $w, delay: $spread}
"""
    net = load(text)
    assert net.name == "x"
    assert net.populations["a"].shape == (3, 3)
    assert net.populations["a"].model == neuro.parrot_neuron()
    assert net.projections["p"].weight.tolist() == [1.0, 3.0]
    assert net.projections["p"].delay == uniform(high=3.0)


def test_overrides(load):
    def weight(value):
        return load(FOLLOWER, {"w_init": value}).projections["cells_motors"].weight

    for number in (2000.0, 2000, np.float64(2000.0), np.array(2000)):
        assert load(FOLLOWER, {"w_max": number}).projections["cells_motors"].synapse.Wmax == 2000.0
    for values in ([1.0, 2.0], (1.0, 2.0), np.array([1.0, 2.0])):
        assert weight(values).tolist() == [1.0, 2.0]
    for drawn in (uniform(high=2.0), {"uniform": {"high": 2.0}}):
        assert weight(drawn) == uniform(high=2.0)


def test_messages_about_overrides(message, messages):
    told = {"unknown": message(FOLLOWER, {"wmax": 1.0}), "kind": message(FOLLOWER, {"w_init": "high"})}
    messages(told | {"no effect": message(GRIDS, {"classes": 9})})


def test_includes(load):
    net = load(WHOLE, part=NEURONS)
    assert [(p.name, p.shape) for p in net.populations.values()] == [("b", (2,)), ("a", (2,))]
    assert str(net.populations["b"].origin) == "part.yaml:1:15"
    assert load(WHOLE, {"n": 5}).populations["b"].shape == (5,)


def test_includes_of_includes_are_relative_to_the_including_file(load, folder):
    (folder / "sub").mkdir()
    (folder / "sub" / "inner.yaml").write_text(NEURONS)
    (folder / "sub" / "part.yaml").write_text("include: [inner.yaml]\n")
    net = load(WHOLE.replace("part.yaml", "sub/part.yaml"))
    assert str(net.populations["b"].origin) == "sub/inner.yaml:1:15"


def test_an_included_file_may_be_a_network_of_its_own(load):
    assert load(WHOLE, part="neuro: 1\nname: other\n" + NEURONS).name == "network"


def test_mistakes_in_included_files(message, folder, messages):
    def of(part):
        (folder / "part.yaml").write_text(part)
        return message(WHOLE.replace("$n", "1"))

    messages.of(of)


def test_what_two_files_say(message, folder, messages):
    (folder / "part.yaml").write_text(NEURONS)
    twice = message(WHOLE.replace("[part.yaml]", "[part.yaml, ./part.yaml]"))
    (folder / "part.yaml").write_text("resolution: 1.0\n")
    messages({"a file": twice, "a setting": message(WHOLE + "resolution: 0.1\n")})
