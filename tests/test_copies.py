"""Copies of a network, run and steered in one call, beside simulations of their own: the same bits."""

import numpy as np
import pytest

import neuro
from refused import refused

N = 3
TAUGHT = {"error": "critic", "error_of_actor": "actor", "reward": "motors"}


def loop(noisy=True):
    """Sensors that drive motors over synapses that learn by dopamine, with noise of their own."""
    net = neuro.Network("loop", resolution=1.0)
    sensors = net.population("sensors", 20, neuro.poisson_generator(rate=30.0))
    motors = net.population("motors", (2, 3), neuro.iaf_psc_exp(tau_m=10.0))
    net.signal("reward", to=motors)
    rule = neuro.stdp_dopa(signal="reward", Wmax=1200.0)
    weight = neuro.uniform(low=300.0, high=900.0)
    net.connect(sensors, motors, neuro.pairwise_bernoulli(0.7), rule, weight=weight, delay=1.0, name="learnt")
    if noisy:
        net.connect(net.population("noise", 6, neuro.poisson_generator(rate=200.0)), motors, neuro.one_to_one(),
                    weight=200.0, delay=2.0)  # fmt: skip
    return net


def agent():
    net = neuro.Network("agent", resolution=1.0)
    places = net.population("places", 8, neuro.spike_generator())
    actor = net.population("actor", 2, neuro.pp_psc_delta(c_2=100.0))
    net.signal("error", to=actor)
    rule = neuro.reinforce(signal="error", eta=1.0)
    net.connect(places, actor, neuro.all_to_all(), rule, weight=0.5, delay=1.0, name="policy")
    return net


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_copies_are_simulations_of_their_seeds(backend):
    copies = neuro.compile(loop(), backend, seed=5, copies=N)
    alone = [neuro.compile(loop(), backend, seed=5 + k) for k in range(N)]
    rate, counts, reward = copies.port("sensors", "rate"), copies.port("motors", "counts"), copies.port("reward")
    ports = [(sim.port("sensors", "rate"), sim.port("motors", "counts"), sim.port("reward")) for sim in alone]
    rng = np.random.default_rng(1)
    for _ in range(6):
        rates, rewards = rng.uniform(0.0, 80.0, (N, 20)), rng.normal(0.0, 1e-3, (N, 6))
        rate.set(rates)
        copies.run(20.0)
        reward.set(rewards)
        found = counts.get()
        for k, (sim, (own_rate, own_counts, own_reward)) in enumerate(zip(alone, ports, strict=True)):
            own_rate.set(rates[k])
            sim.run(20.0)
            own_reward.set(rewards[k])
            np.testing.assert_array_equal(found[k], own_counts.get())
    for copy, sim in zip(copies, alone, strict=True):
        np.testing.assert_array_equal(copy.weights("learnt")[2], sim.weights("learnt")[2])
        np.testing.assert_array_equal(copy.spikes("motors"), sim.spikes("motors"))
    assert copies.time == 120.0
    assert len({tuple(sim.weights("learnt")[2][:4]) for sim in copies}) == N


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_control_steps_are_inject_run_and_counts(backend):
    copies = neuro.compile(agent(), backend, seed=2, copies=N)
    alone = [neuro.compile(agent(), backend, seed=2 + k) for k in range(N)]
    step = copies.stepper(10.0, emit=["places"], count=["actor"])
    rng = np.random.default_rng(3)
    for move in range(40):
        lists = [np.unravel_index(np.sort(rng.choice(80, rng.integers(1, 60), False)), (10, 8)) for _ in range(N)]
        offsets = np.concatenate([[0], np.cumsum([len(ticks) for ticks, _ in lists])])
        (counts,) = step.step(
            (offsets, np.concatenate([t for t, _ in lists]) + 1, np.concatenate([i for _, i in lists]))
        )
        errors = rng.normal(size=(N, 1))
        copies.signal("error", errors)
        if move % 5 == 4:
            copies.clear("policy", [True, False, True])
        for k, sim in enumerate(alone):
            begin = sim.time
            sim.inject("places", begin + 1.0 + lists[k][0], lists[k][1])
            sim.run(10.0)
            np.testing.assert_array_equal(counts[k], np.bincount(sim.spikes("actor", since=begin)[1], minlength=2))
            sim.signal("error", errors[k, 0])
            if move % 5 == 4 and k != 1:
                sim.set("policy", e=0.0, z=0.0)
    for copy, sim in zip(copies, alone, strict=True):
        np.testing.assert_array_equal(copy.get("policy", "weight"), sim.get("policy", "weight"))


