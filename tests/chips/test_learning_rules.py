"""Loihi's learning rules as text, and the rules that stand for stdp and stdp_dopa."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import loihi_twin
import neuro
from loihi_twin import Engine
from neuro.chips.loihi_learning import COARSE_UPDATE, SMALLEST_UPDATE, nearest_fit, rule_of, tag_decay
from neuro.chips.loihi_registers import bounds, grain_of
from neuro.extend import Modulated, State, Synapse, quantity
from neuro.model.synapses import stdp, stdp_dopa
from neuro.model.synapses.loihi_registers import SIGN_MODES, loihi_learning, parse
from neuro.model.synapses.loihi_rule import (
    FACTORS,
    MODULATORY,
    POST,
    PRE,
    WIDTHS,
    Factor,
    LearningRule,
    Term,
    Trace,
    text,
)
from neuro_chip.plastic import Plastic, ThreeFactors, numbers_of
from refused import refusals_of, refused, without_place

TRACES = {"x1_impulse": 20, "x1_tau": 10, "y1_impulse": 20, "y1_tau": 10}


def terms(factors, gates, most, every):
    """Terms of these factors, at exponents that a sum of 16 bits holds up to `most`."""
    lowest = -7 - max(0, sum(WIDTHS[f.name] for f in factors) + 4 - 15)
    mantissas = st.sampled_from([-7, -5, -3, -1, 1, 3, 5, 7])
    return st.builds(Term, mantissas, st.integers(lowest, most), gates, every, st.just(factors))


FACTOR = st.builds(Factor, st.sampled_from(FACTORS), st.integers(-255, 255))

PLAIN = FACTOR.filter(lambda f: f.add or f.name not in ("x0", "y0"))

TERM = st.tuples(st.lists(PLAIN, max_size=4).map(tuple), st.sampled_from(["x0", "y0", "u"])).flatmap(
    lambda said: terms(said[0], st.just(said[1]), 9, st.integers(0, 9))
)


@settings(max_examples=40)
@given(st.lists(TERM, max_size=4).map(tuple))
def test_text_reads_back(terms):
    assert parse(text(terms)) == terms


def test_normal_form():
    for said, meant in (
        ("u0*w", "u0*w"),
        ("w", "u0*w"),
        ("-4*x0", "-2^2*x0"),
        ("12 * 2 ^ -5 * x0 * (3 - w)", "-3*2^-3*x0*(w - 3)"),
        ("+x0*(y0 - 1)*y1*u3", "u3*x0*(y0 - 1)*y1"),
        ("(1 + x1 + 2)*y0", "y0*(x1 + 3)"),
        ("x0*y0", "x0*y0"),
        ("", ""),
    ):
        assert text(parse(said)) == meant


def test_mistakes(messages):
    wrong = "0.3*x1*y0 | 11*x0 | 2^-8*x0*y1 | 2^-13*x0*y1*w | 2^10*x0 | x1*x2*y1*y2*y3*x0 | x0*yl | d*x0 | r*x0 | u*x0"
    wrong += " | u12*w | u1*u2*w | x0*y1/2 | x0*/2 | 3^2*x0 | 2^(-2)*x0 | x0 y1 | x0* | x0**y1 | 0*x0 | x0*(x1 + y1)"
    wrong += " | x0*(w - 300) | x0*(w - 3 | x0*(3) | x0*(w*2)"
    messages({said: refused(parse, said, "dw") for said in wrong.split(" | ")})


def test_synapse_keeps_the_normal_form_and_makes_the_rule():
    synapse = loihi_learning(dw="2^-2*x1*y0 - 2^-2*y1*x0", dt="u1*t", epoch=4, **TRACES)
    assert (synapse.dw, synapse.dt) == ("2^-2*y0*x1 - 2^-2*x0*y1", "u1*t")
    rule = synapse.rule()
    assert rule.epoch == 4
    assert rule.traces == {"x1": Trace(20, 9, 10), "y1": Trace(20, 9, 10)}
    assert loihi_learning.from_words(synapse.parameters()) == synapse
    assert "dw = 2^-2*y0*x1 - 2^-2*x0*y1\ndt = u1*t\nx1: impulse 20, tau 9.491 steps" in str(rule)
    slow = loihi_learning(dw="x1*y0", x1_impulse=20, x1_tau=10, trace_decay="exponential").rule().traces["x1"]
    assert slow.tau == pytest.approx(10.0, rel=1e-4)


def test_synapse_mistakes(messages):
    messages(refusals_of(messages.cases, globals()))


@given(st.floats(0.2, 200.0))
def test_amplitudes_are_within_two_percent(change):
    assert nearest_fit(change, 11, "it").value == pytest.approx(change, rel=0.02)


@given(st.floats(8.0, 3000.0))
def test_the_tag_fades_with_its_time_constant(tau):
    terms, *_ = tag_decay(tau)
    share = -sum(term.mantissa * 2.0**term.exponent for term in terms)
    assert -(2 ** terms[0].every) / np.log1p(-share) == pytest.approx(tau, rel=0.03)


def test_what_the_engine_cannot_do(messages):
    messages(refusals_of(messages.cases, globals()))


def test_what_is_approximated_is_said():
    mapped = rule_of(stdp(mu_plus=0.0, lambda_=0.0005, Wmax=100.2), 0.5, 30.0, 1.0, 6, delay=3)
    said = "\n".join(mapped.approximations)
    assert "potentiation is -4.1% off" in said
    assert "Wmax = 100.2 is 100.2 mantissas, rounded to 100" in said
    assert "potentiation stops at the largest mantissa, 255, not at Wmax = 100.2" in said
    assert "weights have 6 bits" in said
    assert "not after the delay (3 steps)" in said
    assert SMALLEST_UPDATE < mapped.update < COARSE_UPDATE


STEPS = 1000


def float_and_chip(synapse, weight, *, signal=None, largest_n=1.0, n=30, repeats=4, three=False):
    """Changes of n x n synapses under 20 Hz: by the reference backend, and by the mapped rule (mean of some seeds)."""
    net = neuro.Network("pairs", resolution=1.0)
    rng = np.random.default_rng(0)
    pre = net.population("pre", n, neuro.spike_generator())
    drive = net.population("drive", n, neuro.spike_generator())
    post = net.population("post", n, neuro.iaf_psc_delta(V_th=1e5, E_L=0.0, V_reset=0.0, tau_m=1.0, t_ref=0.0))
    net.connect(drive, post, neuro.one_to_one(), neuro.static(), weight=1e7, delay=1.0)
    if signal is not None:
        net.signal("reward", to=post)
    net.connect(pre, post, neuro.all_to_all(), synapse, weight=weight, delay=1.0, name="plastic")
    sim = neuro.compile(net, backend="reference")
    for name in ("pre", "drive"):
        step, ids = np.nonzero(rng.random((STEPS, n)) < 0.02)
        sim.inject(name, step + 1.0, ids)
    mapped = rule_of(synapse, 1.0, 20.0, 1.0, largest_n=largest_n, from_target=three)
    dopamine = [np.zeros(n) if signal is None else signal(rng, n) for _ in range(STEPS // 20)]
    for values in dopamine:
        if signal is not None:
            sim.signal("reward", values)
        sim.run(20.0)
    fired = [sim.spikes(name) for name in ("pre", "post")]
    if signal is None:  # stdp shows the weight of the last pre spike: one more, when all traces are gone
        sim.inject("pre", np.full(n, STEPS + 600.0), np.arange(n))
        sim.run(610.0)
    changes = []
    for seed in range(repeats):
        synapses = np.arange(0, n * n + 1, n), np.tile(np.arange(n, dtype=np.int32), n), n, np.full(n * n, weight)
        if three:
            plastic = ThreeFactors("plastic", seed, mapped.rule, numbers_of(mapped.rule, "excitatory"), *synapses)
        else:
            plastic = Plastic("plastic", seed, mapped.rule, *synapses, 8, "excitatory")
        for step in range(1, STEPS + 1):
            if signal is not None and step % 20 == 1:
                plastic.modulate(step - 1, dopamine[step // 20], mapped.n_scale)
            pre, post = (ids[np.rint(times) == step] for times, ids in fired)
            plastic.step(step, pre, post, np.ones(pre.size))
        changes.append(plastic.weights - weight)
    return np.ravel(sim.weights("plastic")[2]) - weight, np.mean(changes, axis=0)


@pytest.mark.parametrize(("mu_plus", "mu_minus", "alpha"), [(0.0, 0.0, 0.5), (1.0, 1.0, 0.5)])
def test_stdp_learns_what_the_float_rule_learns(mu_plus, mu_minus, alpha):
    synapse = stdp(mu_plus=mu_plus, mu_minus=mu_minus, alpha=alpha, lambda_=0.01, Wmax=255.0)
    wanted, found = float_and_chip(synapse, 128.0)
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.05)
    assert (wanted @ found) / (wanted @ wanted) == pytest.approx(1.0, abs=0.04)
    assert np.corrcoef(wanted, found)[0, 1] > 0.9


@pytest.mark.parametrize("three", [False, True])
def test_stdp_dopa_learns_what_the_float_rule_learns(three):
    """Dopamine of both signs; on Loihi 2 one random number rounds all weights, so their mean differs more."""
    synapse = stdp_dopa(Wmax=255.0, signal="reward", A_minus=0.3, b=0.006)
    wanted, found = float_and_chip(
        synapse, 128.0, signal=lambda rng, n: rng.normal(0.0, 0.03, n), largest_n=0.1, three=three
    )
    assert found.mean() == pytest.approx(wanted.mean(), abs=(0.2 if three else 0.1) * wanted.std())
    assert (wanted @ found) / (wanted @ wanted) == pytest.approx(1.0, abs=0.08 if three else 0.04)
    assert np.corrcoef(wanted, found)[0, 1] > 0.9


def test_dopamine_spikes_are_one_impulse_each():
    mapped = rule_of(stdp_dopa(Wmax=255.0, dopamine="cells"), 1.0, 20.0, 1.0)
    impulse = mapped.rule.traces["r1"].impulse
    assert 8 <= impulse <= 31
    assert mapped.n_scale * impulse == pytest.approx(1 / 200.0)


NONE = np.zeros(0, dtype=np.int64)


SHIFTED = st.builds(Factor, st.sampled_from(FACTORS), st.sampled_from([0, 0, -3, 9]))
LEARNT = st.lists(SHIFTED, min_size=1, max_size=3).flatmap(
    lambda factors: terms(tuple(factors), st.sampled_from(["x0", "y0", "u"]), 2, st.sampled_from([0, 0, 0, 1, 2]))
)

TRACE = st.one_of(
    st.builds(Trace.first_order, st.integers(1, 127), st.integers(1, 12)),
    st.builds(Trace.exponential, st.integers(1, 127), st.floats(0.5, 300.0)),
)

RULE = st.builds(
    LearningRule,
    st.lists(LEARNT, min_size=1, max_size=3).map(tuple),
    st.lists(LEARNT, max_size=2).map(tuple),
    st.fixed_dictionaries(dict.fromkeys((*PRE, *POST, *MODULATORY), TRACE)),
    st.sampled_from([1, 1, 2, 5]),
    st.sampled_from(["stochastic", "stochastic", "away"]),
)


def dense(rule, n_source, n_target, weights, bits=8, mode="mixed", seed=1, name="p"):
    ends = np.arange(0, n_source * n_target + 1, n_target)
    targets = np.tile(np.arange(n_target, dtype=np.int32), n_source)
    return Plastic(name, seed, rule, ends, targets, n_target, weights.ravel(), bits, mode)


def spikes(rng, n, share=0.3):
    return np.flatnonzero(rng.random(n) < share)


def same_as_twin(rule, bits, mode, seed, *, steps=13, size=(2, 3), rewards=0):
    """Run kernel and twin side by side and demand equal weights, tags and traces; return the kernel's side."""
    n, m = size
    rng = np.random.default_rng(seed)
    low, high, _ = bounds(mode)
    step_of_weight = grain_of(bits, mode == "mixed")
    weights = rng.integers(-(-low // step_of_weight), high // step_of_weight + 1, size) * step_of_weight
    plastic = dense(rule, n, m, weights, bits, mode, seed)
    twin = Engine(rule, n, m, [*np.ndindex(*size)], weights.ravel(), bits, mode, seed, "p")
    for step in range(1, steps + 1):
        pre, post = spikes(rng, n), spikes(rng, m)
        if rewards and step % rewards == 0:
            values = rng.normal(0, 40, m)
            plastic.modulate(step - 1, values, 1.0)
            twin.modulate(values)
        plastic.step(step, pre, post)
        twin.step(step, pre, post)
        np.testing.assert_array_equal(plastic.weights, twin.w)
        np.testing.assert_array_equal(plastic.tags, twin.t)
        slot = (step - 1) % rule.epoch
        np.testing.assert_array_equal(plastic.xs[slot], [twin.trace[name] for name in PRE])
        np.testing.assert_array_equal(plastic.ys[slot], [twin.trace[name] for name in (*POST, *MODULATORY)])
    return plastic


@settings(max_examples=25, deadline=None)
@given(RULE, st.integers(3, 8), st.sampled_from(sorted(SIGN_MODES)), st.integers(0, 2**32), st.booleans())
def test_kernel_equals_twin(rule, bits, mode, seed, rewarded):
    same_as_twin(rule, bits, mode, seed, rewards=5 if rewarded else 0)


NETWORKS = int(os.environ.get("NEURO_LEARNING_NETWORKS", "24"))


@pytest.mark.parametrize("seed", range(NETWORKS))
def test_random_networks_learn_as_their_twin(seed):
    net, told = loihi_twin.network(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "loihi", seed=seed)
        twin = loihi_twin.Learning(net, sim.program, sim._engine.fixed)
        for k in range(1, loihi_twin.STEPS + 1):
            sim.run(1.0)
            fired = twin.step(k)
            times, ids = sim.spikes("b")
            assert ids[times == k].tolist() == fired["b"], k
            for index, engine in enumerate(twin.engines):
                assert sim._engine.synapse_registers(index, "weight").tolist() == engine.w, k
                assert sim._engine.synapse_registers(index, "t").tolist() == engine.t, k
            if k in told:
                sim.signal("r", told[k])
                twin.engines[0].modulate(told[k] / twin.wires[0].n_scale)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("excitatory", [100, 100, 100, 100, 108, 104, 114, 114, 117, 117, 117]),
        ("mixed", [100, 100, 100, 100, 108, 104, 114, 114, 116, 116, 116]),
    ],
)
def test_brian2loihi(mode, expected):
    """Weights of Brian2Loihi 0.5.2 as long as no trace has a fraction: one synapse, rounding away from 0."""
    trace = Trace.first_order(64, 2)
    rule = LearningRule(parse("2^-2*x1*y0 - 2^-3*x0*y1"), (), {"x1": trace, "y1": trace}, 1, "away")
    plastic = dense(rule, 1, 1, np.array([[100]]), 8, mode)
    found = [100]
    for step in range(1, 11):
        plastic.step(step, NONE if step not in (3, 5) else np.array([0]), np.array([0] if step in (4, 6, 8) else NONE))
        found.append(int(plastic.weights[0]))
    assert found == expected


