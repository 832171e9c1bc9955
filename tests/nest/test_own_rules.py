"""`draw: backend` on NEST: its own rules draw the same distributions, and what needs the synapses says so."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

import neuro
from neuro.core.errors import Where
from neuro.files.results import read, write
from neuro.model.distributions import Distribution
from neuro.model.rules import BACKEND, HERE, Rule
from neuro.run.collect import collect
from refused import error_of, refusals_of, refused

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
    assert not np.array_equal(found[0], run(brunel(BACKEND), "nest", seed=2)[0])
    sim = neuro.compile(brunel(BACKEND), "nest", seed=1)
    for _ in range(2):
        sim.reset()
        sim.run(300.0)
        assert all(map(np.array_equal, found[:2], sim.spikes("exc")))
    exc = sim.counts().populations["exc"]
    assert exc.neuron_updates_active == exc.neuron_updates, "arrivals are known to NEST alone"


def test_backends_without_rules_draw_as_the_language_does():
    left, here = (run(brunel(draw), "event", seed=1) for draw in (BACKEND, HERE))
    assert all(map(np.array_equal, left, here))


def test_what_is_said(tmp_path, messages):
    net = brunel(BACKEND)
    with pytest.warns(neuro.ApproximationWarning) as told:
        sim = neuro.compile(net, "nest")
    messages({"drawn": str(told[0].message).split(": ", 2)[2]})
    assert str(sim).count("static, drawn by nest") == 6
    sim.run(20.0)
    write(collect(sim, net, all_weights=True), tmp_path / "run.h5")
    results = read(tmp_path / "run.h5")
    assert str(results).count("static, drawn by nest") == 6
    assert results.projections["exc_exc"].synapses == 16_000
    messages({"not kept": refused(results.weights, "exc_exc")})


def test_what_needs_the_synapses_is_refused(messages):
    net = one(neuro.fixed_indegree(n=3, draw=BACKEND), 1.0, 1.0)
    sim = neuro.compile(net, "nest")
    calls = [(sim.get, "wires", "weight"), (sim.get, "wires", "delay"), (sim.weights, "wires"), (sim.silence, "pre")]
    calls += [(sim.network,), (sim.energy, "loihi"), (sim.doctor,)]
    answers = [error_of(*call).message for call in calls]
    answers += [error_of(sim.set, "wires", weight=2.0, **words).message for words in ({}, {"pre": [1]})]
    assert len(set(answers)) == 1
    messages({"calls": answers[0]})
    net.probe("w", "wires", "weight", every=1.0)
    del sim, calls
    assert "drawn by the backend" in refused(lambda: neuro.compile(net, "nest").run(3.0))
    neuro.compile(net, "event").run(3.0)


def test_what_no_rule_of_nest_has_is_refused(messages):
    def net(rule: Rule = INDEGREE, other: Rule | None = None, source: str = "pre", **words: object) -> neuro.Network:
        net = one(rule)
        net.place = Where("here")
        if other or words:
            net.connect(source, "post", other or rule, name="other", **words)
        return net

    current = net(neuro.fixed_indegree(n=3))
    current.population("dc", 1, neuro.dc_generator(amplitude=1.0))
    current.connect("dc", "pre", neuro.all_to_all(draw=BACKEND))
    messages(refusals_of(messages.cases, globals() | locals()))


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
    assert "expected" in refused(neuro.compile, net(neuro.normal(mean=1.0, std=1.0)), "nest")
