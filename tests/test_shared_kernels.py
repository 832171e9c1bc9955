"""`stdp` and `stdp_dopa` on grids: event beside the reference, and beside the same network written out as pairs.

`NEURO_SHARED_KERNELS` sets how many random networks are tried.
"""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro

NETWORKS = int(os.environ.get("NEURO_SHARED_KERNELS", "15"))
SEARCH = settings(max_examples=NETWORKS, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def network(rule, layers=1, sheet=(2, 5, 6), maps=2, delay=2.0, rate=60.0, **of_grid):
    """Noise on a sheet, and one or two layers of learning kernels."""
    net = neuro.Network("sheets", resolution=1.0)
    net.population("sheet", sheet, neuro.poisson_generator(rate=rate))
    net.population("snc", 3, neuro.poisson_generator(rate=8.0))
    source = "sheet"
    for k in range(layers):
        name = f"layer{k}"
        cell = neuro.iaf_psc_exp(t_ref=2.0, tau_syn_ex=2.0, tau_minus=15.0)
        net.population(name, (maps, "auto", "auto"), cell)
        net.signal(f"reward{k}", to=name)
        signal = {"signal": f"reward{k}"} if rule.name == "stdp_dopa" and rule.dopamine is None else {}
        synapse = type(rule)(**{**rule.parameters(), **signal}) if signal else rule
        net.connect(
            source,
            name,
            neuro.grid(kernel=(3, 3), padding=1, **of_grid),
            synapse,
            weight=600.0,
            delay=delay,
            name=f"k{k}",
        )
        source = name
    return net


DOPA = {"Wmax": 900.0, "tau_c": 80.0, "tau_n": 50.0, "A_minus": 0.7}
RULES = {
    "stdp": neuro.stdp(lambda_=0.01, Wmax=900.0, mu_plus=0.5, mu_minus=0.3),
    "additive": neuro.stdp(lambda_=0.02, Wmax=900.0, mu_plus=0.0, mu_minus=0.0),
    "signal": neuro.stdp_dopa(signal="later", b=0.01, **DOPA),
    "one sign": neuro.stdp_dopa(signal="later", c_min=0.0, A_plus=2.0, **DOPA),
    "population": neuro.stdp_dopa(dopamine="snc", dopamine_delay=3.0, Wmin=-200.0, **DOPA),
}


def played(sim, layers, seed, pieces=4):
    """Weights and spikes after some pieces, between which signals, weights and rules are set."""
    rng, seen = np.random.default_rng(seed), []
    for piece in range(pieces):
        sim.run(float(rng.integers(1, 30)))
        for k in range(layers):
            values = rng.normal(0.0, 0.1, sim.get(f"layer{k}", "V_m").size)
            sim.signal(f"reward{k}", values if piece % 2 else float(values[0]))
            seen.append(sim.get(f"k{k}", "weight"))
        if piece == 1:
            sim.set_weights("k0", 0.9 * sim.get("k0", "weight"))
            sim.set("k0", tau_plus=11.0)
    return [*seen, *sim.spikes("layer0")]


@st.composite
def described(draw):
    rule = draw(st.sampled_from(sorted(RULES)))
    channels, layers = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    words = {
        "stride": draw(st.integers(1, 2)) if layers == 1 else 1,
        "changes": draw(st.sampled_from(["sum", "mean"])),
        "depthwise": layers == 1 and draw(st.booleans()),
    }
    sheet = (channels, draw(st.integers(3, 5)), draw(st.integers(3, 5)))
    rate = draw(st.sampled_from([0.0, 5.0, 60.0, 400.0]))
    return RULES[rule], {
        "layers": layers,
        "sheet": sheet,
        "delay": float(draw(st.integers(1, 6))),
        "rate": rate,
        **words,
    }


@SEARCH
@given(case=described(), seed=st.integers(0, 100))
def test_random_networks_are_those_of_the_reference(case, seed):
    rule, words = case
    results = [
        played(neuro.compile(network(rule, **words), backend, seed=seed), words["layers"], seed)
        for backend in ("event", "reference")
    ]
    for ours, expected in zip(*results, strict=True):
        np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("backend", ["event", "reference"])
def test_a_state_that_is_saved_continues(rule, backend, tmp_path):
    net = network(rule, changes="mean")
    sim = neuro.compile(net, backend, seed=3)
    played(sim, 1, 5)
    sim.save(tmp_path / "state.h5")
    again = neuro.compile(net, backend, seed=3)
    again.restore(tmp_path / "state.h5")
    for ours, expected in zip(played(again, 1, 6), played(sim, 1, 6), strict=True):
        np.testing.assert_array_equal(ours, expected)
    sim.reset(weights=True)
    fresh = neuro.compile(net, backend, seed=3)
    fresh.set("k0", tau_plus=11.0)
    np.testing.assert_array_equal(played(sim, 1, 5)[0], played(fresh, 1, 5)[0])


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_threads_and_copies_change_nothing(rule):
    net = network(rule)
    expected = played(neuro.compile(net, seed=4), 1, 2)
    for ours, each in zip(played(neuro.compile(net, seed=4, threads=2), 1, 2), expected, strict=True):
        np.testing.assert_array_equal(ours, each)
    copies = neuro.compile(net, seed=4, copies=2)
    alone = [neuro.compile(net, seed=4 + k) for k in range(2)]
    values = np.random.default_rng(0).normal(0.0, 0.1, (2, alone[0].get("layer0", "V_m").size))
    for _ in range(3):
        copies.run(20.0)
        copies.signal("reward0", values)
        for sim, each in zip(alone, values, strict=True):
            sim.run(20.0)
            sim.signal("reward0", each)
    for copy, sim in zip(copies, alone, strict=True):
        np.testing.assert_array_equal(copy.get("k0", "weight"), sim.get("k0", "weight"))


def as_pairs(sheet, maps, rows, columns, stride):
    """Source, target and weight of each synapse of a kernel of 3 x 3 with a border of 1, one at a time."""
    channels, height, width = sheet
    for m in range(maps):
        for r in range(rows):
            for c in range(columns):
                for k in range(channels):
                    for i in range(3):
                        for j in range(3):
                            y, x = r * stride + i - 1, c * stride + j - 1
                            if 0 <= y < height and 0 <= x < width:
                                source = (k * height + y) * width + x
                                yield source, (m * rows + r) * columns + c, ((m * channels + k) * 3 + i) * 3 + j


@pytest.mark.parametrize("changes", ["sum", "mean"])
@pytest.mark.parametrize("rule", ["stdp", "additive", "signal", "one sign"])
@pytest.mark.parametrize("stride", [1, 2])
def test_it_is_the_network_of_pairs_with_shared_changes(rule, changes, stride):
    """Twin of own numpy: every synapse has traces of its own, by exponentials of all spike times so far."""
    steps, delay, sheet, maps = 120, 3, (1, 4, 5), 2
    model = RULES[rule]
    net = network(model, sheet=sheet, delay=float(delay), changes=changes, stride=stride)
    net.probe("seen", "sheet")
    sim = neuro.compile(net, seed=8)
    rng = np.random.default_rng(1)
    n_targets = sim.get("layer0", "V_m").size
    rows, columns = (4, 5) if stride == 1 else (2, 3)
    signals = rng.normal(0.0, 0.1, (steps, n_targets)) * (rng.random(steps) < 0.2)[:, None]
    for step in range(steps):
        sim.signal("reward0", signals[step])
        sim.run(1.0)
    trains = []
    for name, size in (("sheet", 20), ("layer0", n_targets)):
        times, ids = sim.spikes(name)
        train = np.zeros((steps + 1, size))
        np.add.at(train, (np.round(times).astype(int), ids), 1.0)
        trains.append(train)
    pre, post = trains
    source, target, slot = (np.array(each) for each in zip(*as_pairs(sheet, maps, rows, columns, stride), strict=True))
    p, weight = model.parameters(), np.full(maps * 9, 600.0)
    eligibility, n = np.zeros(source.size), np.zeros(n_targets)
    for step in range(1, steps + 1):
        change = np.zeros(source.size)
        if model.modulated:
            n = signals[step - 1]
            both = 1.0 / (1.0 / p["tau_c"] + 1.0 / p["tau_n"])
            gain = n * both * (1.0 - np.exp(-1.0 / both)) - p["b"] * p["tau_c"] * (1.0 - np.exp(-1.0 / p["tau_c"]))
            change += eligibility * gain[target]
            eligibility *= np.exp(-1.0 / p["tau_c"])
        arrived = step - delay
        before = np.arange(1, step)  # pre spikes before this step
        k_plus = np.exp(-(step - before) / p["tau_plus"]) @ pre[1:step]
        heard = np.arange(1, max(1, arrived))  # post spikes that arrived before this step
        k_minus = np.exp(-(arrived - heard) / 15.0) @ post[1 : max(1, arrived)] if heard.size else np.zeros(n_targets)
        posts = post[arrived] if arrived >= 1 else np.zeros(n_targets)
        w, up, down = weight[slot], posts[target] * k_plus[source], pre[step][source] * k_minus[target]
        if step == steps:
            down[:] = 0.0  # spikes of the last step act when the next begins
        if model.modulated:
            eligibility = np.maximum(eligibility + p["A_plus"] * up, p["c_min"])
            eligibility = np.maximum(eligibility - p["A_minus"] * down, p["c_min"])
        else:
            share = w / p["Wmax"]
            change += (
                p["lambda"]
                * p["Wmax"]
                * ((1.0 - share) ** p["mu_plus"] * up - p["alpha"] * share ** p["mu_minus"] * down)
            )
        if step < steps:
            total = np.bincount(slot, change, weight.size)
            if changes == "mean":
                total /= np.maximum(1, np.bincount(slot, change != 0.0, weight.size))
            weight = np.clip(weight + total, 0.0, p["Wmax"])
    np.testing.assert_allclose(sim.get("k0", "weight"), weight, rtol=1e-9)
    assert np.ptp(weight) > 1.0


def test_a_shared_weight_is_read_frozen_and_refused_elsewhere():
    net = network(RULES["stdp"])
    sim = neuro.compile(net, seed=1)
    sim.run(100.0)
    assert sim.counts().learning_updates > 0
    frozen = sim.network(frozen=True)
    np.testing.assert_array_equal(frozen.projections["k0"].weight.ravel(), sim.get("k0", "weight"))
    for backend in ("loihi", "loihi2", "spinnaker"):
        with pytest.raises(neuro.ModelError, match="a shared kernel that learns"):
            neuro.compile(net, backend)
    with pytest.raises(neuro.ModelError, match="K_plus"):
        sim.get("k0", "K_plus")
    with pytest.raises(neuro.ModelError, match="each synapse on a shared kernel"):
        neuro.compile(network(neuro.stdp(lambda_=np.full(18, 0.01))))
