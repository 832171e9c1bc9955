"""SpiNNaker's plastic synapses come out as in the machine code of its released programs, bit for bit."""

import json
import os
import shutil
import warnings

import numpy as np
import pytest

import neuro
import spinnaker_twin
from neuro.chips import chip, place, spinnaker_core
from neuro.chips.spinnaker_rule import DOWN, PROGRAMS, UP, fixed_point, rule_of, table_length, table_of
from neuro.model.synapses import (
    spinnaker_learning,
    static,
    stdp,
    stdp_dopa,
    stdp_nn_restr,
    stdp_nn_symm,
    stdp_triplet,
    vogels_sprekeler,
)
from neuro.testing.verify import verify
from neuro_chip.replay import replay
from neuro_models import path
from refused import refused, without_place
from spinnaker_twin import Neuron, Row, Rule

NAME = "spinnaker_learning"
KNOWN = {
    "known_neuromodulation": 10307 / 1024,
    "known_triplet_minus": 5312 / 16384,
    "known_triplet_plus": 9001 / 16384,
    "known_pair_additive": 5126 / 2048,
    "known_pair_multiplicative": 5136 / 2048,
    "known_nearest_additive": 5124 / 2048,
    "known_nearest_multiplicative": 5131 / 2048,
}
"""Last weights that public tests and descriptions state, some read from boards."""


@pytest.fixture(scope="module")
def folder(golden):
    return golden / "spinnaker-learning"


@pytest.fixture(scope="module")
def cases(folder):
    return {case["name"]: case for case in json.loads((folder / f"{NAME}.json").read_text())["cases"]}


@pytest.fixture(scope="module")
def arrays(folder):
    with np.load(folder / f"{NAME}.npz") as stored:
        return {name: stored[name] for name in stored.files}


def test_every_case_comes_out(folder, cases):
    results = verify(folder)
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []
    assert len({r.case for r in results}) == len(cases) == 80
    ran = {case["ran"]["released_program"].removeprefix("synapses_stdp_") for case in cases.values()}
    assert ran == {*PROGRAMS.values()}


IN_NETWORKS = (
    *("pair_additive_many_pre", "pair_multiplicative_random_delays", "nearest_additive_random_delays"),
    *("nearest_multiplicative_regular_dep", "triplet_additive_many_pre", "vogels_additive_random_delays"),
    *("recurrent_dual_fsm", "nm_reward", "known_neuromodulation_multiplicative", "nm_vogels_negative"),
)
"""A case for each program, whose packets are on time and of which the events of a tick are in the emulator's order."""
SAME = (
    *("A_plus", "A_minus", "A3_plus", "A3_minus", "alpha", "tau_plus", "tau_minus", "tau_x", "tau_y"),
    *("accumulator_depression", "accumulator_potentiation", "mean_pre_window", "mean_post_window"),
)
"""Words of a case that are those of the synapse."""
NONE = np.zeros(0, dtype=np.int64)


@pytest.mark.parametrize("name", IN_NETWORKS)
def test_every_program_comes_out_of_a_network(cases, arrays, name):
    case, events = cases[name], arrays[f"{name}__events"]
    sim, rule = played(case, events)
    assert rule.program == case["ran"]["released_program"].removeprefix("synapses_stdp_")
    post = [(k, j) for k, row in enumerate(case["rows"]) if row["kind"] == "stdp" for j in row["post"]]
    order = sorted(range(len(post)), key=post.__getitem__)
    for register, what in (("weight", "weights"), ("t", "eligibility")):
        if f"{name}__{what}" in arrays:
            words = sim._engine.synapse_registers(0, register) & 65535
            np.testing.assert_array_equal(words, arrays[f"{name}__{what}"][-1][order])


