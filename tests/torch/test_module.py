"""Modules: spikes are those of backend event, gradients those of autograd."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import neuro

torch = pytest.importorskip("torch")
import neuro_torch  # noqa: E402

MODELS = {
    "iaf_psc_delta": (neuro.iaf_psc_delta, 1.5),
    "iaf_psc_exp": (neuro.iaf_psc_exp, 90.0),
}


def connect(net, rng, pre, post, name, unit, layout=None, most=3):
    sizes = [np.prod(net.populations[each].shape) for each in (pre, post)]
    layout = layout or rng.choice(
        ["dense", "delays", "csr", "one"] if sizes[0] == sizes[1] else ["dense", "delays", "csr"]
    )
    delay = float(rng.integers(1, most + 1))
    if layout == "csr":
        rule, n = neuro.pairwise_bernoulli(p=0.4), None
    else:
        rule, n = (neuro.one_to_one(), sizes[0]) if layout == "one" else (neuro.all_to_all(), sizes[0] * sizes[1])
    weight = rng.normal(0.4 * unit, unit, n) if n else neuro.normal(mean=0.4 * unit, std=unit)
    if layout == "delays":
        delay = rng.integers(1, most + 1, n).astype(float)
    return net.connect(pre, post, rule, weight=weight, delay=delay, name=name).name


def random_network(seed, model, recurrent=False, currents=True):
    rng = np.random.default_rng(seed)
    kind, unit = MODELS[model]
    net = neuro.Network("random", resolution=1.0)
    net.population("a", 7, neuro.spike_generator())
    names = ["a"]
    for k in range(int(rng.integers(1, 4))):
        size = int(rng.integers(1, 8))
        extra = {"V_min": -75.0} if model == "iaf_psc_delta" and rng.random() < 0.5 else {}
        cell = kind(
            tau_m=rng.uniform(5, 30, size) if rng.random() < 0.5 else 10.0,
            t_ref=float(rng.integers(0, 4)),
            V_th=-62.0,
            V_reset=-72.0,
            I_e=20.0 * currents,
            **extra,
        )
        net.population(f"n{k}", size, cell, initial={"V_m": rng.uniform(-72, -64, size)})
        names.append(f"n{k}")
    if currents:
        net.population("dc", 1, neuro.dc_generator(amplitude=40.0, start=5.0, stop=20.0))
        net.connect("dc", "n0", neuro.all_to_all(), weight=1.0)
    made = []
    for k in range(1, len(names)):
        for j in range(k):
            if j == k - 1 or rng.random() < 0.5:
                made.append(connect(net, rng, names[j], names[k], f"p{j}_{k}", unit))
        if recurrent:
            j = int(rng.integers(1, k + 1))
            made.append(connect(net, rng, names[k], names[j], f"back{k}", 0.5 * unit))
    return net, made, names[1:]


def spikes_of(net, names, events, steps, backend="event"):
    """By population (batch, steps, neurons), of a run of each recording."""
    found = {name: [] for name in names}
    train = events.trains["a"]
    for b in range(events.batch):
        sim = neuro.compile(net, backend=backend)
        part = slice(train.ends[b], train.ends[b + 1])
        sim.inject("a", train.step[part] + 1.0, train.neuron[part])
        sim.run(float(steps))
        for name in names:
            times, ids = sim.spikes(name)
            dense = np.zeros((steps, int(np.prod(net.populations[name].shape))))
            np.add.at(dense, (np.round(times).astype(int) - 1, ids), 1.0)
            found[name].append(dense)
    return {name: np.array(each) for name, each in found.items()}


def a_batch(rng, batch=3, steps=30, neurons=7, rate=0.3):
    dense = rng.random((batch, steps, neurons)) < rate
    return neuro_torch.Events(batch, steps, {"a": dense.nonzero()})


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
def test_spikes_are_those_of_event(model, recurrent, seed):
    net, made, names = random_network(seed, model, recurrent)
    events = a_batch(np.random.default_rng(seed))
    module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64)
    outcome, expected = module(events), spikes_of(net, names, events, 30)
    assert sum(each.sum() for each in expected.values()) > 0 or seed
    for name in names:
        np.testing.assert_array_equal(outcome.spikes[name].detach().numpy(), expected[name])


def test_the_random_networks_fire():
    total = 0
    for seed in range(10):
        net, made, names = random_network(seed, "iaf_psc_exp", True)
        outcome = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64)(
            a_batch(np.random.default_rng(seed))
        )
        total += sum(float(each.detach().sum()) for each in outcome.spikes.values())
    assert total > 100


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
def test_adjoints_are_those_of_autograd(model, recurrent, seed):
    net, made, names = random_network(seed, model, recurrent)
    rng = np.random.default_rng(seed)
    dense = torch.tensor(rng.random((3, 30, 7)) * (rng.random((3, 30, 7)) < 0.3), requires_grad=True)
    found = {}
    for by in ("kernels", "torch"):
        module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64, by=by, slope=3.0, damping=0.7)
        outcome = module({"a": dense})
        weight = torch.Generator().manual_seed(seed)
        total = sum(
            (tensor * torch.randn(tensor.shape, generator=weight, dtype=torch.float64)).sum()
            for name in names
            for tensor in (outcome.spikes[name], outcome.V_m[name], outcome.counts[name])
        )
        grads = torch.autograd.grad(total, [*module.weights.values(), dense], materialize_grads=True)
        found[by] = [each.detach().numpy() for each in (*(outcome.spikes[name] for name in names), *grads)]
    for ours, theirs in zip(*found.values(), strict=True):
        scale = np.abs(theirs).max(initial=1.0)
        np.testing.assert_allclose(ours / scale, theirs / scale, rtol=0, atol=1e-12)


def conv_network(rng, size=9, depthwise=False):
    net = neuro.Network("conv", resolution=1.0)
    cell = neuro.iaf_psc_delta(tau_m=10.0, t_ref=1.0)
    net.population("a", (2, size, size), neuro.spike_generator())
    net.population("maps", (4, "auto", "auto"), cell)
    net.population("deep", (3, "auto", "auto"), cell)
    net.connect(
        "a", "maps", neuro.grid(kernel=(3, 3), stride=2), weight=rng.normal(1.5, 3.0, (4, 2, 3, 3)), name="first"
    )
    net.connect(
        "maps", "deep", neuro.grid(kernel=(2, 2)), weight=rng.normal(4.0, 4.0, (3, 4, 2, 2)), delay=2.0, name="second"
    )
    return net, ["first", "second"], ["maps", "deep"]


def test_kernels_are_shared_parameters():
    net, made, names = conv_network(np.random.default_rng(1))
    module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64, slope=3.0)
    assert module.weights["first"].shape == (4, 2, 3, 3)
    events = a_batch(np.random.default_rng(2), neurons=162, rate=0.2)
    outcome, expected = module(events), spikes_of(module.network(), names, events, 30)
    assert expected["deep"].sum() > 10
    for name in names:
        np.testing.assert_array_equal(outcome.spikes[name].detach(), expected[name])
    twin = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64, slope=3.0, by="torch")
    for each in (module, twin):
        (each(events).spikes["deep"] * torch.arange(30).double()[:, None]).sum().backward()
    for name in made:
        np.testing.assert_allclose(module.weights[name].grad, twin.weights[name].grad, rtol=1e-12, atol=1e-12)


def test_one_number_is_one_parameter():
    net = neuro.Network("one", resolution=1.0)
    net.population("a", 7, neuro.spike_generator())
    net.population("out", 3, neuro.iaf_psc_delta())
    net.connect("a", "out", neuro.all_to_all(), weight=2.0)
    module = neuro_torch.Module(net, ["a_out"], dtype=torch.float64)
    assert module.weights["a_out"].shape == (1,)
    module(a_batch(np.random.default_rng(0))).V_m["out"].sum().backward()
    twin = neuro_torch.Module(net, ["a_out"], dtype=torch.float64, by="torch")
    twin(a_batch(np.random.default_rng(0))).V_m["out"].sum().backward()
    assert module.weights["a_out"].grad.item() == pytest.approx(twin.weights["a_out"].grad.item(), rel=1e-12)
    with torch.no_grad():
        module.weights["a_out"] += 0.5
    assert module.network().projections["a_out"].weight == 2.5


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_what_was_learnt_runs_on_every_backend(tmp_path, seed):
    net, made, names = random_network(seed, "iaf_psc_delta", recurrent=True)
    module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64)
    events = a_batch(np.random.default_rng(seed))
    optimiser = torch.optim.SGD(module.parameters(), lr=0.05)
    for _ in range(2):
        optimiser.zero_grad()
        module(events).V_m[names[-1]].sum().backward()
        optimiser.step()
    module.network().save(tmp_path / "learnt.yaml")
    learnt = neuro.load(tmp_path / "learnt.yaml")
    assert neuro_torch.Module(net, made).network() != learnt == module.network()
    outcome = module(events)
    for backend in ("event", "reference"):
        expected = spikes_of(learnt, names, events, 30, backend)
        for name in names:
            np.testing.assert_array_equal(outcome.spikes[name].detach(), expected[name])


def test_V_m_is_what_event_records():
    net, made, names = random_network(3, "iaf_psc_exp", recurrent=True)
    net.probe("v", names[0], "V_m")
    events = a_batch(np.random.default_rng(3), batch=1)
    module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64)
    sim = neuro.compile(net)
    sim.inject("a", events.trains["a"].step + 1.0, events.trains["a"].neuron)
    sim.run(30.0)
    found = module(events).V_m[names[0]].detach()[0]
    np.testing.assert_allclose(found, sim.trace("v")[1], rtol=0, atol=1e-9)