def pairs_rule(**more):
    trace = Trace.first_order(20, 10)
    return LearningRule(parse("2^-3*x1*y0 - 2^-3*x0*y1"), (), {"x1": trace, "y1": trace}, **more)


def test_only_synapses_of_spikes_are_visited():
    plastic = dense(pairs_rule(), 20, 30, np.zeros((20, 30), dtype=np.int64))
    plastic.step(1, NONE, NONE)
    assert plastic.counts[0] == 0
    plastic.step(2, np.array([3]), np.array([5, 7]))
    assert plastic.counts[0] == 30 + 2 * 20 - 2


def test_stochastic_rounding_is_unbiased():
    """A change of 3/128 of a mantissa, one in two of which a mixed weight can hold, moves the mean by as much."""
    n = 200
    rule = LearningRule(parse("3*2^-7*x0"))
    plastic = dense(rule, n, n, np.zeros((n, n), dtype=np.int64))
    for step in range(1, 51):
        plastic.step(step, np.arange(n), NONE)
    mean = 50 * 3 / 128
    deviation = np.sqrt(50 * 3 / 256 * (1 - 3 / 256)) * 2 / n
    assert abs(plastic.weights.mean() - mean) < 5 * deviation
    assert not np.any(plastic.weights % 2)


def test_changes_below_the_accumulator_are_lost_and_large_ones_saturate():
    small = LearningRule(parse("2^-12*x0*w*y1"), (), {"y1": Trace(1, 1, 1)})
    plastic = dense(small, 1, 1, np.array([[20]]))
    for step in range(1, 50):
        plastic.step(step, np.array([0]), np.array([0] if step == 1 else NONE))
    assert plastic.weights[0] == 20
    large = dense(LearningRule(parse("2^9*x0")), 1, 1, np.array([[20]]), 8, "excitatory")
    large.step(1, np.array([0]), NONE)
    assert large.weights[0] == 255
    assert large.counts.tolist() == [1, 1, 1, 0, 0, 2]