def played(case, events):
    """Run the events of a case as a network of `spinnaker_lif`, which fire in each tick in which nothing inhibits."""
    params, rows, n, shift, h = case["params"], case["rows"], case["n_post"], case["shifts"][0], case["params"]["dt"]
    plastic, unit, end = [row for row in rows if row["kind"] == "stdp"], 2.0 ** (15 - shift), int(events[-1, 2]) + 2

    def ticks(spike, k):
        return events[(events[:, 0] == spike) & (events[:, 1] == k), 2]

    def trains(steps):
        return neuro.spike_generator(spike_times=[(each * h).tolist() for each in steps])

    net = neuro.Network("case", resolution=h)
    net.population("a", len(plastic), trains([ticks(0, k) + 1 for k in range(len(plastic))]))
    net.population("quiet", n, trains([np.setdiff1d(np.arange(1, end), ticks(1, j)) for j in range(n)]))
    milli = {"v_init": -3000, "v_reset": -1000, "v_rest": 0, "v_thresh": -500, "i_offset": 1000}
    registers = {word: value << 15 for word, value in milli.items()} | {"r_m": 32768, "exp_tc": 16384, "t_refract": 0}
    decays = {"inh_decay": 0, "exc_decay": 0, "inh_init": 2**32 - 1, "exc_shift": shift, "inh_shift": 15}
    net.population("b", n, neuro.spinnaker_lif(**registers, **decays))
    numbers = {word: params[word] for word in SAME if word in params}
    numbers |= {"tau_plus": params["tau"]} if "tau" in params else {}
    if params["weight_dependence"] == "additive" and params["rule"] != "triplet":
        numbers |= {word: numbers[word] / params["w_max"] for word in ("A_plus", "A_minus")}
    bounds = {"Wmin": params["w_min"] * unit, "Wmax": params["w_max"] * unit}
    if taught := params.get("neuromodulation"):
        bounds = {"c_min": bounds["Wmin"], "c_max": bounds["Wmax"]}
        bounds |= {"Wmin": taught["w_min"] * unit, "Wmax": taught["w_max"] * unit}
        net.population("d", 1, trains([ticks(0, len(plastic)) + 1]))
        numbers |= {"dopamine": "d", "concentration": rows[-1]["concentration"][0]}
        numbers |= {"tau_c": taught["tau_c"], "tau_n": taught["tau_d"]}
    synapse = spinnaker_learning(timing=params["rule"], dependence=params["weight_dependence"], **numbers, **bounds)
    columns = {word: np.concatenate([row[word] for row in plastic]) for word in ("post", "w0", "delay")}
    pre = np.repeat(np.arange(len(plastic)), [len(row["post"]) for row in plastic])
    place = {"weight": np.rint(columns["w0"] * unit), "delay": columns["delay"] * h}
    net.connect("a", "b", neuro.pairs(pre=pre, post=columns["post"]), synapse, **place, name="ab")
    net.connect("quiet", "b", neuro.one_to_one(), weight=-2001.0, delay=h)
    net.connect("quiet", "b", neuro.one_to_one(), weight=0.0, delay=h * ((1 << case["delay_bits"]) - 1), name="slots")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "spinnaker")
        sim.run(end * h)
    times, ids = sim.spikes("b")
    for j in range(n):
        np.testing.assert_array_equal(np.rint(times[ids == j] / h) - 1, ticks(1, j))
    return sim, sim._engine.fixed.projections[0].rule


def test_known_numbers(cases, arrays):
    for name, weight in KNOWN.items():
        found = replay(cases[name], arrays[f"{name}__events"])["weights"]
        assert found[-1, 0] * cases[name]["weight_unit"][0] == weight, name


@pytest.mark.parametrize("quantity", ["weights", "eligibility", "pre", "post", "marks", "counters"])
def test_one_altered_bit_is_found(folder, cases, tmp_path, quantity, arrays):
    case = cases["nm_both"]
    key = f"nm_both__{quantity}"
    altered = arrays | {key: arrays[key].copy()}
    altered[key].flat[-1] ^= 1
    (tmp_path / f"{NAME}.json").write_text(json.dumps({"cases": [case]}))
    np.savez(tmp_path / f"{NAME}.npz", **altered)
    assert [r.quantity for r in verify(tmp_path) if not r.ok] == [quantity]


def test_a_packet_at_another_tick_is_found(cases, arrays):
    events = arrays["nm_both__events"].copy()
    events[np.flatnonzero(events[:, 0] == 0)[5], 2] += 1
    assert not np.array_equal(replay(cases["nm_both"], events)["weights"], arrays["nm_both__weights"])


def test_other_backends_say_so(folder, tmp_path, messages):
    for suffix in (".json", ".npz"):
        shutil.copy(folder / f"{NAME}{suffix}", tmp_path)
    messages({backend: verify(tmp_path, backend)[0].message for backend in ("event", "loihi")})