def test_a_step_takes_what_was_injected_before(tmp_path):
    one, other = neuro.compile(agent(), seed=1), neuro.compile(agent(), seed=1)
    step = one.stepper(10.0, emit=["places"], count=["actor"])
    for sim in (one, other):
        sim.inject("places", [3.0, 14.0], [1, 2])
    other.inject("places", [5.0], [7])
    step.step(([5], [7]))
    step.step(([], []))
    other.run(20.0)
    np.testing.assert_array_equal(one.get("policy", "e"), other.get("policy", "e"))
    assert one.get("policy", "e").any()
    one.save(tmp_path / "one.h5")
    again = neuro.compile(agent(), seed=1)
    again.restore(tmp_path / "one.h5")
    assert again.time == 20.0


def test_the_same_lists_may_have_other_spikes_in_the_next_step():
    sim = neuro.compile(agent(), seed=1)
    step, spikes = sim.stepper(10.0, emit=["places"], count=["places"]), (np.array([5]), np.array([0]))
    step.step(spikes)
    spikes[1][0] = 3
    assert step.step(spikes)[0].tolist() == [[0, 0, 0, 1, 0, 0, 0, 0]]
    spikes[1][0] = 8
    assert "ids 8 to 8: expected 0 to 7" in refused(step.step, spikes)


def test_spikes_of_steps_are_not_kept():
    sim = neuro.compile(agent(), seed=1)
    step = sim.stepper(10.0, emit=["places"], count=["actor"])
    ticks = np.repeat(np.arange(1, 11), 8), np.tile(np.arange(8), 10)
    before = sum(sim.memory().values())
    for _ in range(300):
        step.step(ticks)
    assert sum(sim.memory().values()) < 1.1 * before + 1e5
    assert sim.counts().populations["places"].spikes == 300 * 80


def test_what_a_step_cannot_take_is_refused(messages):
    sim = neuro.compile(agent(), "reference", seed=1)
    step = sim.stepper(10.0, emit=["places"], count=["actor"])
    messages.calls(globals() | {"sim": sim, "step": step})


def test_values_of_copies_come_copies_first():
    copies = neuro.compile(agent(), copies=2)
    for wrong in (np.zeros(2), np.zeros((3, 2)), np.full((2, 1), np.nan)):
        assert "signal 'error'" in refused(copies.signal, "error", wrong)
    copies[0].run(5.0)
    assert "are at 5, 0" in refused(copies.run, 5.0)
    assert copies.port("policy", "weight").get().shape == (2, 16)


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_merged_copies_have_what_each_has_learnt(backend):
    copies = neuro.compile(agent(), backend, seed=1, copies=N)
    before = np.linspace(0.1, 1.0, copies.program.projections[0].size)
    for sim in copies:
        sim.set("policy", weight=before)
    stepper = copies.stepper(5.0, emit=["places"])
    rng = np.random.default_rng(2)
    for _ in range(20):
        ids = np.sort(rng.permuted(np.tile(np.arange(8), (N, 1)), axis=1)[:, :4], axis=1).ravel()
        stepper.step((np.arange(N + 1) * 4, np.full(len(ids), 1), ids))
        copies.signal("error", rng.normal(0.0, 1.0, (N, 1)))
    each = [sim.get("policy", "weight") for sim in copies]
    after = copies.merge("policy", before)
    assert len({tuple(w) for w in each}) == N
    np.testing.assert_allclose(after, before + sum(w - before for w in each), rtol=1e-12, atol=1e-15)
    for sim in copies:
        np.testing.assert_array_equal(sim.get("policy", "weight"), after)
    assert "merge: before has shape [3]: expected [16]" in refused(copies.merge, "policy", [1.0, 2.0, 3.0])


def test_a_merged_projection_sends_its_new_weights():
    copies = neuro.compile(agent(), seed=1, copies=2)
    copies[0].set("policy", weight=3.0)
    copies.merge("policy", np.full(16, 0.5))
    copies.stepper(1.0, emit=["places"]).step(([0, 0, 1], [1], [0]))
    copies.run(1.0)
    assert copies[0].get("actor", "V_m").tolist() == [0.0, 0.0]
    assert copies[1].get("actor", "V_m").max() == 3.0  # the other may have spiked


