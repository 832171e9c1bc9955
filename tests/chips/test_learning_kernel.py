"""Loihi's learning kernels: equal to a twin written to be read, to a public emulator, and for any cut of a run."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.chips.loihi_registers import bounds, grain_of
from neuro.core import keyed_random
from neuro.model.synapses.loihi_registers import SIGN_MODES, parse
from neuro.model.synapses.loihi_rule import FACTORS, MODULATORY, POST, PRE, WIDTHS, Factor, LearningRule, Term, Trace
from neuro_chip.plastic import Plastic

NONE = np.zeros(0, dtype=np.int64)


def cut(x: Fraction) -> Fraction:
    """Towards 0 to 2^-7."""
    return Fraction(int(abs(x) * 128), 128) * (1 if x > 0 else -1)


def held(x: Fraction) -> Fraction:
    return min(Fraction(32767, 128), max(Fraction(-256), x))


class Twin:
    """The learning engine with dictionaries and fractions; draws are those of `neuro.core.keyed_random`."""

    def __init__(self, rule, n_source, n_target, weights, bits, mode, seed, name):
        self.rule, self.seed, self.name = rule, seed, name
        self.w = weights.astype(int).copy()
        self.t = np.zeros_like(self.w)
        self.step_of_weight, self.bounds = grain_of(bits, mode == "mixed"), bounds(mode)[:2]
        sizes = {**dict.fromkeys(PRE, n_source), **dict.fromkeys((*POST, *MODULATORY), n_target)}
        self.trace = {name: [0] * size for name, size in sizes.items()}
        self.past: list[dict[str, list[int]]] = []
        self.fired: tuple[dict[int, int], dict[int, int]] = ({}, {})

    def draw(self, purpose, step, index, below):
        u = keyed_random.uniform(keyed_random.key(self.seed, purpose, self.name), step, np.array([index]))[0]
        return (int(u * 2.0**32) * below) >> 32

    def step(self, step, pre, post):
        for name, values in self.trace.items():
            trace = self.rule.traces.get(name, Trace(0, 0, 1))
            for i, v in enumerate(values):
                whole, rest = divmod(v * trace.numerator, trace.denominator)
                values[i] = whole + bool(rest and self.draw(name, step, i, trace.denominator) < rest)
            ids = pre if name in PRE else post if name in POST else ()
            for i in ids:
                values[i] = min(127, values[i] + trace.impulse)
        self.past.append({name: list(values) for name, values in self.trace.items()})
        for fired, ids in zip(self.fired, (pre, post), strict=True):
            fired.update(dict.fromkeys(map(int, ids), len(self.past) - 1))
        if step % self.rule.epoch == 0:
            for i, j in np.ndindex(self.w.shape):
                self.learn(step, i, j)
            self.past, self.fired = [], ({}, {})

    def value(self, factor: Factor, i, j, at):
        name = factor.name
        known = {"w": self.w[i, j], "t": self.t[i, j], "x0": i in self.fired[0], "y0": j in self.fired[1]}
        if name in known:
            return int(known[name]) + factor.add
        return self.past[-1 if name in MODULATORY else at][name][i if name in PRE else j] + factor.add

    def change(self, terms: tuple[Term, ...], value, step, i, j):
        total = Fraction(int(value))
        for term in terms:
            at = {"x0": self.fired[0].get(i), "y0": self.fired[1].get(j), "u": self.rule.epoch - 1}[term.gate]
            if at is None or (step // self.rule.epoch) % 2**term.every:
                continue
            product = Fraction(term.mantissa) * Fraction(2) ** term.exponent
            for factor in term.factors:
                product *= self.value(factor, i, j, at)
            total = held(total + held(cut(product)))
        return total - int(value)

    def rounded(self, delta, size, purpose, step, e):
        if self.rule.rounding == "away" and purpose == "w":
            whole = -(-abs(delta) // 1)
            return int(whole // size) * size * (1 if delta > 0 else -1)
        whole, rest = divmod(delta, size)
        units = int(rest * 128)
        return (int(whole) + bool(units and self.draw(purpose, step, e, size * 128) < units)) * size

    def learn(self, step, i, j):
        e = i * self.w.shape[1] + j
        dw = self.change(self.rule.dw, self.w[i, j], step, i, j)
        dt = self.change(self.rule.dt, self.t[i, j], step, i, j)
        if dw:
            low, high = self.bounds
            new = int(self.w[i, j]) + self.rounded(dw, self.step_of_weight, "w", step, e)
            self.w[i, j] = min(high, max(low, new))
        if dt:
            self.t[i, j] = min(255, max(-256, int(self.t[i, j]) + self.rounded(dt, 1, "t", step, e)))


FACTOR = st.builds(Factor, st.sampled_from(FACTORS), st.sampled_from([0, 0, -3, 9]))
TERM = st.lists(FACTOR, min_size=1, max_size=3).flatmap(
    lambda factors: st.builds(
        Term,
        st.sampled_from([-7, -5, -3, -1, 1, 3, 5, 7]),
        st.integers(-7 - max(0, sum(WIDTHS[f.name] for f in factors) + 4 - 15), 2),
        st.sampled_from(["x0", "y0", "u"]),
        st.sampled_from([0, 0, 0, 1, 2]),
        st.just(tuple(factors)),
    )
)
TRACE = st.one_of(
    st.builds(Trace.first_order, st.integers(1, 127), st.integers(1, 12)),
    st.builds(Trace.exponential, st.integers(1, 127), st.floats(0.5, 300.0)),
)
RULE = st.builds(
    LearningRule,
    st.lists(TERM, min_size=1, max_size=3).map(tuple),
    st.lists(TERM, max_size=2).map(tuple),
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
    twin = Twin(rule, n, m, weights, bits, mode, seed, "p")
    for step in range(1, steps + 1):
        pre, post = spikes(rng, n), spikes(rng, m)
        if rewards and step % rewards == 0:
            values = rng.normal(0, 40, m)
            plastic.modulate(step - 1, values, 1.0)
            for name, sign in zip(MODULATORY, (1, -1), strict=True):
                twin.trace[name] = [int(min(127, max(0, np.rint(sign * v)))) for v in values]
        plastic.step(step, pre, post)
        twin.step(step, pre, post)
        np.testing.assert_array_equal(plastic.weights.reshape(n, m), twin.w)
        np.testing.assert_array_equal(plastic.tags.reshape(n, m), twin.t)
        slot = (step - 1) % rule.epoch
        np.testing.assert_array_equal(plastic.xs[slot], [twin.trace[name] for name in PRE])
        np.testing.assert_array_equal(plastic.ys[slot], [twin.trace[name] for name in (*POST, *MODULATORY)])
    return plastic


@settings(max_examples=25, deadline=None)
@given(RULE, st.integers(3, 8), st.sampled_from(sorted(SIGN_MODES)), st.integers(0, 2**32), st.booleans())
def test_kernel_equals_twin(rule, bits, mode, seed, rewarded):
    same_as_twin(rule, bits, mode, seed, rewards=5 if rewarded else 0)


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