def test_constants_and_tables():
    assert [fixed_point(value) for value in (1.0, 0.01, -0.5, 2.5 / 32768, 1e-9)] == [32768, 328, -16384, 2, 0]
    lengths = {(5, 0, 1.0): 40, (20, 0, 1.0): 154, (1000, 0, 1.0): 7626, (20, 0, 0.1): 1526, (101, 2, 1.0): 194}
    lengths |= {(200, 2, 1.0): 382, (200, 2, 0.1): 3814, (1000, 4, 1.0): 478, (1000, 4, 0.1): 4766}
    for (tau, shift, dt), length in lengths.items():
        table = table_of(tau, dt, shift)
        assert (table.size, table[0]) == (length, 2048)


def test_what_no_program_does_is_refused(messages):
    numbers = dict.fromkeys(("w_min", "A_plus", "A_minus"), 0.0) | dict.fromkeys(
        ("w_max", "tau_plus", "tau_minus"), 1.0
    )
    taught = {"tau_c": 1000.0, "tau_d": 200.0, "w_min": 0.0, "w_max": 1.0}
    messages(
        {
            "triplet": refused(rule_of, "triplet", "multiplicative", numbers, dt=1.0),
            "nearest": refused(rule_of, "nearest", "additive", numbers, dt=1.0, neuromodulation=taught),
            "table": refused(rule_of, "pair", "additive", numbers | {"tau_plus": 9000.0}, dt=1.0),
        }
    )


def test_a_program_that_is_not_there_is_refused(messages):
    def told(backend="spinnaker", **words):
        return without_place(lambda: neuro.compile(learner(spinnaker_learning(Wmax=6.0, **words), 1), backend))

    messages(
        {
            "no program": told(timing="triplet", dependence="multiplicative"),
            "no program with dopamine": told(timing="nearest", dopamine="d"),
            "no unit of dopamine": told(dopamine="d", concentration=1e-5),
            "bounds": told(Wmin=8.0),
            "float": told("event"),
            "another chip": told("loihi"),
        }
    )


# whole networks against a twin in plain integers

NEAR = {"Wmax": 6.0, "A_plus": 0.05, "A_minus": 0.03}
RULES = {
    "pair, additive": (stdp(mu_plus=0.0, mu_minus=0.0, lambda_=0.05, Wmax=6.0), "pair", False),
    "pair, multiplicative": (stdp(lambda_=0.05, alpha=1.3, Wmax=6.0), "pair", True),
    "nearest, additive": (stdp_nn_symm(mu_plus=0.0, mu_minus=0.0, lambda_=0.05, Wmax=6.0), "nearest", False),
    "nearest, multiplicative": (stdp_nn_restr(lambda_=0.05, Wmax=6.0, pre_at_start=True), "nearest", True),
    "triplet": (
        stdp_triplet(Aplus=0.02, Aplus_triplet=0.1, Aminus=0.05, Aminus_triplet=0.01, Wmax=6.0),
        "triplet",
        False,
    ),
    "vogels": (vogels_sprekeler(eta=0.02, Wmax=-6.0, alpha=0.9), "vogels", False),
    "dopamine": (stdp_dopa(dopamine="d", A_plus=0.02, A_minus=0.005, c_min=0.0, Wmax=6.0, tau_n=50.0), "pair", False),
    "signal": (stdp_dopa(signal="r", A_plus=0.02, A_minus=0.005, c_min=0.0, Wmax=6.0, tau_n=50.0), "pair", False),
    "recurrent": (
        spinnaker_learning(
            timing="recurrent",
            dependence="multiplicative",
            accumulator_potentiation=2,
            accumulator_depression=-2,
            **NEAR,
        ),
        "recurrent",
        True,
    ),
    "dopamine, multiplicative": (
        spinnaker_learning(dependence="multiplicative", dopamine="d", c_max=3.0, tau_n=50.0, **NEAR),
        "pair",
        True,
    ),
    "signal, multiplicative": (
        spinnaker_learning(dependence="multiplicative", signal="r", c_max=3.0, tau_n=50.0, **NEAR),
        "pair",
        True,
    ),
    "dopamine, vogels": (
        spinnaker_learning(
            timing="vogels",
            dopamine="d",
            alpha=0.0,
            concentration=-0.001,
            tau_n=50.0,
            c_max=3.0,
            **NEAR | {"Wmax": -6.0},
        ),
        "vogels",
        False,
    ),
}
STEPS = 400


