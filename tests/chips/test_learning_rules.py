"""Loihi's learning rules as text, and the rules that stand for stdp and stdp_dopa."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips.loihi_learning import COARSE_UPDATE, SMALLEST_UPDATE, fading, nearest_fit, rule_of
from neuro.model.synapses import r_stdp, stdp, stdp_dopa
from neuro.model.synapses.loihi_registers import loihi_learning, parse
from neuro.model.synapses.loihi_rule import FACTORS, WIDTHS, Factor, Term, Trace, text
from neuro_chip.plastic import Plastic
from refused import error_of, refused

TRACES = {"x1_impulse": 20, "x1_tau": 10, "y1_impulse": 20, "y1_tau": 10}


def lowest(factors):
    return -7 - max(0, sum(WIDTHS[f.name] for f in factors) + 4 - 15)


FACTOR = st.builds(Factor, st.sampled_from(FACTORS), st.integers(-255, 255))
PLAIN = FACTOR.filter(lambda f: f.add or f.name not in ("x0", "y0"))
TERM = st.tuples(st.lists(PLAIN, max_size=4).map(tuple), st.sampled_from(["x0", "y0", "u"])).flatmap(
    lambda said: st.builds(
        Term,
        st.sampled_from([-7, -5, -3, -1, 1, 3, 5, 7]),
        st.integers(lowest(said[0]), 9),
        st.just(said[1]),
        st.integers(0, 9),
        st.just(said[0]),
    )
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
    wrong = [{"dw": "x1*y0"}, {"dw": "x9*y0", **TRACES}, {"dt": "r1*x0", **TRACES}, {"epoch": 64}]
    wrong += [{"x1_impulse": 128}, {"rounding": "up"}]
    told = {str(words): error_of(loihi_learning, **words) for words in wrong}
    messages({case: f"{error.message}\n{error.hint or ''}" for case, error in told.items()})


@given(st.floats(0.2, 200.0))
def test_amplitudes_are_within_two_percent(change):
    assert nearest_fit(change, 11, "it").value == pytest.approx(change, rel=0.02)


@given(st.floats(8.0, 3000.0))
def test_the_tag_fades_with_its_time_constant(tau):
    terms, _ = fading(tau)
    share = -sum(term.mantissa * 2.0**term.exponent for term in terms)
    assert -(2 ** terms[0].every) / np.log1p(-share) == pytest.approx(tau, rel=0.03)


def test_what_the_engine_cannot_do(messages):
    powers, changes = ({"mu_plus": 0.4}, {"mu_minus": 3.0}, {"Wmax": 300.0}, {"Wmax": 0.3}), (1e-5, 1e6)
    rules = [stdp(**words) for words in (*powers, *({"lambda_": change, "mu_plus": 0.0} for change in changes))]
    rules += [stdp_dopa(A_plus=0.0, A_minus=0.0), stdp_dopa(b=90.0), r_stdp(), stdp_dopa()]
    scales = [*[1.0] * 9, 1e5]
    answers = [refused(rule_of, rule, 1.0, 20.0, scale) for rule, scale in zip(rules, scales, strict=True)]
    messages({str(k): answer for k, answer in enumerate(answers)})


def test_what_is_approximated_is_said():
    mapped = rule_of(stdp(mu_plus=0.0, lambda_=0.0005, Wmax=100.2), 0.5, 30.0, 1.0, 6, delay=3)
    said = "\n".join(mapped.approximations)
    assert "potentiation is -4.1% off" in said
    assert "Wmax = 100.2 is 100.2 mantissas, taken as 100" in said
    assert "potentiation stops at the largest mantissa, 255, not at Wmax = 100.2" in said
    assert "weights have 6 bits" in said
    assert "not after the delay (3 steps)" in said
    assert SMALLEST_UPDATE < mapped.update < COARSE_UPDATE


STEPS = 1000


def float_and_chip(synapse, weight, *, signal=None, largest_n=1.0, n=30, repeats=4):
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
    mapped = rule_of(synapse, 1.0, 20.0, 1.0, largest_n=largest_n)
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
        plastic = Plastic(
            *("plastic", seed, mapped.rule, np.arange(0, n * n + 1, n), np.tile(np.arange(n, dtype=np.int32), n)),
            *(n, np.full(n * n, weight), 8, "excitatory"),
        )
        for step in range(1, STEPS + 1):
            if signal is not None and step % 20 == 1:
                plastic.modulate(step - 1, dopamine[step // 20], mapped.n_scale)
            plastic.step(step, *(ids[np.rint(times) == step] for times, ids in fired))
        changes.append(plastic.weights - weight)
    return np.ravel(sim.weights("plastic")[2]) - weight, np.mean(changes, axis=0)


@pytest.mark.parametrize(("mu_plus", "mu_minus", "alpha"), [(0.0, 0.0, 0.5), (1.0, 1.0, 0.5)])
def test_stdp_learns_what_the_float_rule_learns(mu_plus, mu_minus, alpha):
    synapse = stdp(mu_plus=mu_plus, mu_minus=mu_minus, alpha=alpha, lambda_=0.01, Wmax=255.0)
    wanted, found = float_and_chip(synapse, 128.0)
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.05)
    assert (wanted @ found) / (wanted @ wanted) == pytest.approx(1.0, abs=0.04)
    assert np.corrcoef(wanted, found)[0, 1] > 0.9


def test_stdp_dopa_learns_what_the_float_rule_learns():
    """Dopamine of both signs."""
    synapse = stdp_dopa(Wmax=255.0, signal="reward", A_minus=0.3, b=0.006)
    wanted, found = float_and_chip(synapse, 128.0, signal=lambda rng, n: rng.normal(0.0, 0.03, n), largest_n=0.1)
    assert found.mean() == pytest.approx(wanted.mean(), abs=0.1 * wanted.std())
    assert (wanted @ found) / (wanted @ wanted) == pytest.approx(1.0, abs=0.04)
    assert np.corrcoef(wanted, found)[0, 1] > 0.9


def test_dopamine_spikes_are_one_impulse_each():
    mapped = rule_of(stdp_dopa(Wmax=255.0, dopamine="cells"), 1.0, 20.0, 1.0)
    impulse = mapped.rule.traces["r1"].impulse
    assert 8 <= impulse <= 31
    assert mapped.n_scale * impulse == pytest.approx(1 / 200.0)
