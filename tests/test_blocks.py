"""Synapses drawn by blocks of targets: what fits one block keeps its draws; shares together are the whole network."""

import hashlib
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from beside import beside, evaluated
from neuro.compiler import compile_network, connect
from neuro.files.state import fingerprint
from neuro.model.distributions import Distribution
from neuro.model.rules import Rule
from neuro.program.compact import SharedProjection
from neuro.program.counts import Tally
from neuro.program.program import Program, Projection, Share
from refused import refused

PLACES = np.random.default_rng(0).random((60, 2))
RULES: dict[str, Rule] = evaluated(__file__, "RULES", globals())
VALUES: dict[str, tuple[Distribution, Distribution]] = {
    "normal": (neuro.normal(mean=2.0, std=0.5), neuro.normal(mean=1.5, std=0.75)),
    "lognormal": (neuro.lognormal(mean=0.1, std=0.4), neuro.lognormal(mean=0.1, std=0.4)),
    "uniform": (neuro.uniform(low=1.0, high=2.0), neuro.uniform(low=0.5, high=3.0)),
}
(BEFORE,) = beside(__file__, "BEFORE")
"""Digests of projections as they were drawn before there were blocks: by rule, those of normal, lognormal, uniform."""


def network(rule: Rule, values: str, **words: object) -> neuro.Network:
    """One projection from a population to itself."""
    net = neuro.Network("drawn", resolution=0.1)
    net.population("a", 60, neuro.iaf_psc_exp(), positions=PLACES)
    weight, delay = VALUES[values]
    given = {"weight": weight, "delay": delay} | words
    net.connect("a", "a", rule, name="p", **given)  # type: ignore[arg-type]
    return net


def digest(part: Projection) -> str:
    made = hashlib.blake2b(digest_size=8)
    for array in (part.row_ends, part.targets, part.weight, part.delay.astype(np.int32)):
        made.update(np.ascontiguousarray(array).tobytes())
        made.update(str(array.shape).encode())
    return made.hexdigest()


@pytest.mark.parametrize("line", BEFORE.strip().splitlines(), ids=lambda line: line.split()[0])
def test_what_fits_one_block_keeps_its_draws(line: str):
    name, *digests = line.split()
    assert [digest(compile_network(network(RULES[name], v), 3).projections[0]) for v in VALUES] == digests