def test_a_port_of_copies_is_the_port_of_each():
    """Also of views, states and synapses, into arrays that are there, and after a reset."""
    copies = neuro.compile(loop(), seed=5, copies=N)
    cells, sources = copies.port("motors", "V_m"), neuro.compile(agent(), copies=N).port("policy", "weight")
    some, weight, counts = (
        copies.port("motors[1]", "V_m"),
        copies.port("learnt", "weight"),
        copies.port("motors[1]", "counts"),
    )
    new, room = np.linspace(-70.0, -60.0, N * 3).reshape(N, 3), np.zeros((N, 3), dtype=np.int64)
    copies.run(100.0)
    assert counts.get(room) is room
    assert room.sum() > 0
    copies.reset()
    assert not counts.get(room).any()
    cells.set(np.full((N, 1), -61.5))
    some.set(new)
    for k, sim in enumerate(copies):
        np.testing.assert_array_equal(sim.get("motors", "V_m"), [-61.5] * 3 + new[k].tolist())
        assert {"set", "reset"} <= {*sim.steered}
    assert "copies have " in refused(weight.get)
    assert sources.get().tolist() == [[0.5] * 16] * N
    cells.set(-60.0)
    assert (cells.get() == -60.0).all()
    assert repr(some) == "Port(V_m of motors[1, :], 3 copies)"
    assert "V_m of 'motors': an array of shape [6]: expected 3 copies first" in refused(cells.set, np.zeros(6))
    assert "expected 'counts'" in refused(copies.port, "motors", "spikes")
    assert "expected at most 500000 Hz" in refused(copies.port("sensors", "rate").set, np.full((N, 1), 6e5))


def drawn(rng):
    """Random sizes and rules: moves onto few and many targets, and synapses that learn by dopamine."""
    net = neuro.Network("drawn", resolution=1.0)
    places = net.population("places", int(rng.integers(1, 40)), neuro.spike_generator())
    point = neuro.pp_psc_delta(with_reset=False, c_1=100.0, c_2=float(rng.choice([0.0, 5.0, 300.0])), c_3=0.0)
    critic = net.population("critic", int(rng.integers(1, 130)), point)
    actor = net.population("actor", int(rng.integers(2, 30)), neuro.pp_psc_delta(c_2=50.0))
    motors = net.population("motors", 5, neuro.iaf_psc_exp(tau_m=10.0))
    for name, target in (("error", critic), ("error_of_actor", actor), ("reward", motors)):
        net.signal(name, to=target)
    connected = [neuro.all_to_all(), neuro.pairwise_bernoulli(0.6)][rng.integers(2)]
    value = neuro.td_lambda(signal="error", tau=5.0, eta=0.1, Wmin=-1.0, Wmax=1.0)
    net.connect(
        places, critic, neuro.all_to_all(), value, weight=neuro.uniform(low=-0.1, high=0.1), delay=1.0, name="value"
    )
    net.connect(
        places, actor, connected, neuro.reinforce(signal="error_of_actor"), weight=0.1, delay=1.0, name="policy"
    )
    learnt = neuro.stdp_dopa(signal="reward", Wmax=1200.0)
    net.connect(places, motors, connected, learnt, weight=600.0, delay=1.0, name="learnt")
    return net


@pytest.mark.parametrize("seed", range(8))
def test_random_copies_in_silence_and_at_full_rate_are_single_simulations(seed):
    rng = np.random.default_rng(seed)
    net = drawn(rng)
    size = {name: int(np.prod(part.shape)) for name, part in net.populations.items()}
    places, signals = size["places"], {signal: size[target] for signal, target in TAUGHT.items()}
    copies = neuro.compile(net, seed=seed, copies=N)
    alone = [neuro.compile(net, seed=seed + k) for k in range(N)]
    reference = neuro.compile(net, "reference", seed=seed)
    stepper = copies.stepper(10.0, emit=["places"], count=["critic"])
    for step in range(8):
        # A copy is silent, spikes at random, or spikes in each tick, so its sources become inactive and active again.
        chance = rng.choice([0.0, 0.1, 1.0], N)
        lists = [np.nonzero(rng.random((9, places)) < p) for p in chance]
        offsets = np.concatenate([[0], np.cumsum([len(ticks) for ticks, _ in lists])])
        stepper.step((offsets, np.concatenate([t for t, _ in lists]) + 1, np.concatenate([i for _, i in lists])))
        errors = {s: rng.choice([0.0, 1e-3, 1.0, 1e6]) * rng.normal(size=(N, n)) for s, n in signals.items()}
        for signal, values in errors.items():
            copies.signal(signal, values)
        for k, sim in [*enumerate(alone), (0, reference)]:
            sim.inject("places", sim.time + 1.0 + lists[k][0], lists[k][1])
            sim.run(10.0)
            for signal, values in errors.items():
                sim.signal(signal, values[k])
            moves = [("value", "e"), ("value", "z"), ("value", "weight"), ("policy", "z"), ("policy", "weight")]
            # `event` and the reference round the effect of dopamine differently, by 1 ulp.
            for part, state in moves if sim is reference else [*moves, ("learnt", "weight")]:
                np.testing.assert_array_equal(
                    copies[k].get(part, state), sim.get(part, state), f"{step} {part} {state}"
                )
