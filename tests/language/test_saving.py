"""A saved network loads to an equal one, whatever it holds, and saving again gives the same bytes."""

import math
import os
import re
import time

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro.core.values import FromFile
from neuro.model.distributions import DISTRIBUTIONS
from neuro.model.neurons import MODELS
from neuro.model.parts import Trials
from neuro.model.rules import RULES
from neuro.model.space import MASKS, PROFILES, Profile
from neuro.model.synapses import SYNAPSES
from refused import refused

NAMES = st.one_of(
    st.sampled_from(["true", "no", "null", "1", "1e3", ".inf", "-", ".", "auto", "neuro", "été"]),
    st.text("abAB12_.-", min_size=1, max_size=5),
)

BOUNDS = {"r_min": 0.25, "r_max": 1.0}
CODES = (
    "rank",
    ["rank"],
    {"rank": {"ties": "dense", "window": 20.0}},
    {"log_intensity_to_latency": {**BOUNDS, "window": 20}},
    {"phase": {**BOUNDS, "window": 8.0, "bits": 4}},
    {"population": {"n": 8, **BOUNDS, "max_rate": 50.0}},
    [{"rate": {**BOUNDS, "max_rate": 50.0}}, {"poisson": {"window": 100.0}}],
)


def numbers(q):
    """Numbers within the bounds of a quantity."""
    if q.whole:
        return st.integers(*(None if bound is None else int(bound) for bound in (q.at_least, q.at_most))).map(float)
    low = next((b for b in (q.above, q.at_least) if b is not None), None)
    high = next((b for b in (q.below, q.at_most) if b is not None), None)
    ends = {"exclude_min": q.above is not None, "exclude_max": q.below is not None}
    finite = st.floats(low, high, **ends, allow_nan=False, allow_infinity=False)
    infinities = [x for x in (math.inf, -math.inf) if (low is None or x > low) and (high is None or x < high)]
    finite = finite.filter(bool) if q.nonzero else finite
    return finite | st.sampled_from(infinities) if q.infinite else finite


def arrays(elements):
    """Small and large arrays of one or two axes, in memory or from a file."""
    shapes = st.sampled_from([(1,), (3,), (2, 3), (64,), (65,), (13, 5), (2, 0), (0,)])

    def filled(drawn):
        array = np.resize(np.array(drawn[1]), drawn[0])
        return FromFile("w.h5", "w", array) if drawn[2] else array

    return st.tuples(shapes, st.lists(elements, min_size=1, max_size=4), st.booleans()).map(filled)


def values(q, names):
    """Values of any kind that a quantity accepts."""
    match q.kind:
        case "number":
            plain = numbers(q)
            of_distance = profile().map(neuro.of_distance) if q.of_distance else st.nothing()
            drawn = st.sampled_from(list(DISTRIBUTIONS)).flatmap(distribution)
            return plain | arrays(plain) | drawn | of_distance if q.arrays else plain
        case "delay":
            return st.floats(0.1, 10.0)
        case "integer":
            whole = st.integers(int(q.at_least or 0), int(1000 if q.at_most is None else q.at_most))
            return whole | st.sampled_from(q.words) if q.words else whole
        case "boolean":
            return st.booleans()
        case "word":
            return st.sampled_from(q.words)
        case "shape":
            return st.lists(st.integers(1, 20), min_size=2, max_size=2)
        case "names":
            return st.lists(st.sampled_from(["V_m", "I_syn_ex"]), max_size=2)
        case "times":
            train = st.lists(st.floats(0.1, 100.0), max_size=30).map(sorted)
            return st.lists(train, max_size=5)
        case "moments":
            return st.lists(st.floats(0.1, 100.0), min_size=2, max_size=2, unique=True).map(sorted)
        case "series":
            row = st.lists(numbers(q), min_size=2, max_size=2)
            return row | st.lists(row, min_size=1, max_size=40)
        case "train":
            return st.lists(st.tuples(st.floats(0.1, 100.0), st.integers(0, 9)), max_size=30).map(sorted)
        case "graded_train":
            row = st.tuples(st.floats(0.1, 100.0), st.integers(0, 9), st.integers(-(2**31) + 1, 2**31 - 1))
            return st.lists(row, max_size=30).map(sorted)
        case "codes":
            return st.sampled_from(CODES)
        case "choice":
            chosen = profile() if q.choice is Profile else mask()
            return chosen | numbers(q) if q.at_least is not None else chosen
        case "part":
            return words(q.part, names).map(q.part.from_words)
        case _:
            return st.sampled_from(names["signal" if "signal" in q.doc else "population"])