def learner(synapse, seed, recurrent=False):
    """Noise onto delta neurons over synapses that learn, with drawn delays."""
    net = neuro.Network("learner", resolution=1.0)
    net.population("a", 12, neuro.spike_generator(spike_times=list(listed(seed))))
    net.population("b", 4, neuro.iaf_psc_delta(tau_m=15.0, t_ref=2.0, I_e=380.0, tau_minus=20.0))
    net.population("d", 2, neuro.spike_generator(spike_times=[[50.0, 51.0, 120.0, 300.0], [52.0, 200.0]]))
    net.signal("r", to="b")
    sign = np.sign(synapse.Wmax)
    source = "b" if recurrent else "a"
    weight = neuro.uniform(low=min(sign * 1.0, sign * 4.0), high=max(sign * 1.0, sign * 4.0))
    net.connect(
        source, "b", neuro.all_to_all(), synapse, weight=weight, delay=neuro.uniform(low=1.0, high=7.4), name="ab"
    )
    if recurrent:
        net.connect("a", "b", neuro.all_to_all(), weight=4.0, delay=1.0)
    return net


def listed(seed):
    rng = np.random.default_rng(seed)
    for _ in range(12):
        yield np.unique(rng.integers(2, STEPS, size=25)).astype(float).tolist()


def twin_of(sim, synapse, timing, multiplicative):
    """What the twin makes of the recorded spikes: words, and what each neuron was sent at each tick."""
    wires = sim._engine.fixed.projections[0]
    rule = wires.rule
    c = rule.constants
    taus = {"plus": getattr(synapse, "tau_plus", 20.0), "minus": 20.0}
    if timing == "triplet":
        slow = ("tau_x", "tau_y") if synapse.chip else ("tau_plus_triplet", "tau_minus_triplet")
        taus |= {name: getattr(synapse, word) for name, word in zip("xy", slow, strict=True)}
    if timing == "recurrent":
        taus = {"plus": synapse.mean_pre_window, "minus": synapse.mean_post_window}
    if rule.concentrations:
        taus |= {"c": synapse.tau_c, "d": synapse.tau_n}
    names = ("low", "high", "up", "down", "up3", "down3", "alpha", "least", "most", "gain", "w_low", "w_high")
    numbers = dict(zip(names, (int(value) for value in c[3:15]), strict=True))
    twin = Rule(timing, multiplicative, taus, **numbers)
    pre, post = sim.program.connections(0)
    delays = np.broadcast_to(wires.delay, pre.size) % rule.slots
    words = abs(np.broadcast_to(wires.mantissas, pre.size))
    n_source = sim.program.populations[sim.program.projections[0].source].size
    rows = [Row(twin, []) for _ in range(n_source)]
    synapses = [[int(j), int(d), int(w), 0] for j, d, w in zip(post, delays, words, strict=True)]
    for i, made in zip(pre, synapses, strict=True):
        rows[i].synapses.append(made)
    return rule, [Neuron(twin) for _ in range(4)], rows, synapses


@pytest.mark.parametrize("recurrent", [False, True])
@pytest.mark.parametrize("name", RULES)
def test_networks_learn_as_their_twin(name, recurrent):
    synapse, timing, multiplicative = RULES[name]
    by_signal = getattr(synapse, "signal", None) is not None
    for seed in range(3):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = neuro.compile(learner(synapse, seed, recurrent), "spinnaker", seed=seed)
            told = {150: 0.02, 230: -0.01, 231: 0.015}
            for at in (*told, STEPS):
                sim.run(at - sim.time)
                if by_signal and at in told:
                    sim.signal("r", told[at])
        rule, neurons, rows, synapses = twin_of(sim, synapse, timing, multiplicative)
        fired = {part: by_step(sim, part) for part in ("a", "b", "d")}
        unit = rule.concentrations[0] if rule.concentrations else 0
        scale = sim._engine.fixed.projections[0].n_scale
        for step in range(1, STEPS + 1):
            t = step - 1
            if getattr(synapse, "dopamine", None):
                for _ in fired["d"].get(step, ()):
                    for neuron in neurons:
                        neuron.append(t, unit)
            if by_signal and t in told:
                signal(neurons, t, told[t] / scale, unit)
            for j in fired["b"].get(step, ()):
                neurons[j].append(t)
            for i in fired["b" if recurrent else "a"].get(step, ()):
                rows[i].packet(t, neurons, rule.shift)
        sign = -1 if rule.inhibits else 1
        words = [sign * made[2] for made in synapses]
        assert sim._engine.synapse_registers(0, "weight").tolist() == words, (name, seed)
        assert sim._engine.synapse_registers(0, "t").tolist() == [made[3] for made in synapses]
        assert len({*words}) > 4


