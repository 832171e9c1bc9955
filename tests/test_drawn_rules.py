"""Connections drawn at random: exact counts, symmetry, and the distributions that they are drawn from."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import binom, chi2, kstest

import neuro
from neuro.compiler import compile_network
from neuro.compiler.pairs import BLOCK, total_number
from neuro.core.keyed_random import uniform_pairs, uniform_table
from neuro.model.rules import Rule
from neuro.program.program import Projection


def compiled(rule: Rule, n_pre: int, n_post: int | None = None, seed: int = 1, **words: object) -> Projection:
    """From one population to another, or to itself."""
    net = neuro.Network("drawn")
    net.population("a", n_pre, neuro.iaf_psc_exp())
    net.population("b", n_post or 1, neuro.iaf_psc_exp())
    net.connect("a", "a" if n_post is None else "b", rule, name="p", **words)  # type: ignore[arg-type]
    return compile_network(net, seed).projections[0]


def pairs_of(part: Projection) -> tuple[np.ndarray, np.ndarray]:
    return np.repeat(np.arange(len(part.row_ends) - 1), np.diff(part.row_ends)), part.targets.astype(np.int64)


def p_of_chi_square(found: np.ndarray, expected: np.ndarray | float) -> float:
    """How probable counts are that deviate as far, where their sum is fixed."""
    return float(chi2.sf(((found - expected) ** 2 / expected).sum(), found.size - 1))


@settings(max_examples=40)
@given(st.integers(1, 12), st.integers(1, 12), st.booleans(), st.booleans(), st.booleans(), st.data())
def test_a_total_number_is_exact(n_pre, n_post, same, autapses, multapses, data):
    n_post = n_pre if same else n_post
    pairs = n_pre * (n_post - (same and not autapses))
    n = data.draw(st.integers(0, 400 if multapses and pairs else pairs))
    rule = neuro.fixed_total_number(n=n, autapses=autapses, multapses=multapses)
    pre, post = pairs_of(compiled(rule, n_pre, None if same else n_post))
    assert len(pre) == n
    place = pre * n_post + post
    assert np.all(np.diff(place) >= 0)
    if not multapses:
        assert len(np.unique(place)) == n
    if same and not autapses:
        assert not np.any(pre == post)


@pytest.mark.parametrize(("n", "multapses"), [(60_000, True), (30, False), (70, False)])
def test_every_pair_is_as_likely(n: int, multapses: bool):
    counts = np.zeros((10, 10))
    for key in range(1 if multapses else 1000):
        row_ends, post = total_number(n, 10, 10, np.arange(10), multapses, key)
        np.add.at(counts, (np.repeat(np.arange(10), np.diff(row_ends)), post), 1)
    found = counts[~np.eye(10, dtype=bool)]
    assert np.all(np.diag(counts) == 0)
    assert p_of_chi_square(found, found.mean()) > 1e-3


def test_a_synapse_keeps_its_draw_when_more_are_drawn():
    found = (total_number(n, 50, 40, None, True, 7) for n in (BLOCK // 500, 2 * BLOCK))
    few_places, more_places = (
        np.bincount(np.repeat(np.arange(50) * 40, np.diff(ends)) + post, minlength=2000) for ends, post in found
    )
    assert np.all(more_places >= few_places)


def test_a_draw_belongs_to_its_pair():
    pre, post = np.array([3, 0, 7, 3]), np.array([5, 2, 2, 0])
    table = uniform_table(11, np.arange(8), 6)
    assert np.array_equal(uniform_pairs(11, pre, post), table[pre, post])


@settings(max_examples=25)
@given(st.integers(1, 30), st.floats(0.0, 1.0), st.integers(0, 99))
def test_symmetric_pairs_come_in_both_directions_with_one_weight(n: int, p: float, seed: int):
    weight = neuro.uniform(low=1.0, high=2.0)
    part = compiled(neuro.symmetric_pairwise_bernoulli(p=p), n, seed=seed, weight=weight, delay=weight)
    pre, post = pairs_of(part)
    assert not np.any(pre == post)
    forth, back = (
        sorted(zip(a.tolist(), b.tolist(), part.weight.tolist(), part.delay.tolist(), strict=True))
        for a, b in ((pre, post), (post, pre))
    )
    assert forth == back
    assert len(set(part.weight.tolist())) * 2 == part.size


def test_symmetric_pairs_are_drawn_as_often_as_nest_draws_them():
    n, p = 300, 0.1
    pre, post = pairs_of(compiled(neuro.symmetric_pairwise_bernoulli(p=p), n))
    times = np.bincount(pre * n + post, minlength=n * n).reshape(n, n)[np.triu_indices(n, 1)]
    expected = np.array([(1 - p) ** 2, 2 * p * (1 - p), p * p]) * times.size
    assert p_of_chi_square(np.bincount(times, minlength=3), expected) > 1e-3


def test_degrees_of_symmetric_pairs_are_binomial():
    n, p = 400, 0.05
    pre, _ = pairs_of(compiled(neuro.symmetric_pairwise_bernoulli(p=p), n))
    degrees = np.bincount(pre, minlength=n) + np.random.default_rng(1).random(n)  # whole numbers made continuous

    def share_below(x: np.ndarray) -> np.ndarray:
        whole = np.floor(x)
        law = binom(2 * (n - 1), p)
        return law.cdf(whole - 1) + (x - whole) * law.pmf(whole)

    assert kstest(degrees, share_below).pvalue > 1e-3


def test_mistakes(messages):
    messages.calls(globals())


def test_views_are_connected_by_their_neurons():
    net = neuro.Network("views")
    cells = net.population("cells", [6, 5], neuro.iaf_psc_exp())
    backwards, rest = cells[[7, 3, 5, 1]], cells[3:]
    weight = neuro.uniform(low=1.0, high=2.0)
    net.connect(backwards, backwards, neuro.symmetric_pairwise_bernoulli(p=0.7), weight=weight, name="both")
    rule = neuro.fixed_total_number(n=295, autapses=False, multapses=False)
    net.connect(cells[:4], rest, rule, name="all")
    both, total = compile_network(net, 1).projections
    pre, post = pairs_of(both)
    forth, back = (
        sorted(zip(a.tolist(), b.tolist(), both.weight.tolist(), strict=True)) for a, b in ((pre, post), (post, pre))
    )
    assert {*pre.tolist()} == {1, 3, 5, 7}
    assert forth == back
    pre, post = pairs_of(total)
    everyone = [(i, j) for i in range(20) for j in range(15, 30) if i != j]
    assert list(zip(pre.tolist(), post.tolist(), strict=True)) == everyone