def words(cls, names):
    """Some of the parameters of a choice, and all that it needs."""
    quantities = {w: q for w, q in cls.quantities().items() if q.kind != "name" or names[_kind(q)]}
    quantities = {word: q for word, q in quantities.items() if q.kind not in ("file", "events") and word != "crop"}
    strategies = {word: values(q, names) for word, q in quantities.items()}
    needed = {word: s for word, s in strategies.items() if word not in cls.defaults()}
    rest = {word: s for word, s in strategies.items() if word in cls.defaults()}
    return st.fixed_dictionaries(needed, optional=rest)


def _kind(q):
    return "signal" if "signal" in q.doc else "population"


def profile():
    return st.sampled_from(list(PROFILES)).flatmap(lambda name: choices(PROFILES[name], {}))


def mask():
    corners = st.just(neuro.rectangular(lower_left=[-1.0, 0.0], upper_right=[1.0, 0.5]))
    return corners | choices(MASKS["circular"], {})


def distribution(name):
    return choices(DISTRIBUTIONS[name], {})


@st.composite
def choices(draw, cls, names):
    """A choice with parameters that fit each other."""
    said = draw(words(cls, names))
    if cls is neuro.pairs:
        ids = draw(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99)), max_size=3))
        ids = ids * draw(st.sampled_from([1, 40]))
        said = {"pre": [pre for pre, _ in ids], "post": [post for _, post in ids]}
    if "signal" in said or "tau_n" not in cls.quantities():
        said.pop("dopamine", None)
    if cls is neuro.event_camera:
        for word in ("offset", "origin", "sensor"):
            said.pop(word, None)
        streamed = {"stream": "udp://127.0.0.1:3333", "format": "spif", "sensor": [9, 7]}
        said |= draw(st.sampled_from([{}, streamed]))
    if cls is neuro.encode:
        said["values"] = draw(st.floats(0.5, 1.0) | arrays(st.floats(0.5, 1.0)))
    if cls is neuro.loihi2_ternary_lif:
        said["vth_lo"], said["vth_hi"] = sorted(draw(st.tuples(*[st.integers(-131071, 131071)] * 2)))
    if cls in (neuro.loihi_learning, neuro.loihi2_learning):
        said = {"dw": draw(st.sampled_from(["2^-2*x1*y0", "2^-2*x0*y0 - 2^-3*x0*w"])), "x1_impulse": 16, "x1_tau": 9}
    if said.get("padding") == "same":
        said.pop("column_padding", None)
    if cls is neuro.from_file:
        signed = {"transmitter": "nt", "signs": {"GABA": -1, "a, b": 1}, "where": ["n >= 5", "x*2 < 3"]}
        said = {**draw(st.sampled_from([signed, {"where": "n > 0"}, {}])), "shuffle_seed": draw(st.integers(0, 9))}
    ordered = ("low", "high"), ("Wmin", "Wmax"), ("d_min", "d_max"), ("tau_s", "tau_m"), ("tau_rise", "tau_kappa")
    for low, high in ordered:
        if {low, high} <= set(cls.quantities()):
            said.pop(low, None)
            said[high] = draw(st.floats(100.0, 1e6))
    if {"start", "stop"} <= set(said):
        said["start"], said["stop"] = sorted((said["start"], said["stop"]))
    return cls.from_words(said)