def signal(neurons, t, wanted, unit):
    for neuron in neurons:
        then, *_, level = neuron.entries[-1]
        missing = round((wanted - (level * neuron.rule.d(t - then) >> 11)) / unit)
        for bit in range(5):
            if min(abs(missing), 31) >> bit & 1:
                neuron.append(t, (unit << bit) * (1 if missing > 0 else -1))


def test_dopamine_of_both_signs_does_not_lower_all_weights():
    net = neuro.load(path("drone"), params={"c_min": 0.0, "delay": 2.0, "eta": 0.4, "tau_c": 50.0})
    net.world_section = None
    with warnings.catch_warnings(action="ignore"):
        sim = neuro.compile(net, "spinnaker", seed=1, shifts={"motors": (2, 0)}, signals={"cells_motors": 0.1})
    cells = [27, 28, 35, 36]  # those that see a ball in the middle
    sim.set("cells", {"rate": 100.0 * np.isin(np.arange(64), cells)})
    for right, down in np.random.default_rng(0).normal(0.0, 0.004, (60, 2)):
        sim.signal("dopamine", [right, -right, down, -down])
        sim.run(50.0)
    learnt = np.reshape(sim.weights("cells_motors")[2], (64, 4))[cells]
    assert learnt.std() > 20.0
    assert learnt.mean() > 1440.0  # 1371 if a signal takes only the root of what it shares with the eligibility


def by_step(sim, part):
    found = {}
    for time, i in zip(*sim.spikes(part), strict=True):
        found.setdefault(round(time), []).append(int(i))
    return {step: sorted(ids) for step, ids in found.items()}


NETWORKS = int(os.environ.get("NEURO_LEARNING_NETWORKS", "32"))


@pytest.mark.parametrize("seed", range(NETWORKS))
def test_random_networks_learn_as_their_twin(seed):
    net, told = spinnaker_twin.network(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "spinnaker", seed=seed, signals={"ab": 0.03} if told else {})
        twin = spinnaker_twin.Learning(net, sim.program, sim._engine.fixed)
        for k in range(1, spinnaker_twin.STEPS + 1):
            sim.run(1.0)
            fired = twin.step(k)
            times, ids = sim.spikes("b")
            assert ids[times == k].tolist() == fired["b"], k
            sign = -1 if twin.rule.inhibits else 1
            assert sim._engine.synapse_registers(0, "weight").tolist() == [sign * made[2] for made in twin.synapses], k
            assert sim._engine.synapse_registers(0, "t").tolist() == [made[3] for made in twin.synapses], k
            if k in told:
                sim.signal("r", told[k])
                twin.signal(k, told[k])


# what a run does with it

TAUGHT = RULES["signal"][0]


