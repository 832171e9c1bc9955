"""The compiler's arrays: connection rules, values, and the text that shows them."""

import numpy as np
import pytest

import neuro
from beside import evaluated
from neuro import Network, fixed_indegree, fixed_outdegree, iaf_psc_exp, pairs, pairwise_bernoulli, poisson_generator
from neuro.compiler import compile_network
from neuro.compiler.show import program_text, tables
from neuro.model.rules import Rule
from neuro.program.program import Program, Projection


def compiled(
    rule: Rule, n_pre: int = 40, n_post: int = 30, seed: int = 1, same: bool = False, **words: object
) -> Projection:
    net = Network("rules", resolution=0.1)
    net.population("a", n_pre, iaf_psc_exp())
    net.population("b", n_post, iaf_psc_exp())
    net.connect("a", "a" if same else "b", rule, name="p", **words)  # type: ignore[arg-type]
    return compile_network(net, seed).projections[0]


def sources(part: Projection) -> np.ndarray:
    return np.repeat(np.arange(len(part.row_ends) - 1), np.diff(part.row_ends))


RULES = evaluated(__file__, "RULES", globals())


@pytest.mark.parametrize("same", [False, True])
@pytest.mark.parametrize("name", RULES)
def test_rows_are_sorted_and_of_the_right_number(name: str, same: bool):
    rule = RULES[name]
    part = compiled(rule, same=same)
    n_post = 40 if same else 30
    if part.layout == "dense":
        assert not same
        return
    pre, post = sources(part), part.targets
    assert part.targets.dtype == np.int32
    assert part.row_ends[-1] == part.size == len(post)
    assert np.all(np.diff(pre * n_post + post.astype(np.int64)) >= 0)
    assert post.min() >= 0
    assert post.max() < n_post
    if isinstance(rule, fixed_indegree):
        assert np.all(np.bincount(post, minlength=n_post) == rule.n)
    if isinstance(rule, fixed_outdegree):
        assert np.all(np.diff(part.row_ends) == rule.n)
    if isinstance(rule, neuro.fixed_total_number):
        assert part.size == rule.n
    if same and not rule.autapses:  # type: ignore[attr-defined]
        assert not np.any(pre == post)
    if not getattr(rule, "multapses", True):
        assert len(np.unique(pre * n_post + post)) == part.size


@pytest.mark.parametrize("name", RULES)
def test_a_seed_decides_the_connections(name: str):
    if name == "all but itself":
        return
    one, again, other = (compiled(RULES[name], seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.targets, again.targets)
    assert not np.array_equal(one.targets[:50], other.targets[:50])


def test_bernoulli_is_the_share_of_all_pairs():
    part = compiled(pairwise_bernoulli(p=0.3), 300, 400)
    assert part.size / 120_000 == pytest.approx(0.3, abs=0.01)


def test_listed_pairs_carry_their_values_along():
    pre, post = np.array([3, 1, 3, 0, 1]), np.array([2, 5, 0, 9, 5])
    part = compiled(pairs(pre=pre, post=post), weight=[10.0, 11, 12, 13, 14], delay=[1.0, 2, 3, 4, 5])
    assert sources(part).tolist() == [0, 1, 1, 3, 3]
    assert part.targets.tolist() == [9, 5, 5, 0, 2]
    assert part.weight.tolist() == [13, 11, 14, 12, 10]
    assert part.delay.tolist() == [40, 20, 50, 30, 10]


def test_shared_values_stay_single_and_zero_has_no_sign():
    part = compiled(fixed_indegree(n=3), weight=-0.0, delay=1.5)
    assert (part.weight.shape, part.delay.tolist()) == ((1,), [15])
    assert not np.signbit(part.weight[0])


def test_drawn_delays_are_at_least_one_step():
    part = compiled(fixed_indegree(n=50), delay=neuro.normal(mean=0.1, std=0.2))
    assert part.delay.dtype == np.int32
    assert part.delay.min() == 1
    assert part.delay.max() > 3


def test_half_a_million_synapses_take_no_time():
    net = Network("large", resolution=0.1)
    net.population("cells", 5000, iaf_psc_exp())
    net.connect("cells", "cells", fixed_indegree(n=100))
    assert compile_network(net, 1).projections[0].size == 500_000


def shown() -> tuple[Network, Program]:
    net = Network("shown", resolution=0.1)
    net.population("noise", 4, poisson_generator(rate=[1.0, 2.0, 3.0, 4.0], start=1.0))
    net.population("cells", (2, 2), iaf_psc_exp(tau_m=neuro.uniform(low=8.0, high=12.0)), initial={"V_m": -60.0})
    net.signal("reward", to="cells")
    net.connect("noise", "cells", fixed_indegree(n=3), neuro.stdp_dopa(signal="reward"), weight=5.0, delay=1.5)
    net.connect("cells", "cells", neuro.one_to_one(), weight=[1.0, 2.0, 3.0, 4.0])
    net.group("choice", neuro.winner_take_all(of="cells", first_to_fire=False))
    net.probe("v", "cells", "V_m", every=0.5)
    return net, compile_network(net, 1)


def test_the_text_of_a_program_is_stable(messages):
    _, program = shown()
    text = program_text(program)
    assert text == program_text(shown()[1])
    messages({"shown": text})


def test_tables_for_people():
    found = {table.title: table for table in tables(*shown())}
    assert list(found) == ["populations", "projections", "more", "memory"]
    assert found["populations"].rows[1] == ("cells", "iaf_psc_exp", "2 x 2", "4")
    row = dict(zip(found["projections"].head, found["projections"].rows[0], strict=True))
    assert row[">synapses"] == "12"
    assert row[">delay (ms)"] == "1.5"
    assert row["synapse"] == "stdp_dopa"
    assert found["more"].rows[-1] == ("probe", "v", "cells", "V_m every 0.5 ms")