@st.composite
def networks(draw):
    """Networks over all models, rules, synapses, distributions and sections."""
    net = neuro.Network(draw(NAMES), resolution=draw(st.floats(1e-3, 10.0)))
    names = {"population": [], "signal": []}
    for name in draw(st.lists(NAMES, min_size=1, max_size=3, unique=True)):
        model = draw(choices(MODELS[draw(st.sampled_from(list(MODELS)))], names))
        shape = draw(st.lists(st.integers(1, 99) | st.just("auto"), min_size=1, max_size=3))
        states = {s.name: values(s.quantity(), names) for s in model.states if not s.hidden}
        initial = draw(st.fixed_dictionaries({}, optional=states))
        net.population(name, shape, model, initial=initial)
    names["population"] = list(net.populations)
    population = st.sampled_from(names["population"])
    for name in draw(st.lists(NAMES, max_size=2, unique=True)):
        net.signal(name, to=draw(population))
    names["signal"] = list(net.signals)
    for name in draw(st.lists(NAMES, max_size=3, unique=True)):
        rule = draw(choices(RULES[draw(st.sampled_from(list(RULES)))], names))
        synapse = draw(choices(SYNAPSES[draw(st.sampled_from(list(SYNAPSES)))], names))
        weight = draw(values(neuro.model.parts.WEIGHT, names))
        delay = draw(values(neuro.model.parts.Projection.words["delay"], names))
        net.connect(draw(population), draw(population), rule, synapse, weight=weight, delay=delay, name=name)
    for name in draw(st.lists(NAMES, max_size=1)):
        net.group(name, draw(choices(draw(st.sampled_from(list(neuro.model.parts.GROUPS.values()))), names)))
    if draw(st.booleans()):
        net.trials(**draw(words(Trials, names)))
    for name in draw(st.lists(NAMES, max_size=2, unique=True)):
        record, every = draw(st.sampled_from(["spikes", "V_m"])), draw(st.none() | st.just(0.5))
        net.probe(name, draw(population), record, every=every)
    return net


def saved(folder, name):
    """The bytes of the files of a saved network."""
    return [path.read_bytes() for path in sorted(folder.glob(f"{name}.*"))]


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(net=networks())
def test_a_saved_network_loads_to_an_equal_one(tmp_path_factory, net):
    folder = tmp_path_factory.mktemp("net")
    net.save(folder / "net.yaml")
    loaded = neuro.load(folder / "net.yaml")
    assert loaded == net
    first = saved(folder, "net")
    loaded.save(folder / "net.yaml")
    assert saved(folder, "net") == first


def network():
    net = neuro.Network("follower", resolution=1.0)
    cells = net.population("cells", (4, 5), neuro.poisson_generator(rate=np.arange(0.0, 60.0, 3.0)))
    motors = net.population("motors", 2, neuro.iaf_psc_exp(V_th=-50.0), initial={"V_m": neuro.uniform(low=-70.0)})
    synapse = neuro.stdp_dopa(Wmax=3000.0, signal="reward")
    net.connect(cells, motors, neuro.all_to_all(), synapse, weight=np.full((20, 4), 0.1))
    net.connect(motors, motors, neuro.one_to_one(), weight=-1.0)
    net.signal("reward", to=motors)
    net.probe("v", motors, "V_m", every=5.0)
    return net


def test_the_text(folder, messages):
    network().save("net.yaml")
    messages({"the file": re.sub("digest [0-9a-f]{32}", "digest DIGITS", (folder / "net.yaml").read_text())})


def test_the_same_bytes_at_another_time(folder):
    network().save("net.yaml")
    first = saved(folder, "net")
    time.sleep(1.1)
    network().save("net.yaml")
    assert saved(folder, "net") == first
    assert sorted(os.listdir(folder)) == ["net.h5", "net.yaml"]


def test_arrays_move_with_the_network(folder):
    network().save("net.yaml")
    (folder / "other").mkdir()
    neuro.load("net.yaml").save("other/copy.yml")
    assert sorted(os.listdir("other")) == ["copy.h5", "copy.yml"]
    assert neuro.load("other/copy.yml") == network()


@pytest.mark.parametrize("stem", ["my net", "a$b", "x, y", "été", "a\\b", "new\nline", "q'\"", "-"])
def test_odd_names_of_files(folder, stem):
    network().save(f"{stem}.yaml")
    assert neuro.load(f"{stem}.yaml") == network()


def test_what_cannot_be_written(folder, messages):
    with h5py.File("mine.h5", "w") as file:
        file["precious"] = 1
    messages.of(lambda name: refused(network().save, name))
    with h5py.File("mine.h5") as file:
        assert list(file) == ["precious"]
    assert os.listdir(folder) == ["mine.h5"]


def test_values_without_bounds_stay(tmp_path):
    net = neuro.Network("bounds", resolution=1.0)
    net.population("cells", 3, neuro.iaf_psc_delta(V_min=[-math.inf, -80.0, -90.0]))
    net.save(tmp_path / "net.yaml")
    assert neuro.load(tmp_path / "net.yaml").populations["cells"].model.V_min.tolist() == [-math.inf, -80.0, -90.0]
