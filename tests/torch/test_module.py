"""Modules: spikes are those of backend event, gradients those of autograd."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.core.errors import Where
from refused import refusals_of, refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402

MODELS = {"iaf_psc_delta": (neuro.iaf_psc_delta, 1.5), "iaf_psc_exp": (neuro.iaf_psc_exp, 90.0)}


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
        tau_m = rng.uniform(5, 30, size) if rng.random() < 0.5 else 10.0
        t_ref = float(rng.integers(0, 4))
        cell = kind(tau_m=tau_m, t_ref=t_ref, V_th=-62.0, V_reset=-72.0, I_e=20.0 * currents, **extra)
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
@settings(max_examples=5)
def test_spikes_are_those_of_event(model, recurrent, seed):
    net, made, names = random_network(seed, model, recurrent)
    events = a_batch(np.random.default_rng(seed))
    module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64)
    outcome, expected = module(events), spikes_of(net, names, events, 30)
    assert sum(each.sum() for each in expected.values()) > 0 or seed
    for name in names:
        np.testing.assert_array_equal(outcome.spikes[name].detach().numpy(), expected[name])


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
@given(seed=st.integers(0, 10**6))
@settings(max_examples=5)
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


@pytest.mark.parametrize("model", MODELS)
@given(seed=st.integers(0, 10**6))
@settings(max_examples=3)
def test_scans_are_steps(model, seed):
    net, made, names = random_network(seed, model, recurrent=True)
    events = a_batch(np.random.default_rng(seed), batch=2, steps=20)
    found = []
    for by in ("kernels", "steps"):
        module = neuro_torch.Module(net, made, outputs=names, dtype=torch.float64, by=by, slope=3.0)
        outcome = module(events)
        total = sum((outcome.spikes[n] * torch.arange(20)[:, None] + outcome.V_m[n].sin()).sum() for n in names)
        found.append((outcome, torch.autograd.grad(total, list(module.weights.values()), materialize_grads=True)))
    (scanned, ours), (stepped, theirs) = found
    for name in names:
        np.testing.assert_array_equal(scanned.spikes[name].detach(), stepped.spikes[name].detach())
        np.testing.assert_allclose(scanned.V_m[name].detach(), stepped.V_m[name].detach(), rtol=0, atol=1e-9)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a.numpy(), b.numpy(), rtol=0, atol=1e-12 * np.abs(b.numpy()).max(initial=1.0))


def test_parameters_of_neurons_learn():
    net, made, names = random_network(4, "iaf_psc_exp")
    events = a_batch(np.random.default_rng(4), batch=2)
    learning = {made[0]: "weight", names[0]: ["tau_m", "V_th"]}
    module = neuro_torch.Module(net, learning, outputs=names, dtype=torch.float64)
    assert "step by step" in str(module.plan)
    assert f"population '{names[0]}': its parameters learn" in str(module.plan)
    optimiser = torch.optim.SGD(module.parameters(), lr=1e-3)
    before = [p.detach().clone() for p in module.parameters()]
    (module(events).V_m[names[0]].mean() + module(events).spikes[names[0]].sum()).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in module.parameters())
    optimiser.step()
    assert all((p != b).any() for p, b in zip(module.parameters(), before, strict=True))
    learnt, outcome = module.network(), module(events)
    np.testing.assert_array_equal(
        np.broadcast_to(learnt.populations[names[0]].model.tau_m, module.neurons[names[0]]["tau_m"].shape),
        module.neurons[names[0]]["tau_m"].detach().numpy(),
    )
    expected = spikes_of(learnt, names, events, 30)
    for name in names:
        np.testing.assert_array_equal(outcome.spikes[name].detach(), expected[name])


def layers(weight=None, model=neuro.iaf_psc_delta, **words):
    net, rng = neuro.Network("layers", resolution=1.0), np.random.default_rng(7)
    net.population("a", 7, neuro.spike_generator())
    net.population("hidden", 6, model(**words))
    net.population("out", 3, model(**words))
    net.connect("a", "hidden", neuro.all_to_all(), weight=rng.normal(2.0, 3.0, 42) if weight is None else weight)
    net.connect("hidden", "out", neuro.all_to_all(), weight=rng.normal(3.0, 4.0, 18), delay=2.0)
    return net


BOTH = ["a_hidden", "hidden_out"]


def gradient(module, events, weigh):
    module.zero_grad()
    outcome = module(events)
    (outcome.spikes["out"] * weigh).sum().backward()
    return outcome, [p.grad.clone() for p in module.parameters()]


def test_a_shift_in_time_shifts_all():
    module, rng = neuro_torch.Module(layers(), BOTH, dtype=torch.float64), np.random.default_rng(2)
    recording, step, neuron = (rng.random((2, 25, 7)) < 0.3).nonzero()
    now, later = (neuro_torch.Events(2, 40, {"a": (recording, step + shift, neuron)}) for shift in (0, 9))
    weigh = torch.zeros(2, 49, 3, dtype=torch.float64)
    weigh[:, :31] = torch.rand(2, 31, 3, dtype=torch.float64)
    one, first = gradient(module, now, weigh[:, :40])
    other, second = gradient(module, later, weigh.roll(9, 1)[:, :40])
    assert one.spikes["out"].sum() > 0
    assert torch.equal(one.spikes["out"][:, :31], other.spikes["out"][:, 9:])
    for a, b in zip(first, second, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("model", MODELS)
def test_a_smooth_spike_has_the_surrogate_as_its_derivative(model):
    """With spikes that are the integral of the surrogate, operations differ as the numbers do."""
    from neuro_torch.scan import operations

    kind, unit = MODELS[model]
    weight = np.random.default_rng(3).normal(0, 0.3 * unit, 42)
    module = neuro_torch.Module(layers(weight, kind, V_th=-60.0), BOTH, dtype=torch.float64, slope=2.0, by="torch")
    (first, second), task = module.plan.parts, module._task(2, 12)
    given = (torch.rand(2, 12, 7) < 0.4).double()

    def smooth(x, _):
        return x / (1.0 + 2.0 * x.abs())

    def value(w_1, w_2, fire):
        drive = operations.drive(first.outside[0], given, w_1, task)
        spikes, _ = operations.scan(first, {1: drive}, [], task, fire)
        drive = operations.drive(second.outside[0], spikes[1], w_2, task)
        return operations.scan(second, {2: drive}, [], task, fire)[1][2].sin().sum()

    weights = [module.weights[name] for name in BOTH]
    assert torch.autograd.gradcheck(lambda *w: value(*w, smooth), weights, atol=1e-6, rtol=1e-4)


def test_generators_in_the_network_emit_the_same_for_all_of_a_batch():
    net = layers()
    net.population("noise", 5, neuro.poisson_generator(rate=200.0))
    net.connect("noise", "hidden", neuro.all_to_all(), weight=1.0)
    net.probe("noisy", "noise")
    module, events = neuro_torch.Module(net, BOTH, dtype=torch.float64), a_batch(np.random.default_rng(6))
    outcome, expected = module(events), spikes_of(net, ["out", "hidden", "noise"], events, 30)
    assert expected["noise"].sum() > 0
    np.testing.assert_array_equal(outcome.spikes["out"].detach(), expected["out"])
    for name in ("hidden", "noise"):
        np.testing.assert_array_equal(outcome.counts[name].detach(), expected[name].sum(1))
    np.testing.assert_array_equal(outcome.counts["a"], events.counts("a", 7))


def test_a_module_is_refused(messages):
    net = layers()
    net.place = Where("here")
    net.group("choice", neuro.winner_take_all(of="out"))
    net.connect("hidden", "out", neuro.all_to_all(), neuro.stdp(Wmax=3.0), name="plastic")
    messages(refusals_of(messages.cases, globals() | locals()))


def test_a_batch_is_refused(messages):
    module = neuro_torch.Module(layers(), BOTH)
    messages(refusals_of(messages.cases, globals() | locals()))
    huge = refused(module, {"a": torch.zeros(1).expand(10**9, 10**4, 7)})
    assert "a batch of 1000000000 recordings of 10000 steps needs" in huge


def test_the_plan_tells_what_runs_how():
    net = layers()
    net.connect("out", "hidden", neuro.all_to_all(), weight=0.1, delay=3.0, name="back")
    assert (
        str(neuro_torch.Module(net, BOTH).plan)
        == "'hidden', 'out': a recurrent scan, 2 steps at once by compiled kernels"
    )
    assert str(neuro_torch.Module(layers(), BOTH, by="torch").plan).splitlines() == [
        "'hidden': one scan over all steps by torch's operations",
        "'out': one scan over all steps by torch's operations",
    ]
    other = layers(model=neuro.iaf_psc_exp, tau_syn_ex=3.0)
    assert "population 'hidden': tau_syn_ex and tau_syn_in differ" in str(neuro_torch.Module(other, BOTH).plan)


@pytest.mark.parametrize("by", ["kernels", "torch"])
@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
def test_delays_learn(by, recurrent):
    net, made, names = random_network(12, "iaf_psc_delta", recurrent)
    events = a_batch(np.random.default_rng(12), batch=2)
    learning = {name: ["weight", "delay"] for name in made}
    module, twin = (
        neuro_torch.Module(net, learning, outputs=names, dtype=torch.float64, by=each, slope=3.0)
        for each in (by, "steps")
    )
    found = []
    for each in (module, twin):
        with torch.no_grad():
            for delay in each.delays.values():
                delay += torch.linspace(0.1, 0.8, len(delay))
        outcome = each(events)
        sum((outcome.spikes[n] + outcome.V_m[n].sin()).sum() for n in names).backward()
        found.append([p.grad.numpy() for p in each.parameters()])
    assert all(each.delays[made[0]].grad.abs().sum() > 0 for each in (module, twin))
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max(initial=1.0))
    module.eval()
    outcome, expected = module(events), spikes_of(module.network(), names, events, 30)
    assert expected[names[0]].sum() > 0
    for name in names:
        np.testing.assert_array_equal(outcome.spikes[name].detach(), expected[name])