def test_dopamine_spikes_add_up():
    rule = LearningRule(parse("t*r1"), (), {"r1": Trace(30, 1, 1)})
    plastic = dense(rule, 1, 3, np.zeros((1, 3), dtype=np.int64))
    plastic.release(0, np.array([0, 0, 2]))
    plastic.step(1, NONE, NONE)
    assert plastic.ys[0, 3].tolist() == [60, 0, 30]
    plastic.release(1, np.array([0, 0, 0]))
    assert plastic.ys[0, 3].tolist() == [127, 0, 30]
    assert plastic.saturated == 1


# a rule of one's own, with its own sums of products


@dataclass(frozen=True, kw_only=True, eq=False)
class windowed(Synapse):
    """Pairs by a sum of products that no rule of this library has."""

    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    eta: float = quantity(0.8, "", "change by a pair", above=0)
    Wmax: float = quantity(20.0, "", "largest weight", above=0)

    def constants(p, h, c):
        c[:3] = p[:3]

    def on_post(y, e, c, pre, post):
        y[0, e] = min(c[2], y[0, e] + c[1] * pre[0])

    def on_pre(y, e, c, pre, post):
        y[0, e] = max(0.0, y[0, e] - 0.5 * c[1] * post[0])

    def microcode(self, engine):
        k = round(np.log2(self.eta / engine.mantissa / 16))
        return engine.rule(
            f"2^{k}*x1*y0 - 2^{k - 1}*x0*y1 - u3*2^-4*(w - 8)", x1=(16, self.tau_plus), y1=(16, engine.tau_minus)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class taught(Modulated):
    """The same eligibility under a signal; n stays as it was set."""

    states: ClassVar[tuple[State, ...]] = (State("c", "", "eligibility"),)

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    Wmax: float = quantity(20.0, "", "largest weight", above=0)

    def constants(p, h, c):
        c[0] = h

    def on_post(y, e, c, pre, post):
        y[1, e] += pre[0]

    def on_pre(y, e, c, pre, post):
        y[1, e] -= post[0]

    def advance(y, e, c, begin, end, n, grid):
        y[0, e] += n * c[0] * (end - begin) * y[1, e]

    def microcode(self, engine):
        return engine.rule("2^-12*t*r1 - 2^-12*t*r2", "y0*x1 - x0*y1", x1=(8, self.tau_plus), y1=(8, engine.tau_minus))


def own(synapse):
    net = neuro.Network("own", resolution=1.0)
    net.population("pre", 4, neuro.poisson_generator(rate=60.0))
    net.population("noise", 3, neuro.poisson_generator(rate=300.0))
    net.population("post", 3, neuro.iaf_psc_delta(I_e=300.0, tau_minus=15.0))
    net.connect("noise", "post", neuro.one_to_one(), weight=12.0, delay=1.0)
    net.probe("spikes", "pre")
    if synapse.modulated:
        net.signal("reward", to="post")
    net.connect("pre", "post", neuro.all_to_all(), synapse, weight=8.0, delay=2.0, name="learnt")
    return net


@pytest.mark.parametrize("synapse", [windowed(), taught(signal="reward")])
def test_sums_of_products_of_ones_own_run_as_their_twin(synapse):
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        sim = neuro.compile(own(synapse), "loihi", seed=4)
    assert any("the engine runs its microcode: dw = " in str(one.message) for one in heard)
    wires = sim._engine.fixed.projections[1]
    begin = np.broadcast_to(wires.mantissas, 12).reshape(4, 3)
    twin = Engine(wires.rule, 4, 3, [*np.ndindex(4, 3)], begin.ravel(), wires.bits, wires.sign_mode, 4, "learnt")
    for block in range(4):
        if synapse.modulated:
            n = np.array([0.5, -1.0, 2.0]) * (-1.0) ** block
            sim.signal("reward", n)
            for name, sign in zip(MODULATORY, (1, -1), strict=True):
                twin.trace[name] = [int(min(127, max(0, np.rint(sign * v / wires.n_scale)))) for v in n]
        sim.run(50.0)
        fired = [sim.spikes(name) for name in ("pre", "post")]
        for step in range(50 * block + 1, 50 * block + 51):
            twin.step(step, *(ids[np.rint(times) == step] for times, ids in fired))
    assert sim._engine.synapse_registers(1, "weight").tolist() == twin.w
    assert sim._engine.synapse_registers(1, "t").tolist() == twin.t
    assert len({*twin.w}) > 3
    if synapse.modulated:
        assert sim.get("learnt", "c").tolist() == twin.t
    event = neuro.compile(own(synapse), seed=4)
    event.run(50.0)


def test_sums_of_products_of_ones_own_that_do_not_fit_are_refused(messages):
    def told(code, **words):
        kind = type("wrong", (windowed,), {"microcode": code, "__module__": __name__, **words})
        return without_place(neuro.compile, own(kind()), "loihi")

    messages(
        {
            "result": told(lambda self, engine: "2^-2*x1*y0"),
            "trace": told(lambda self, engine: engine.rule("x3*y0", x3=(16, 20.0))),
            "impulse": told(lambda self, engine: engine.rule("x1*y0", x1=(1.5, 20.0))),
            "product": told(lambda self, engine: engine.rule("x1*y0 / 2", x1=(16, 20.0))),
            "never": told(lambda self, engine: engine.rule("x1*y0")),
            "arguments": told(lambda engine: engine.rule("x1*y0")),
            "an error inside": told(lambda self, engine: engine.rule(f"2^{int(self.name)}*x1*y0")),
        }
    )