@pytest.fixture
def started():
    def start(synapse=TAUGHT, seed=1, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return neuro.compile(learner(synapse, seed), "spinnaker", seed=seed, **options)

    return start


def steered(sim, *ends):
    """Run to some times; a signal is set at two of them."""
    for end in ends:
        sim.run(end - sim.time)
        if end in (150.0, 230.0):
            sim.signal("r", 0.03 if end == 150.0 else -0.01)
    return sim.weights("ab")[2], sim.get("ab", "c"), sim.get("ab", "n"), sim.get("ab", "K_plus")


def test_a_run_goes_on_from_a_state_and_begins_anew(started, tmp_path):
    whole = steered(started(), 150.0, 230.0, 400.0)
    assert np.unique(whole[0]).size > 10
    assert whole[1].max() > 0.0 > whole[2].min()
    assert whole[3].max() > 0.0
    sim = started()
    steered(sim, 60.0, 150.0, 200.0)
    sim.save(tmp_path / "state.h5")
    other = started()
    other.restore(tmp_path / "state.h5")
    for one in (other, sim):
        for found, expected in zip(steered(one, 230.0, 231.0, 400.0), whole, strict=True):
            np.testing.assert_array_equal(found, expected)
    sim.reset(weights=True)
    for found, expected in zip(steered(sim, 150.0, 230.0, 400.0), whole, strict=True):
        np.testing.assert_array_equal(found, expected)
    assert {name.split(" in ")[0] for name in sim.counts().native} >= {"rules applied", "spikes of sources for signals"}


def test_written_weights_are_sent_and_learnt_from(started):
    sim = started(RULES["pair, additive"][0])
    sim.set_weights("ab", np.full(48, 2.0))
    np.testing.assert_array_equal(sim.weights("ab")[2], 2.0)
    sim.run(200.0)
    assert np.unique(sim.weights("ab")[2]).size > 10


@pytest.mark.parametrize("delay", [1.0, 2.0, 3.0])
def test_a_delay_of_all_slots_learns_and_sends_nothing(delay):
    """Slots are 2 for delays of 1 and 2, 4 for those of 3."""
    net = neuro.Network("slots", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[[10.0, 30.0, 50.0]]))
    net.population("b", 1, neuro.iaf_psc_delta(V_th=-69.0, tau_minus=20.0))
    net.population("c", 1, neuro.spike_generator(spike_times=[[12.0, 33.0]]))
    net.connect("c", "b", neuro.all_to_all(), weight=9.0, delay=1.0)
    net.connect("a", "b", neuro.all_to_all(), stdp(Wmax=8.0, lambda_=0.1), weight=4.0, delay=delay, name="ab")
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        sim = neuro.compile(net, "spinnaker")
    sim.run(60.0)
    lost = delay == 2.0
    assert any("the number of slots" in str(one.message) for one in heard) == lost
    assert sim.counts().native.get("undelivered synapses in ab", 0) == (3 if lost else 0)
    assert (10.0 + delay in sim.spikes("b")[0]) != lost
    assert sim.weights("ab")[2][0] != 4.0


def test_learning_is_near_event_where_units_are_fine():
    """A packet takes up to one unit, 2^-8 mV, and there are four for each synapse."""
    for name, near in (("pair, additive", 0.02), ("pair, multiplicative", 0.02), ("triplet", 0.03), ("dopamine", 0.05)):
        synapse = RULES[name][0]
        learnt = {}
        for backend in ("event", "spinnaker"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                sim = neuro.compile(sparse(synapse), backend)
            sim.run(1000.0)
            learnt[backend] = sim.weights("ab")[2] - 3.0
        scale = abs(learnt["event"]).max()
        assert scale > 0.01
        np.testing.assert_allclose(
            learnt["spinnaker"], learnt["event"], rtol=0, atol=near * scale + 0.016, err_msg=name
        )


def sparse(synapse):
    """Eight synapses onto a neuron that spikes when it is told to."""
    net = neuro.Network("sparse", resolution=1.0)
    times = [[101.0 + 8 * k, 332.0 - 5 * k, 520.0, 900.0] for k in range(8)]
    net.population("a", 8, neuro.spike_generator(spike_times=times))
    net.population("c", 1, neuro.spike_generator(spike_times=[[110.0, 320.0, 525.0]]))
    net.population("b", 1, neuro.iaf_psc_delta(tau_minus=20.0, V_th=0.0))
    net.population("d", 1, neuro.spike_generator(spike_times=[[350.0]]))
    net.connect("c", "b", neuro.all_to_all(), weight=200.0, delay=1.0)
    net.connect("a", "b", neuro.all_to_all(), synapse, weight=3.0, delay=3.0, name="ab")
    return net


def test_each_of_two_packets_of_a_step_sends_its_own_word():
    net = neuro.Network("double", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[[5.0, 20.0, 20.0, 20.0]]))
    net.population("c", 1, neuro.spike_generator(spike_times=[[15.0]]))
    net.population("b", 1, neuro.iaf_psc_delta(V_th=-40.0, t_ref=0.0, tau_m=np.inf, tau_minus=20.0))
    net.connect("c", "b", neuro.all_to_all(), weight=40.0, delay=1.0)
    net.connect("a", "b", neuro.all_to_all(), stdp(lambda_=0.2, Wmax=8.0), weight=4.0, delay=3.0, name="ab")
    net.probe("v", "b", "V_m")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "spinnaker")
    words = []
    part = sim._engine._machine.learners._parts[1]
    packets = part.packets
    part.packets = lambda ids, tick: (packets(ids, tick), words.extend(part.weights.tolist() * len(ids)))
    sim.run(30.0)
    assert len({*words[1:]}) == 3
    unit = 2.0 ** (part.rule.shift - 15)
    v = sim.trace("v")[1][:, 0]
    assert v[22] - v[21] == pytest.approx(sum(words[1:]) * unit, abs=1e-3)


