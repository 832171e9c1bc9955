"""Values that are encoded in a network, and third-party codes by name."""

from pathlib import Path
from typing import Literal

import h5py
import numpy as np
import pytest

import neuro
from neuro.coding import CODES, RATE_CODES, log_intensity_to_latency, poisson, population
from neuro.coding.codes import CHOICES
from neuro.core.keyed_random import key
from neuro.testing import check_part
from refused import error_of, refusals_of, refused as refusal

BOUNDS = {"r_min": 1.0, "r_max": 8.0}
NET = Path(__file__).with_name("encode.yaml").read_text("utf-8")


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Read a network with one population whose values are encoded."""
    monkeypatch.chdir(tmp_path)

    def of(said, shape="2"):
        (tmp_path / "net.yaml").write_text(NET % (said, shape))
        return neuro.load("net.yaml")

    return of


def trains(net, ms=150.0, backend="reference", seed=1):
    """The spike times of each neuron."""
    sim = neuro.compile(net, backend, seed=seed)
    sim.run(ms)
    times, ids = sim.spikes("p")
    return [times[ids == n].tolist() for n in range(sim.program.populations[0].size)]


def encoded(values, code, shape=None, **words):
    net = neuro.Network("one", resolution=1.0)
    net.population("p", np.shape(values) if shape is None else shape, neuro.encode(values=values, code=code, **words))
    net.probe("all", "p")
    return net


def test_files(load, tmp_path):
    values = np.array([[1.0, 2.0], [4.0, 8.0]])
    np.save("x.npy", values)
    with h5py.File("x.h5", "w") as file:
        file["a/x"] = values
    code = "code: {log_intensity_to_latency: {r_min: 1.0, r_max: 8.0, window: 100}}"
    nets = [
        load(f"{said}, {code}", "[2, 2]") for said in ("file: x.npy", "file: x.h5, key: a/x", "values: {file: x.npy}")
    ]
    expected = np.floor(log_intensity_to_latency(values, 1.0, 8.0, 100.0) + 1e-6) + 1  # the end of the step
    for net in nets:
        assert trains(net) == [[t] for t in expected.ravel()] == [[101.0], [67.0], [34.0], [1.0]]
        assert net == nets[0]
    net = load("values: [1.0, 8.0], code: [{rate: {r_min: 1, r_max: 8, max_rate: 9}}, rank], start: 3.0")
    net.save("copy.yaml")
    code = "code: [{rate: {r_min: 1.0, r_max: 8.0, max_rate: 9.0}}, rank]"
    assert f" encode: {{values: [1.0, 8.0], {code}, start: 3.0}}\n" in (tmp_path / "copy.yaml").read_text()
    assert neuro.load("copy.yaml") == net
    assert neuro.encode(values=[1, 2], code="rank") == neuro.encode(values=[1, 2], code=[{"rank": {}}])
    sim = neuro.compile(load("values: [1.0, 8.0], code: {rank: {window: 10}}"), "reference")
    assert sim.network().populations["p"].model == neuro.spike_generator(spike_times=[[11.0], [6.0]])


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_spikes_lie_in_the_steps_of_their_times(backend):
    code = {"phase": {"r_min": 0.0, "r_max": 1.0, "window": 2.0, "bits": 4}}  # at 0, 0.5, 1 and 1.5 ms
    assert trains(encoded([15 / 16, 0.0], code), backend=backend) == [[1.0, 1.0, 2.0, 2.0], []]
    assert trains(encoded([15 / 16], code, start=5.0), backend=backend) == [[6.0, 6.0, 7.0, 7.0]]
    assert trains(encoded([15 / 16], code, start=5.0, stop=6.0), backend=backend) == [[6.0, 6.0]]


def test_values_of_networks():
    code = {"log_intensity_to_latency": {**BOUNDS, "window": 10.0}}
    assert trains(encoded([0.0, 8.0, -1.0], code)) == [[], [1.0], []]
    net = encoded([1.0, 4.5, 8.0], {"rate": {**BOUNDS, "max_rate": 80.0}}, start=10.0, stop=20.0)
    sim = neuro.compile(net, "reference")
    part = sim.program.populations[0]
    assert (part.kind, part.start, part.stop, sim.get("p", "rate").tolist()) == ("poisson", 10, 20, [0.0, 40.0, 80.0])
    sim.set("p", rate=5.0)
    assert sim.network().populations["p"].model == neuro.poisson_generator(rate=5.0, start=10.0, stop=20.0)
    net = encoded([100.0, 100.0], {"poisson": {"window": 100.0}})
    net.population("q", 2, net.populations["p"].model)
    sim = neuro.compile(net, "reference")
    sim.run(110.0)
    assert sim.spikes("p")[0].tolist() != sim.spikes("q")[0].tolist()
    code = [{"population": {"n": 5, **BOUNDS, "max_rate": 200.0}}, {"poisson": {"window": 100.0}}]
    net = encoded([1.0, 8.0], code, shape=(2, 5))
    drawn = poisson(population([1.0, 8.0], 5, 1.0, 8.0, 200.0), 100.0, seed=key(1, "encode", "p")).reshape(10, -1)
    expected = [(np.floor(train[np.isfinite(train)]) + 1.0).tolist() for train in drawn]
    assert trains(net) == trains(net, backend="event") == expected
    assert trains(net, seed=2) != expected


def test_mistakes(load, messages):
    def encode(**words):
        return neuro.encode(**{"values": [1.0, 2.0], **words})

    messages(refusals_of(messages.cases, globals() | locals() | {"nan": np.nan, "inf": np.inf}))
    assert Path(__file__).name in f"{error_of(encode, code=3).where}"  # where it was called


@pytest.fixture
def _third_party_codes(registries):
    @neuro.register(kind="code")
    def late(values, by: float, words: Literal["once", "twice"] = "once", seed: int = 0):
        """All values at one time.

        Args:
            values: any.
            by: when.
            words: how
                often.
            seed: of nothing.

        Source: a test.
        """
        return np.full((*values.shape, 1 if words == "once" else 2), by)

    @neuro.register(kind="rate code")
    def squared(r):
        return r**2


@pytest.mark.usefixtures("_third_party_codes")
def test_a_third_party_code_works_by_its_name(load):
    assert trains(load("values: [1, 2], code: {late: {by: 3}}")) == [[4.0], [4.0]]
    assert trains(load("values: [1, 2], code: [squared, {late: {by: 3, words: twice}}]")) == [[4.0, 4.0]] * 2
    sim = neuro.compile(load("values: [1, 2], code: squared"), "reference")
    assert sim.get("p", "rate").tolist() == [1.0, 4.0]
    made = CHOICES["late"]
    assert (made.__doc__, made.source, made.draws) == ("All values at one time.", "a test", True)
    assert {word: q.doc for word, q in made.quantities().items()} == {"by": "when", "words": "how often"}
    with pytest.raises(neuro.ModelError, match="code 'later' is registered too late: a network was compiled"):

        @neuro.register(kind="code")
        def later(values):
            return values


@pytest.mark.usefixtures("_third_party_codes")
@pytest.mark.parametrize(
    ("gives", "kind", "message"),
    [
        (np.zeros(3), "code", "odd: gives an array of the shape [3]: expected [2], or one more axis"),
        (np.array([-1.0, 0.0]), "code", "odd: gives -1.0: expected times >= 0 ms, or NaN for no spike"),
        (np.array([0.0, np.nan]), "rate code", "odd: gives nan: expected finite rates"),
        (np.array(["x", "y"]), "code", "odd: odd: found ['x', 'y']: expected numbers"),
    ],
)
def test_what_a_code_gives_is_looked_at(gives, kind, message):
    @neuro.register(kind=kind)
    def odd(values):
        return gives

    assert message in refusal(neuro.encode, values=[1.0, 2.0], code="odd")


def unknown(values, of: "Missing"):  # noqa: F821
    return values


def taken(values, rates: float):
    return values


def nothing():
    return None


def lists(values, of: list):
    return values


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize(
    ("function", "message"),
    [
        (taken, "code 'taken': 'rates' has a special meaning: expected another name for the parameter"),
        (nothing, "code 'nothing' takes no argument: expected the values first"),
        (lists, "code 'lists': 'of' is annotated <class 'list'>: expected float, int, bool or Literal words"),
        (unknown, "code 'unknown': its annotations cannot be read: name 'Missing' is not defined"),
    ],
)
def test_functions_that_cannot_be_said(function, message):
    neuro.register(function, kind="code")
    assert refusal(lambda: CODES[function.__name__]) == message


@pytest.mark.usefixtures("registries")
def test_one_name_is_one_code():
    def rank(values):
        return values

    neuro.register(rank, kind="rate code")
    assert "'rank' is both a code and a rate code: expected another name for one" in refusal(lambda: RATE_CODES["rank"])


@pytest.mark.parametrize("code", [{"phase": {**BOUNDS, "window": 16.0}}, {"rate": {**BOUNDS, "max_rate": 300.0}}])
def test_it_is_a_part_like_others(code):
    check_part(neuro.encode(values=np.linspace(1.0, 8.0, 20), code=code, start=4.0))


def test_trials_bring_their_own_spikes():
    net = encoded([1.0, 8.0], "rank")
    net.population("out", 2, neuro.iaf_psc_delta())
    net.connect("p", "out", neuro.one_to_one())
    net.group("first", neuro.winner_take_all(of="out"))
    net.trials(input="p", duration=10.0)
    with pytest.raises(neuro.ModelError, match="expected none, because trials bring their own"):
        neuro.compile(net, "reference")