def test_a_million_synapses_in_one_block_keep_their_draws():
    net = neuro.Network("large", resolution=0.1)
    net.population("a", 1300, neuro.iaf_psc_exp())
    net.population("b", 1200, neuro.iaf_psc_exp())
    weight, delay = VALUES["normal"]
    net.connect("a", "b", neuro.fixed_total_number(n=1_200_000), weight=weight, delay=delay, name="p")
    net.connect("a", "b", neuro.fixed_indegree(n=20), weight=1.0, delay=VALUES["lognormal"][1], name="q")
    found = [digest(part) for part in compile_network(net, 3).projections]
    assert found == ["73ce97272afe15b0", "b92ac48aa597852a"]


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of some tens of synapses."""
    monkeypatch.setattr(connect, "LEAST", 40)
    monkeypatch.setattr(connect, "LEAST_OF_SOURCE", 0)


def rows(program: Program) -> np.ndarray:
    """The synapses of the only projection: source, delay, target, weight and parameters of its rule."""
    part = program.projections[0]
    pre, post = program.connections(0)
    columns = [pre, np.broadcast_to(part.delay, pre.size), post, np.broadcast_to(part.weight, pre.size)]
    vector = part.synapse.vector()
    columns += [np.broadcast_to(values, pre.size) for values in (vector if vector.ndim == 1 else vector.T)]
    return np.stack(columns, axis=1)


def in_order(rows: np.ndarray, by_delay: bool) -> np.ndarray:
    """Rows of several shares, by source, then delay, then target; equal ones stay in order."""
    return rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]) if by_delay else (rows[:, 2], rows[:, 0]))]


SYNAPSES = [neuro.static(), neuro.stdp(Wmax=1e9), neuro.stdp(Wmax=neuro.uniform(low=1e8, high=2e8))]


@pytest.mark.usefixtures("small_blocks")
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from([*RULES]),
    values=st.sampled_from([*VALUES]),
    synapse=st.sampled_from(SYNAPSES),
    own=st.sampled_from([{}, {"weight": 1.5}, {"delay": 0.7}, {"weight": 1.5, "delay": 0.7}]),
    view=st.sampled_from([None, slice(10, 50), slice(50, 10, -1)]),
    many=st.booleans(),
    number=st.integers(1, 5),
    seed=st.integers(0, 99),
)
def test_shares_together_are_the_whole(name, values, synapse, own, view, many, number, seed):
    if values == "normal":
        own = {"weight": neuro.normal(mean=2.0, std=0.5, low=0.0)} | own  # a weight that learns is not negative
    net = network(RULES[name], values, synapse=synapse, **own)
    if view is not None:
        net = neuro.Network("drawn", resolution=0.1)
        exc = net.population("a", 60, neuro.iaf_psc_exp(), positions=PLACES)
        weight, delay = VALUES[values]
        words = {"weight": weight, "delay": delay} | own
        net.connect(exc[view], exc[view], RULES[name], synapse, name="p", **words)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("neuro.compiler.resolve.MANY", 0 if many else 1 << 30)
        whole, side_by_side = (compile_network(net, seed, threads=threads) for threads in (1, 2))
        shares = [compile_network(net, seed, share=Share(k, number)) for k in range(number)]
    assert digest(side_by_side.projections[0]) == digest(whole.projections[0])
    found = np.concatenate([rows(share) for share in shares])
    for k, share in enumerate(shares):
        first, end = Share(k, number).of(60)
        assert (
            number == 1 or not share.projections[0].size or set(share.projections[0].targets) <= set(range(first, end))
        )
        cut = share.projections[0]
        if isinstance(cut, SharedProjection):
            assert cut._numbers.nbytes == 61, "a byte a source"
            assert cut.row_ends.dtype == np.int64
    by_delay = whole.projections[0].by_delay
    np.testing.assert_array_equal(rows(whole), in_order(found, by_delay))


@pytest.mark.usefixtures("small_blocks")
def test_a_negative_conductance_in_blocks_has_no_place(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("neuro.compiler.resolve.MANY", 0)
    net = neuro.Network("drawn", resolution=0.1)
    net.population("a", 60, neuro.iaf_cond_exp())
    weight, delay = neuro.normal(mean=1.0, std=2.0), VALUES["normal"][1]
    net.connect("a", "a", RULES["fixed_indegree"], neuro.static(receptor="ex"), weight=weight, delay=delay, name="p")
    with pytest.raises(neuro.ModelError, match=r"weight = -\d.* to receptor 'ex', a conductance: expected at least 0"):
        compile_network(net, 3)


class Together(Share):
    """A share of a program whose other shares run in threads of this process."""

    def __init__(self, index: int, number: int, meeting: "Meeting") -> None:
        object.__setattr__(self, "index", index)
        object.__setattr__(self, "number", number)
        object.__setattr__(self, "meeting", meeting)

    def gather(self, values: np.ndarray) -> np.ndarray:
        return np.concatenate(self.meeting.of_all(self.index, values))

    def agree(self, make):
        try:
            found, error = make(), None
        except neuro.ModelError as problem:
            found, error = None, problem
        for each in self.meeting.of_all(self.index, error):
            if each is not None:
                raise each
        return found


class Meeting:
    """Where all shares bring something, and get what all have brought."""

    def __init__(self, number: int) -> None:
        self.brought: list[object] = [None] * number
        self.barrier = Barrier(number, timeout=30.0)

    def of_all(self, index: int, value: object) -> list:
        self.brought[index] = value
        self.barrier.wait()
        found = list(self.brought)
        self.barrier.wait()
        return found


def of_shares(number: int, ask):
    """What a function of a share gives, asked of all at the same time."""
    meeting = Meeting(number)
    with ThreadPoolExecutor(number) as pool:
        return list(pool.map(lambda k: ask(Together(k, number, meeting)), range(number)))


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("name", ["fixed_total_number", "pairwise_bernoulli", "one_to_one", "symmetric"])
def test_each_share_tells_of_the_whole(monkeypatch: pytest.MonkeyPatch, name: str, many: bool):
    monkeypatch.setattr("neuro.compiler.resolve.MANY", 0 if many else 1 << 30)
    monkeypatch.setattr("neuro.program.program.AT_ONCE", 50)
    net = network(RULES[name], "normal")
    net.probe("some", "p", "weight", every=1.0, post=[3, 40])
    whole = compile_network(net, 5)
    values = np.arange(whole.projections[0].size)
    tally = Tally(whole)._fan(0)[0]

    def check(share: Share) -> None:
        program = compile_network(net, 5, share=share)
        part = program.projections[0]
        assert (program.min_delay, part.size, part.span) == (whole.min_delay, values.size, whole.projections[0].span)
        np.testing.assert_array_equal(program.connections(0), whole.connections(0))
        np.testing.assert_array_equal(program.joined(0, part.weight), whole.projections[0].weight)
        np.testing.assert_array_equal(program.delays(0), whole.projections[0].delay)
        np.testing.assert_array_equal(program.joined(0, program.own(0, values)), values)
        np.testing.assert_array_equal(Tally(program)._fan(0)[0], tally)
        np.testing.assert_array_equal(program.synapse_probes[0].synapses, whole.synapse_probes[0].synapses)
        assert fingerprint(program) == fingerprint(whole)
        with pytest.raises(neuro.ModelError, match="energy: found a network that is divided among 3 processes"):
            program.refuse_share("energy")

    of_shares(3, check)


def test_a_mistake_in_one_share_is_raised_in_all():
    weight = np.full(4, 1.0)
    weight[3] = -1.0
    rule = neuro.pairs(pre=[3, 1, 2, 3], post=[0, 5, 5, 50])
    net = network(rule, "normal", synapse=neuro.stdp(Wmax=10.0), weight=weight, delay=1.0)

    message, *others = of_shares(3, lambda share: refused(compile_network, net, 1, share=share))
    assert "projection 'p': weight of synapse 3 -> 50 = -1: expected" in message
    assert others == [message] * 2
