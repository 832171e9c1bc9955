"""SpiNNaker's plastic synapses come out as in the machine code of its released programs, bit for bit."""

import json
import shutil
import warnings

import numpy as np
import pytest

import neuro
from neuro.chips.spinnaker_rule import DOWN, PROGRAMS, UP, fixed_point, rule_of, table_of
from neuro.model.synapses import stdp, stdp_dopa, stdp_nn_restr, stdp_nn_symm, stdp_triplet, vogels_sprekeler
from neuro.testing.verify import verify
from neuro_chip.replay import replay
from neuro_models import path
from refused import refused
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


# whole networks against a twin in plain integers

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
}
STEPS = 400


def learner(synapse, seed, recurrent=False):
    """Noise onto delta neurons over synapses that learn, with drawn delays."""
    net = neuro.Network("learner", resolution=1.0)
    net.population("a", 12, neuro.spike_generator(spike_times=list(listed(seed))))
    net.population("b", 4, neuro.iaf_psc_delta(tau_m=15.0, t_ref=2.0, I_e=380.0, tau_minus=20.0))
    net.population("d", 2, neuro.spike_generator(spike_times=[[50.0, 51.0, 120.0, 300.0], [52.0, 200.0]]))
    net.signal("r", to="b")
    sign = -1.0 if isinstance(synapse, vogels_sprekeler) else 1.0
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
        taus |= {"x": synapse.tau_plus_triplet, "y": synapse.tau_minus_triplet}
    if rule.concentrations:
        taus |= {"c": synapse.tau_c, "d": synapse.tau_n}
    names = ("low", "high", "up", "down", "up3", "down3", "alpha")
    numbers = dict(zip(names, (int(value) for value in c[3:10]), strict=True))
    numbers |= {"gain": int(c[12]), "w_low": int(c[13]), "w_high": int(c[14])}
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
    for seed in range(3):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = neuro.compile(learner(synapse, seed, recurrent), "spinnaker", seed=seed)
            told = {150: 0.02, 230: -0.01, 231: 0.015}
            for at in (*told, STEPS):
                sim.run(at - sim.time)
                if name == "signal" and at in told:
                    sim.signal("r", told[at])
        rule, neurons, rows, synapses = twin_of(sim, synapse, timing, multiplicative)
        fired = {part: by_step(sim, part) for part in ("a", "b", "d")}
        unit = rule.concentrations[0] if rule.concentrations else 0
        scale = sim._engine.fixed.projections[0].n_scale
        for step in range(1, STEPS + 1):
            t = step - 1
            if name == "dopamine":
                for _ in fired["d"].get(step, ()):
                    for neuron in neurons:
                        neuron.append(t, unit)
            if name == "signal" and t in told:
                signal(neurons, t, told[t] / scale, unit)
            for j in fired["b"].get(step, ()):
                neurons[j].append(t)
            for i in fired["b" if recurrent else "a"].get(step, ()):
                rows[i].packet(t, neurons, rule.shift)
        sign = -1 if rule.inhibits else 1
        words = [sign * made[2] for made in synapses]
        assert sim._engine.synapse_registers(0, "weight").tolist() == words, (name, seed)
        assert sim._engine.synapse_registers(0, "t").tolist() == [made[3] for made in synapses]
        assert len({*words}) > 10


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
    assert any("as many as there are slots" in str(one.message) for one in heard) == lost
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
