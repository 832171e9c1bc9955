"""`draw: backend` on NEST: its own rules draw the same distributions, and what needs the synapses says so."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

import neuro
from neuro.core.errors import ModelError
from neuro.files.results import read, write
from neuro.model.distributions import Distribution
from neuro.model.rules import BACKEND, HERE, Rule
from neuro.run.collect import collect

pytestmark = [
    pytest.mark.usefixtures("nest"),
    pytest.mark.filterwarnings("ignore::neuro.run.compiled.ApproximationWarning"),
]

WEIGHT = neuro.normal(mean=30.0, std=20.0, low=0.0, high=60.0)
DELAY = neuro.normal(mean=0.5, std=0.6)
SIZES = 120, 90
INDEGREE = neuro.fixed_indegree(n=3, draw=BACKEND)


def one(rule: Rule, weight: float | Distribution = WEIGHT, delay: float | Distribution = DELAY) -> neuro.Network:
    net = neuro.Network("one")
    for name, size in zip(("pre", "post"), SIZES, strict=True):
        net.population(name, size, neuro.iaf_psc_exp())
    net.connect("pre", "post", rule, weight=weight, delay=delay, name="wires")
    return net


def drawn(net: neuro.Network) -> dict[str, np.ndarray]:
    """Ends, weights and delays in steps of what NEST drew."""
    import nest

    sim = neuro.compile(net, "nest", seed=2)
    cells = sim._engine.net.cells  # type: ignore[attr-defined]
    first = [each.nodes_of.first for each in cells]
    found = nest.GetConnections(cells[0].nodes, cells[1].nodes).get(["source", "target", "weight", "delay"])
    pre, post = (np.array(found[word]) - first[k] for k, word in enumerate(("source", "target")))
    return {"pre": pre, "post": post, "weight": np.array(found["weight"]), "delay": steps(found["delay"])}


def drawn_here(net: neuro.Network) -> dict[str, np.ndarray]:
    sim = neuro.compile(net, "event", seed=2)
    return dict(zip(("pre", "post", "weight"), sim.weights("wires"), strict=True)) | {
        "delay": steps(sim.get("wires", "delay"))
    }


def steps(ms: object) -> np.ndarray:
    return np.rint(np.asarray(ms) / 0.1).astype(int)


def agree(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    for k, word in enumerate(("pre", "post")):
        fans = (np.bincount(each[word], minlength=SIZES[k]) for each in (one, other))
        assert ks_2samp(*fans).pvalue > 0.01, word
    for word in ("weight", "delay"):
        assert ks_2samp(one[word], other[word]).pvalue > 0.01, word


@pytest.mark.parametrize(
    "rule",
    [
        neuro.fixed_total_number(n=4000, draw=BACKEND),
        neuro.fixed_indegree(n=40, draw=BACKEND),
        neuro.fixed_indegree(n=40, multapses=False, draw=BACKEND),
        neuro.fixed_outdegree(n=30, draw=BACKEND),
        neuro.pairwise_bernoulli(p=0.3, draw=BACKEND),
        neuro.all_to_all(draw=BACKEND),
    ],
)
def test_degrees_weights_and_delays(rule: Rule):
    found, expected = drawn(one(rule)), drawn_here(one(rule))
    agree(found, expected)
    assert found["delay"].min() == 1, "what rounds to no step is one step"
    assert np.mean(found["delay"] == 1) == pytest.approx(np.mean(expected["delay"] == 1), abs=0.02)
    assert 0.0 <= found["weight"].min() < found["weight"].max() <= 60.0
    if not isinstance(rule, neuro.pairwise_bernoulli):
        assert found["pre"].size == expected["pre"].size
    if getattr(rule, "multapses", True) is False:
        assert np.unique(found["pre"] * SIZES[1] + found["post"]).size == found["pre"].size


@pytest.mark.parametrize(
    ("weight", "delay"),
    [
        (-7.5, 1.2),
        (neuro.uniform(low=-3.0, high=-1.0, single=True), neuro.uniform(low=0.3, high=2.0)),
        (neuro.lognormal(mean=1.0, std=0.5), neuro.lognormal(mean=0.0, std=0.4, high=3.0)),
        (neuro.normal(mean=2.0, std=0.0), neuro.normal(mean=1.5, std=0.75, low=0.05)),
        (neuro.lognormal(mean=0.0, std=0.0), neuro.uniform(low=0.4, high=0.4)),
    ],
)
def test_numbers_and_distributions(weight: float | Distribution, delay: float | Distribution):
    net = one(neuro.fixed_total_number(n=5000, draw=BACKEND), weight, delay)
    agree(drawn(net), drawn_here(net))


def test_pairs_of_two_neurons_and_of_a_neuron_with_itself():
    net = neuro.Network("same")
    net.population("pre", 60, neuro.iaf_psc_exp())
    net.population("post", 60, neuro.iaf_psc_exp())
    net.connect("pre", "pre", neuro.all_to_all(autapses=False, draw=BACKEND))
    net.connect("pre", "post", neuro.one_to_one(draw=BACKEND))
    net.connect("post", "pre", neuro.fixed_indegree(n=59, multapses=False, draw=BACKEND))
    net.connect("post", "post", neuro.fixed_outdegree(n=59, autapses=False, multapses=False, draw=BACKEND))
    import nest

    sim = neuro.compile(net, "nest", threads=2)  # which deals the neurons out to nodes in another order
    first = [cells.nodes_of for cells in sim._engine.net.cells]  # type: ignore[attr-defined]

    def ends(source: int, target: int) -> set[tuple[int, int]]:
        cells = sim._engine.net.cells  # type: ignore[attr-defined]
        found = nest.GetConnections(cells[source].nodes, cells[target].nodes).get(["source", "target"])
        pre, post = (
            first[k].neurons(np.array(found[word])).tolist() for k, word in ((source, "source"), (target, "target"))
        )
        return {*zip(pre, post, strict=True)}

    others = {(i, j) for i in range(60) for j in range(60) if i != j}
    assert ends(0, 0) == ends(1, 1) == others
    assert ends(0, 1) == {(i, i) for i in range(60)}
    assert len(ends(1, 0)) == 59 * 60


def brunel(draw: str) -> neuro.Network:
    """Excitation and inhibition under noise, each rule once, and a population that devices drive."""
    net = neuro.Network("brunel")
    for name, size in (("exc", 400), ("inh", 100)):
        net.population(name, size, neuro.iaf_psc_exp(I_e=300.0), initial={"V_m": neuro.normal(mean=-60.0, std=4.0)})
        net.population(f"{name}_in", size, neuro.poisson_generator(rate=4000.0))
        net.connect(f"{name}_in", name, neuro.one_to_one(draw=draw), weight=60.0, delay=0.1)
    late, weight = neuro.normal(mean=1.5, std=0.75, low=0.05), neuro.normal(mean=40.0, std=4.0, low=0.0)
    net.connect("exc", "exc", neuro.fixed_total_number(n=16_000, draw=draw), weight=weight, delay=late)
    net.connect("exc", "inh", neuro.fixed_indegree(n=40, draw=draw), weight=weight, delay=late)
    net.connect("inh", "exc", neuro.pairwise_bernoulli(p=0.1, draw=draw), weight=-200.0, delay=late)
    net.connect("inh", "inh", neuro.fixed_outdegree(n=10, draw=draw), weight=-200.0, delay=1.0)
    return net


def run(net: neuro.Network, backend: str, **words: int) -> tuple[np.ndarray, np.ndarray, int]:
    sim = neuro.compile(net, backend, **words)
    sim.run(300.0)
    return (*sim.spikes("exc"), sim.counts().synaptic_ops)


def test_rates_of_a_network():
    expected, found = run(brunel(HERE), "event", seed=1), run(brunel(BACKEND), "nest", seed=1)
    assert expected[0].size > 500
    assert found[0].size == pytest.approx(expected[0].size, rel=0.06)
    assert found[2] == pytest.approx(expected[2], rel=0.06), "in the mean"
    assert not np.array_equal(found[0], expected[0])
    again, other = run(brunel(BACKEND), "nest", seed=1), run(brunel(BACKEND), "nest", seed=2)
    assert all(map(np.array_equal, found, again))
    assert not np.array_equal(found[0], other[0])
    sim = neuro.compile(brunel(BACKEND), "nest", seed=1)
    sim.run(300.0)
    sim.reset()
    sim.run(300.0)
    assert all(map(np.array_equal, found[:2], sim.spikes("exc")))
    exc = sim.counts().populations["exc"]
    assert exc.neuron_updates_active == exc.neuron_updates, "arrivals are known to NEST alone"


def test_backends_without_rules_draw_as_the_language_does():
    left, here = (run(brunel(draw), "event", seed=1) for draw in (BACKEND, HERE))
    assert all(map(np.array_equal, left, here))


def test_what_is_said(tmp_path):
    net = brunel(BACKEND)
    with pytest.warns(neuro.ApproximationWarning) as told:
        sim = neuro.compile(net, "nest")
    assert (
        str(told[0].message)
        .split(": ", 2)[2]
        .startswith(
            "the synapses of 6 projections ('exc_in_exc', 'inh_in_inh', 'exc_exc', ...): drawn by NEST: equal in "
            "distribution, but not the synapses that neuro draws\n  hint: if they are to be equal, leave 'draw' out"
        )
    )
    assert str(sim).count("static, drawn by nest") == 6
    sim.run(20.0)
    write(collect(sim, net, all_weights=True), tmp_path / "run.h5")
    results = read(tmp_path / "run.h5")
    assert str(results).count("static, drawn by nest") == 6
    assert results.projections["exc_exc"].synapses == 16_000
    message = "the weights of 'exc_exc' were not kept: its synapses were drawn by nest, and are not known"
    assert refusal(lambda: results.weights("exc_exc")) == message


def refusal(call) -> str:
    with pytest.raises(ModelError) as told:
        call()
    return (
        str(told.value).partition("\n")[0].partition(".py:")[2].partition(": ")[2] or str(told.value).partition("\n")[0]
    )


def whole(net: neuro.Network) -> str:
    with pytest.raises(ModelError) as told:
        neuro.compile(net, "nest")
    return str(told.value)


def test_what_needs_the_synapses_is_refused():
    net = one(neuro.fixed_indegree(n=3, draw=BACKEND), 1.0, 1.0)
    sim = neuro.compile(net, "nest")
    for call in (
        lambda: sim.get("wires", "weight"),
        lambda: sim.get("wires", "delay"),
        lambda: sim.set("wires", weight=2.0),
        lambda: sim.set("wires", weight=2.0, pre=[1]),
        lambda: sim.weights("wires"),
        lambda: sim.silence("pre"),
        lambda: sim.network(),
        lambda: sim.energy("loihi"),
        lambda: sim.doctor(),
    ):
        assert refusal(call) == ("projection 'wires': its synapses are drawn by the backend, which does not list them")
    net.probe("w", "wires", "weight", every=1.0)
    sim = None
    assert "drawn by the backend" in refusal(lambda: neuro.compile(net, "nest").run(3.0))
    neuro.compile(net, "event").run(3.0)


def test_what_no_rule_of_nest_has_is_refused():
    def refused(rule: Rule = INDEGREE, **words: object) -> str:
        net = one(rule)
        net.connect("pre", "post", rule, name="other", **words)
        return refusal(lambda: neuro.compile(net, "nest"))

    begin = "projection 'other': draw = backend: found "
    assert refused(synapse=neuro.stdp()) == begin + "stdp: expected static synapses"
    each = begin + "a weight for each synapse: expected as weight a number, uniform, normal or lognormal"
    assert refused(weight=np.ones(270)) == each
    assert refused(delay=np.ones(270)).startswith(begin + "a delay for each synapse")
    far = refused(delay=neuro.lognormal(mean=3.0, std=2.0))
    assert far.startswith("projection 'other': the longest delay that may be drawn = ")
    assert "one_to_one from 120 to 90 neurons" in refused(neuro.one_to_one(draw=BACKEND))
    net = one(neuro.fixed_total_number(n=9, multapses=False, draw=BACKEND))
    assert "NEST's rule draws pairs twice" in whole(net)
    net = one(neuro.fixed_indegree(n=3, draw=BACKEND))
    net.connect("pre[:9]", "post", neuro.fixed_indegree(n=3, draw=BACKEND), name="some")
    assert refusal(lambda: neuro.compile(net, "nest")) == (
        "projection 'some': draw = backend: found a view: expected whole populations"
    )
    net = one(neuro.fixed_indegree(n=3))
    net.population("dc", 1, neuro.dc_generator(amplitude=1.0))
    net.connect("dc", "pre", neuro.all_to_all(draw=BACKEND))
    assert "each of its connections has a node" in whole(net)


def test_named_receptors_follow_the_bounds_of_weights():
    def net(weight: float | Distribution) -> neuro.Network:
        net = neuro.Network("conductances")
        for name in ("pre", "post"):
            net.population(name, 40, neuro.iaf_cond_exp())
        rule = neuro.fixed_indegree(n=5, draw=BACKEND)
        net.connect("pre", "post", rule, neuro.static(receptor="in"), weight=weight)
        return net

    import nest

    sim = neuro.compile(net(neuro.uniform(low=1.0, high=2.0)), "nest")
    cells = sim._engine.net.cells  # type: ignore[attr-defined]
    weights = np.array(nest.GetConnections(cells[0].nodes, cells[1].nodes).get("weight"))
    assert weights.max() < -1.0, "NEST's conductances are chosen by sign"
    assert weights.min() > -2.0
    sim = None
    assert "expected" in refusal(lambda: neuro.compile(net(neuro.normal(mean=1.0, std=1.0)), "nest"))
