"""What is said of synapses by a word that is no parameter of their rule."""

import pytest

import neuro

CASES = [
    (neuro.stdp(), "delay", "stdp.delay of 'x' is fixed: change the network and compile again"),
    (
        neuro.stddp(),
        "delay",
        "stddp.delay of 'x' is a state of its synapses, which is read and not set\n"
        "  hint: sim.get('x', 'delay') reads it",
    ),
    (
        neuro.tsodyks2(),
        "u",
        "tsodyks2.u of 'x' is a state of its synapses, which is read and not set\n  hint: sim.get('x', 'u') reads it",
    ),
    (
        neuro.stdp(),
        "K_plus",
        "stdp.K_plus of 'x' is a state of its synapses, which is read and not set\n"
        "  hint: sim.get('x', 'K_plus') reads it",
    ),
    (
        neuro.tsodyks2(),
        "tau_req",
        "projection 'x': unknown parameter of tsodyks2 'tau_req'\n  hint: did you mean 'tau_rec'?",
    ),
]


@pytest.mark.parametrize(("rule", "word", "message"), CASES, ids=lambda part: getattr(part, "name", None))
def test_what_cannot_be_set_is_told_by_what_it_is(rule: neuro.stdp, word: str, message: str):
    net = neuro.Network("words")
    net.population("source", 1, neuro.spike_generator())
    net.population("cell", 1, neuro.iaf_psc_exp())
    net.connect("source", "cell", neuro.one_to_one(), rule, weight=1.0, delay=1.0, name="x")
    sim = neuro.compile(net, "reference")
    with pytest.raises(neuro.ModelError) as error:
        sim.set("x", **{word: 0.3})
    assert str(error.value) == message


LOW = neuro.uniform(low=-2.0, high=-2.0)
NONE_BELOW_0 = "expected a weight >= 0, as stdp_pl_hom takes no other"


@pytest.mark.parametrize(
    ("weight", "message"),
    [
        (-1.0, f"weight = -1: {NONE_BELOW_0}"),
        (LOW, f"weight[0] = -2: {NONE_BELOW_0}\n  hint: give the distribution 'low' and 'high'"),
    ],
)
def test_a_weight_below_0_that_a_rule_without_wmax_refuses(weight: object, message: str):
    net = neuro.Network("words")
    net.population("source", 1, neuro.spike_generator())
    net.population("cell", 1, neuro.iaf_psc_exp())
    net.connect("source", "cell", neuro.one_to_one(), neuro.stdp_pl_hom(), weight=weight, delay=1.0, name="x")
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net)
    assert str(error.value) == f"{error.value.where}: projection 'x': {message}"