def test_the_spikes_that_bring_a_signal_are_priced(started):
    sim = started()
    steered(sim, 150.0, 230.0, 400.0)
    (sent,) = (n for name, n in sim.counts().native.items() if name.startswith("spikes of sources for signals"))
    lines = {(item.what, item.of): item for item in sim.energy("spinnaker").items}
    assert lines["packet", "r"].count == lines["synaptic_op", "r"].count == sent > 0
    assert lines["packet", "r"].joules == sent * 0.8e-9
    assert lines["learning_update", "ab"].joules_each is None


def test_a_file_of_results_has_what_only_the_chip_counts(started, tmp_path):
    sim = started()
    with sim.record_to(tmp_path / "run.h5"):
        steered(sim, 150.0, 230.0, 400.0)
    left = neuro.results.read(tmp_path / "run.h5")
    assert left.counts() == sim.counts()
    assert left.energy("spinnaker").items == sim.energy("spinnaker").items


@pytest.mark.parametrize(("model", "extra"), [("iaf_psc_exp", 1), ("iaf_psc_delta", 0)])
def test_amplitudes_make_up_for_a_longer_delay_register(model, extra):
    net = neuro.Network("windows", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("b", 1, getattr(neuro, model)(tau_minus=10.0))
    net.connect("a", "b", neuro.all_to_all(), stdp(lambda_=0.5, Wmax=8.0, tau_plus=20.0), weight=4.0, delay=4.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "spinnaker")
    wires = sim._engine.fixed.projections[0]
    assert wires.delay.tolist() == [4 + extra]
    assert wires.rule.constants[UP] / 16384 == pytest.approx(np.exp(extra / 20.0), abs=1e-4)
    assert wires.rule.constants[DOWN] / 16384 == pytest.approx(np.exp(-extra / 10.0), abs=1e-4)


# limits of a core


def layer(synapse, neurons, weight=300.0):
    net = neuro.Network("layer", resolution=1.0)
    net.population("a", 20, neuro.poisson_generator(rate=20.0))
    net.population("d", 1, neuro.poisson_generator(rate=5.0))
    net.population("b", neurons, neuro.iaf_psc_exp(tau_minus=20.0))
    net.connect("a", "b", neuro.all_to_all(), synapse, weight=weight, delay=15.0, name="ab")
    return net


@pytest.mark.parametrize("kind", spinnaker_core.KNOWN)
def test_tables_of_a_core_are_as_long_as_those_of_the_rule(kind):
    weights = {"Wmax": -900.0} if kind is vogels_sprekeler else {"Wmax": 900.0}
    numbers = {
        "mu_plus": 0.0,
        "mu_minus": 0.0,
        "pre_at_start": True,
        "c_min": 0.0,
        "dopamine": "d",
        "A_plus": 20.0,
        "eta": 1.0,
    }
    numbers |= weights | {f"A{side}": 10.0 for side in ("plus", "minus")}
    synapse = kind(**{name: value for name, value in numbers.items() if hasattr(kind, name)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(layer(synapse, 3, weights["Wmax"] / 3), "spinnaker")
    rule = sim._engine.fixed.projections[0].rule
    lengths = [table_length(tau, 1.0, shift) for tau, shift in spinnaker_core._tables(synapse, 20.0)]
    assert sum(lengths) == rule.table.size
    assert len(lengths) == np.count_nonzero(rule.places[:, 1])
    assert spinnaker_core.slots_of(sim.program, chip("spinnaker"), 2) == rule.slots


def test_a_population_is_split_where_its_histories_fill_a_core():
    """A history of a pair rule has 100 bytes, and with dopamine 136, as in the released programs."""
    machine = chip("spinnaker")
    for synapse, history in ((stdp(Wmax=900.0), 100), (stdp_dopa(dopamine="d", Wmax=900.0), 136)):
        program = neuro.compile(layer(synapse, 300), "event").program
        least, more = (spinnaker_core.bytes_of(program, machine, 2, n) for n in (202, 204))
        of_rows = 2 * 2 * (4 if history == 100 else 6)  # in two buffers
        assert more - least == 2 * (history + 60) + of_rows
        placement = place(program, machine)
        cores = [core for core in placement.cores if core.parts[0][0] == 2]
        assert len(cores) == 2
        assert 128 < cores[0].neurons < 256
        assert max(core.own_bytes for core in cores) <= 59756
        assert spinnaker_core.bytes_of(program, machine, 2, max(core.neurons for core in cores) + 1) > 59756
        assert f"learning needs up to {cores[0].own_bytes:,} of the 59,756 bytes of a core's own memory" in str(
            placement
        )
    assert place(neuro.compile(layer(static(), 300), "event").program, machine).cores[0].own_bytes == 0


def test_what_fits_on_no_core_is_refused(messages):
    net = layer(stdp(mu_plus=0.0, mu_minus=0.0, Wmax=900.0, lambda_=0.1, tau_plus=4000.0), 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        messages({"memory of a core": refused(neuro.compile, net, "spinnaker")})


def test_cycles_of_learning(started):
    """Each packet visits its synapses, each post spike is applied to all of them."""
    sim = started(RULES["pair, additive"][0])
    sim.run(400.0)
    program = sim.program
    assert spinnaker_core.busiest(program, [[(1, 0, 4)], [(0, 0, 12)]], {0: (3.0, 2.0)}) == 3 * 170 + 2 * 44
    assert spinnaker_core.busiest(program, [[(1, 0, 1)], [(1, 1, 4)]], {0: (3.0, 2.0)}) == 0.75 * (3 * 170 + 2 * 44)
    spikes = [sim.spikes(name)[0].size for name in "ab"]
    cycles = (spikes[0] * 4 * 170 + spikes[1] * 12 * 44) / 400
    (note,) = (note for note in sim.energy("spinnaker").notes if "cycles of a tick" in note)
    assert note == f"learning needs > {cycles:,.0f} of the 200,000 cycles of a tick on the busiest core on average"
    (note,) = place(neuro.compile(layer(stdp(Wmax=900.0), 100), "event").program, chip("spinnaker")).notes[1:]
    assert note.endswith("if all sources and targets spike once in a tick: slower than real time")
    assert f"> {20 * 100 * (170 + 44):,} of the 200,000" in note


def test_programs_in_trials_and_on_grids_are_refused():
    def net(synapse, rule, shape):
        net = neuro.Network("n", resolution=1.0)
        net.population("a", shape, neuro.spike_generator())
        net.population("b", (2, 1, 1), neuro.iaf_psc_delta())
        net.connect("a", "b", rule, synapse, weight=5.0, delay=1.0)
        return net

    in_trials = net(spinnaker_learning(Wmax=6.0), neuro.all_to_all(), 4)
    in_trials.group("choice", neuro.winner_take_all(of="b"))
    in_trials.trials(input="a", duration=20.0)
    assert "spinnaker_learning in a network with trials" in refused(neuro.compile, in_trials, "spinnaker")
    on_grid = net(spinnaker_learning(Wmax=6.0), neuro.grid(kernel=2), (1, 2, 2))
    assert "a shared kernel that learns" in refused(neuro.compile, on_grid, "spinnaker")


@pytest.mark.parametrize(
    ("rule", "program"),
    [
        (stdp(mu_plus=0.0, mu_minus=0.0, Wmax=6.0), spinnaker_learning(Wmax=6.0)),
        (
            stdp_dopa(signal="r", A_plus=0.02, A_minus=0.005, c_min=0.0, Wmax=6.0, tau_n=50.0),
            spinnaker_learning(signal="r", Wmax=6.0, tau_n=50.0),
        ),
    ],
)
def test_a_program_takes_the_memory_and_the_cycles_of_its_rule(rule, program):
    def cores(synapse):
        net = neuro.Network("n", resolution=1.0)
        net.population("a", 100, neuro.spike_generator())
        net.population("b", 256, neuro.iaf_psc_delta(tau_minus=20.0))
        net.signal("r", to="b")
        net.connect("a", "b", neuro.all_to_all(), synapse, weight=5.0, delay=14.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = neuro.compile(net, "spinnaker")
        placement = place(sim.program, chip("spinnaker"))
        parts = [core.parts for core in placement.cores]
        told = [*spinnaker_core.learning_notes(sim.program, chip("spinnaker"), parts, None)]
        return parts, told, sum(core.synapse_bytes for core in placement.cores)

    assert cores(program)[0] == cores(rule)[0]
    assert cores(program)[2] == cores(rule)[2]
    assert cores(program)[1][-1] == cores(rule)[1][-1]
