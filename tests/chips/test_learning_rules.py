"""Loihi's learning rules as text, and the rules that stand for stdp and stdp_dopa."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips.loihi_learning import COARSE_UPDATE, SMALLEST_UPDATE, fading, nearest_fit, rule_of
from neuro.core.errors import ModelError
from neuro.model.synapses import r_stdp, stdp, stdp_dopa
from neuro.model.synapses.loihi_registers import loihi_learning, parse
from neuro.model.synapses.loihi_rule import FACTORS, WIDTHS, Factor, Term, Trace, text
from neuro_chip.plastic import Plastic

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


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("u0*w", "u0*w"),
        ("w", "u0*w"),
        ("-4*x0", "-2^2*x0"),
        ("12 * 2 ^ -5 * x0 * (3 - w)", "-3*2^-3*x0*(w - 3)"),
        ("+x0*(y0 - 1)*y1*u3", "u3*x0*(y0 - 1)*y1"),
        ("(1 + x1 + 2)*y0", "y0*(x1 + 3)"),
        ("x0*y0", "x0*y0"),
        ("", ""),
    ],
)
def test_normal_form(said, meant):
    assert text(parse(said)) == meant


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("0.3*x1*y0", "scale 0.3 is no power of 2\n  hint: write whole numbers and powers, such as 3*2^-4"),
        ("11*x0", "'11*x0': scale 11 x 2^0: expected -8 to 7 times a power of 2\n  hint: write it as two products"),
        ("2^-8*x0*y1", "'2^-8*x0*y1': exponent -8: expected -7 to 9 for a product of 11 bits"),
        ("2^-13*x0*y1*w", "'2^-13*x0*y1*w': exponent -13: expected -12 to 9 for a product of 20 bits"),
        ("2^10*x0", "'2^10*x0': exponent 10: expected -7 to 9 for a product of 4 bits"),
        ("x1*x2*y1*y2*y3*x0", "5 factors beside the dependency: expected 4"),
        ("x0*yl", "unknown factor 'yl'\n  hint: factors are x0, x1, x2, y0, y1, y2, y3, r1, r2, w, t, u0 to u9"),
        ("d*x0", "unknown factor 'd'\n  hint: delays do not learn here"),
        ("r*x0", "unknown factor 'r'\n  hint: the modulatory traces are r1 (adds) and r2 (subtracts)"),
        ("u*x0", "unknown factor 'u'\n  hint: say how often: u0 in every epoch, u3 in every 8th"),
        ("u12*w", "'u12': expected u0 to u9"),
        ("u1*u2*w", "'u2' beside 'u1' in one product: expected one of them"),
        ("x0*y1/2", "found '/' after a product: expected +, - or *\n  hint: the chip cannot divide: multiply by 2^-n"),
        ("x0*/2", "found '/': the chip cannot divide\n  hint: multiply by 2^-n"),
        ("3^2*x0", "found '^' after a product: expected +, - or *\n  hint: only 2 can be raised: 2^-3"),
        ("2^(-2)*x0", "hint: only 2 can be raised: 2^-3"),
        ("x0 y1", "found 'y1' after a product: expected +, - or *"),
        ("x0*", "ends where a factor is expected"),
        ("x0**y1", "found '*': expected a factor"),
        ("0*x0", "'0*x0' is always 0\n  hint: leave it out"),
        ("x0*(x1 + y1)", "'x1' and 'y1' in one bracket: expected one name and a whole number"),
        ("x0*(w - 300)", "constant -300: expected at most 255 in size"),
        ("x0*(w - 3", "a bracket that is not closed"),
        ("x0*(3)", "a bracket without a name\n  hint: write the number without brackets"),
        ("x0*(w*2)", "a bracket that is not closed\n  hint: expected (name + whole number)"),
    ],
)
def test_mistakes(said, message):
    with pytest.raises(ModelError) as caught:
        parse(said, "dw")
    assert str(caught.value).startswith(f"dw = '{said}': ")
    assert message in str(caught.value)


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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"dw": "x1*y0"}, "loihi_learning: 'y0*x1' reads x1, which never rises\n  hint: give x1_impulse and x1_tau"),
        ({"dw": "x9*y0", **TRACES}, "loihi_learning: dw = 'x9*y0': unknown factor 'x9'"),
        ({"dt": "r1*x0", **TRACES}, "loihi_learning: dt reads r1, which nothing sets here\n  hint: stdp_dopa has"),
        ({"epoch": 64}, "loihi_learning.epoch = 64: expected a whole number >= 1 and <= 63"),
        ({"x1_impulse": 128}, "loihi_learning.x1_impulse = 128: expected a whole number >= 0 and <= 127"),
        ({"rounding": "up"}, "loihi_learning.rounding = 'up': expected one of stochastic, away"),
    ],
)
def test_synapse_mistakes(words, message):
    with pytest.raises(ModelError) as caught:
        loihi_learning(**words)
    assert message in str(caught.value)


@given(st.floats(0.2, 200.0))
def test_amplitudes_are_within_two_percent(change):
    assert nearest_fit(change, 11, "it").value == pytest.approx(change, rel=0.02)


@given(st.floats(8.0, 3000.0))
def test_the_tag_fades_with_its_time_constant(tau):
    terms, _ = fading(tau)
    share = -sum(term.mantissa * 2.0**term.exponent for term in terms)
    assert -(2 ** terms[0].every) / np.log1p(-share) == pytest.approx(tau, rel=0.03)


@pytest.mark.parametrize(
    ("synapse", "scale", "message"),
    [
        (stdp(mu_plus=0.4), 1.0, "stdp.mu_plus = 0.4: expected 0 or 1, which are sums of products"),
        (stdp(mu_minus=3.0), 1.0, "on the chip\n  hint: mu_minus: 1 is nearest"),
        (stdp(Wmax=300.0), 1.0, "300 mantissas of 1: expected 1 to 255\n  hint: change the weight exponent"),
        (stdp(Wmax=0.3), 1.0, "stdp.Wmax = 0.3: 0 mantissas of 1: expected 1 to 255"),
        (stdp(lambda_=1e-5, mu_plus=0.0), 1.0, "stdp.lambda: a change of 0.000951 mantissas cannot be"),
        (stdp(lambda_=1e6, mu_plus=0.0), 1.0, "mantissas does not fit the accumulator\n  hint: a larger weight scale"),
        (stdp_dopa(A_plus=0.0, A_minus=0.0), 1.0, "stdp_dopa.A_plus = A_minus = 0: nothing to learn"),
        (stdp_dopa(b=90.0), 1.0, "stdp_dopa.b = 90: 9216 units of 0.00977: expected at most 255"),
        (stdp_dopa(), 1e5, "mantissas cannot be represented: the smallest is 0.00781"),
        (r_stdp(), 1.0, "the learning engine runs stdp, stdp_dopa and loihi_learning"),
    ],
)  # fmt: skip
def test_what_the_engine_cannot_do(synapse, scale, message):
    with pytest.raises(ModelError) as caught:
        rule_of(synapse, 1.0, 20.0, scale)
    assert message in str(caught.value)


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
