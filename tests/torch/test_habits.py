"""What users of torch do with modules: copies, states, types, loaders, layers around; and names that torch lacks."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import neuro
from refused import refusals_of, refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402

BY = ["kernels", "torch", "steps"]


def network(first="up", second="down"):
    net = neuro.Network("small", resolution=1.0)
    cell = neuro.iaf_psc_delta(tau_m=20.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
    rng = np.random.default_rng(1)
    net.population("pixels", 12, neuro.spike_generator(spike_times=[]))
    net.population("hidden", 8, cell)
    net.population("out", 2, cell)
    net.connect("pixels", "hidden", neuro.all_to_all(), weight=rng.normal(0.1, 0.3, 96), delay=1.0, name=first)
    net.connect("hidden", "out", neuro.all_to_all(), weight=rng.normal(0.1, 0.4, 16), delay=1.0, name=second)
    return net


def module_of(**words):
    return neuro_torch.Module(network(), **({"trainable": ["up", "down"], "slope": 1.0} | words))


DENSE = torch.from_numpy((np.random.default_rng(3).random((6, 20, 12)) < 0.3).astype(np.float32))
EVENTS = neuro_torch.Events.of_dense({"pixels": DENSE})


@pytest.mark.parametrize("by", BY)
def test_copies_are_equal_and_apart(by):
    module = module_of(by=by)
    outcome = module(EVENTS)
    assert outcome.counts["hidden"].sum() > 0
    for twin in (copy.deepcopy(module), pickle.loads(pickle.dumps(module))):
        assert torch.equal(twin(EVENTS).spikes["out"], outcome.spikes["out"])
        with torch.no_grad():
            twin.weights["up"].zero_()
        assert twin(EVENTS).counts["hidden"].sum() == 0
    assert torch.equal(module(EVENTS).spikes["out"], outcome.spikes["out"])


@pytest.mark.parametrize("by", BY)
def test_training_after_inference(by):
    asked, fresh = (module_of(trainable={"up": ["weight", "delay"]}, by=by) for _ in range(2))
    with torch.inference_mode():
        told = asked(EVENTS)
        assert told.counts["hidden"].sum() > 0
    for module in (asked, fresh):
        module(EVENTS).spikes["out"].sum().backward()
    assert asked.weights["up"].grad.abs().sum() > 0
    assert torch.equal(asked.weights["up"].grad, fresh.weights["up"].grad)


@pytest.mark.parametrize("by", BY)
@pytest.mark.parametrize("recurrent", [False, True], ids=["layers", "recurrent"])
def test_weights_that_change_before_backward_are_refused(by, recurrent):
    net = network()
    net.connect("hidden", "hidden", neuro.all_to_all(), weight=0.1, name="around")
    module = neuro_torch.Module(net, ["up", "down", "around"], slope=1.0, by=by, dtype=torch.float64)
    optimiser = torch.optim.SGD([module.weights["around" if recurrent else "down"]], lr=0.1)
    for part in module.parameters():
        part.grad = torch.ones_like(part)
    spikes = module(EVENTS).spikes["out"]
    optimiser.step()
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        spikes.sum().backward()


@pytest.mark.parametrize("by", ["kernels", "steps"])
@pytest.mark.parametrize("name", ["up", "down"])
def test_a_gradient_of_a_gradient_is_refused(by, name):
    module = module_of(by=by)
    (gradient,) = torch.autograd.grad(module(EVENTS).spikes["out"].sum(), module.weights[name], create_graph=True)
    with pytest.raises(neuro.ModelError) as error:
        (module(EVENTS).spikes["out"].sum() + gradient.square().sum()).backward()
    assert str(error.value) == (
        "compiled kernels and steps have no second-order gradients\n"
        "  hint: use neuro_torch.Module(..., by='torch'), if scans support the network"
    )


def test_a_gradient_of_a_gradient_by_torch():
    def found(scale):
        module = module_of(by="torch", dtype=torch.float64, surrogate="arctan")
        with torch.no_grad():
            module.weights["down"] += scale
        potential = module(EVENTS).V_m["out"][:, :6].square().sum()
        (gradient,) = torch.autograd.grad(potential, module.weights["down"], create_graph=True)
        return gradient, module.weights["down"]

    gradient, weight = found(0.0)
    (second,) = torch.autograd.grad(gradient.square().sum(), weight)
    ends = [found(step)[0].square().sum().item() for step in (-1e-6, 1e-6)]
    assert second.sum().item() == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-5)


@pytest.mark.parametrize("by", BY)
@pytest.mark.parametrize("target", ["hidden", "pixels"], ids=["recurrent", "layers"])
def test_no_synapse_can_be_learnt_from(by, target):
    net = neuro.Network("none", resolution=1.0)
    net.population("pixels", 3, neuro.spike_generator(spike_times=[[1.0]] * 3))
    net.population("hidden", 2, neuro.iaf_psc_exp(I_e=400.0))
    nobody = np.zeros(0, dtype=int)
    net.connect(target, "hidden", neuro.pairs(pre=nobody, post=nobody), weight=np.zeros(0), name="none")
    net.connect(target, "hidden", neuro.all_to_all(), weight=1.0, delay=90.0, name="late")
    module = neuro_torch.Module(net, ["none", "late"], by=by)
    outcome = module(neuro_torch.Events(2, 60, {"pixels": ([], [], [])}))
    assert outcome.counts["hidden"].sum() > 0
    gradients = torch.autograd.grad(
        outcome.spikes["hidden"].sum() + outcome.V_m["hidden"].sum(), list(module.parameters())
    )
    assert [each.tolist() for each in gradients] == [[0.0], []]


@pytest.mark.parametrize("by", BY)
def test_silence_can_be_learnt_from(by):
    module = module_of(by=by)
    outcome = module(neuro_torch.Events(2, 20, {"pixels": ([], [], [])}))
    neuro_torch.losses.count_cross_entropy(outcome.spikes["out"], torch.tensor([0, 1])).backward()
    assert outcome.spikes["out"].sum() == 0
    assert all(p.grad is None or p.grad.abs().sum() == 0 for p in module.parameters())


def test_types_of_numbers():
    module = module_of()
    assert module(EVENTS).spikes["out"].dtype is torch.float32
    assert module.double()(EVENTS).spikes["out"].dtype is torch.float64
    spikes = module.to(torch.bfloat16)(EVENTS).spikes["out"]
    spikes.sum().backward()
    assert spikes.dtype is module.weights["up"].grad.dtype is torch.bfloat16
    assert "by torch's operations" in str(module.plan)
    with pytest.raises(neuro.ModelError, match=r"by = 'kernels': parameters are torch.float16 on 'cpu': expected 32"):
        module_of(by="kernels").half()(EVENTS)


def test_states_groups_schedules_and_accumulation():
    module, whole = module_of(dtype=torch.float64), module_of(dtype=torch.float64, seed=3)
    whole.load_state_dict(module.state_dict())
    assert list(module.state_dict()) == ["weights.down", "weights.up"]
    groups = [{"params": module.weights["up"], "lr": 0.1}, {"params": [module.weights["down"]]}]
    optimiser = torch.optim.Adam(groups, lr=0.01)
    schedule = torch.optim.lr_scheduler.StepLR(optimiser, 1)
    whole(EVENTS).spikes["out"].sum().backward()
    loader = torch.utils.data.DataLoader(EVENTS, batch_size=2, collate_fn=neuro_torch.collate, num_workers=1)
    for part in loader:
        module(part).spikes["out"].sum().backward()
    for ours, theirs in zip(module.parameters(), whole.parameters(), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad, rtol=1e-12, atol=1e-14)
        assert ours.grad.abs().sum() > 0
    optimiser.step()
    schedule.step()
    assert not torch.equal(module.weights["down"], whole.weights["down"])


def test_weights_set_by_hand():
    for module in (module_of(), neuro_torch.quantised(module_of(), 4).eval()):
        assert module(EVENTS).counts["hidden"].sum() > 0
        module.weights["up"] = torch.zeros(12, 8)
        assert module(EVENTS).counts["hidden"].sum() == 0
        assert np.all(module.network().projections["up"].weight == 0)
    with pytest.raises(
        neuro.ModelError, match="unknown projection whose weights learn 'upp'\n  hint: did you mean 'up'"
    ):
        module.weights["upp"]


@pytest.mark.parametrize("quantised", [False, True])
def test_weights_that_do_not_fit(quantised, messages):
    module = neuro_torch.quantised(module_of(), 4) if quantised else module_of()
    before = module.weights["up"].clone()
    shapes = [torch.zeros(shape) for shape in ((3,), (8, 12), (1, 12, 8))]
    kinds = [torch.zeros(12, 8, dtype=kind) for kind in (torch.float64, torch.complex64, torch.int64)]
    values = [*shapes, *kinds, np.zeros((12, 8), np.float32), 0.5]
    messages({str(k): refused(module.weights.__setitem__, "up", value) for k, value in enumerate(values)})
    assert torch.equal(module.weights["up"], before)


@pytest.mark.parametrize("name", ["in.hidden", "keys", "pop", "training", "type", "parametrizations", "weight"])
def test_any_name_of_a_network(name):
    module = neuro_torch.Module(network(name, "a.b"), {name: ["weight", "delay"], "a.b": "weight"}, slope=1.0)
    assert torch.equal(module.eval()(EVENTS).spikes["out"], module_of()(EVENTS).spikes["out"])
    assert name in module.weights
    assert list(module.weights.keys()) == ["a.b", name]
    other = neuro_torch.Module(module.network(), [name, "a.b"])
    other.load_state_dict(module.state_dict(), strict=False)
    neuro_torch.quantised(module, 4).train()(EVENTS).spikes["out"].sum().backward()
    assert len(module.weights[name].unique()) <= 16
    assert module.weights.parametrizations[module.weights.attribute(name)].original.grad.abs().sum() > 0
    assert set(module.network().projections) == {name, "a.b"}
    pruned = neuro_torch.prune(module, 0.5)
    assert pruned.weights[name].shape == (48,)


def test_mistakes(messages):
    messages(refusals_of(messages.cases, globals()))


IMAGES = DENSE.view(6, 20, 3, 2, 2)
KINDS = {"sparse": DENSE.to_sparse(), "bool": DENSE.bool(), "numpy": DENSE.numpy().astype(bool)}
KINDS |= {"images": IMAGES, "sparse images": IMAGES.to_sparse(), "numpy images": IMAGES.numpy()}


@pytest.mark.parametrize("given", KINDS.values(), ids=KINDS)
def test_kinds_of_dense_input(given):
    net = network()
    net.populations["pixels"] = replace(net.populations["pixels"], shape=(3, 2, 2))
    module = neuro_torch.Module(net, ["up"])
    assert torch.equal(module({"pixels": given}).spikes["out"], module(EVENTS).spikes["out"])
    assert module(EVENTS).counts["hidden"].sum() > 0


def holding(value):
    given = DENSE.clone()
    given[2, 3, 4] = value
    return given


def test_dense_input_that_does_not_fit(messages):
    module = module_of()
    messages(refusals_of(messages.cases, globals() | locals()))


@pytest.mark.parametrize("by", BY)
def test_a_delay_beyond_the_recording_brings_nothing(by):
    net = network()
    net.connect("pixels", "out", neuro.all_to_all(), weight=1.0, delay=100.0, name="late")
    late = neuro_torch.Module(net, ["up", "late"], slope=1.0, by=by)
    outcome = late(EVENTS)
    assert torch.equal(outcome.spikes["out"], module_of()(EVENTS).spikes["out"])
    outcome.spikes["out"].sum().backward()
    assert late.weights["late"].grad is None or late.weights["late"].grad == 0


def test_a_learnt_delay_is_in_the_bill():
    module = neuro_torch.Module(network(), {"up": ["weight", "delay"]}, dtype=torch.float64)
    with torch.no_grad():
        module.delays["up"].fill_(3.4)
    outcome = module.eval()(EVENTS)
    sim = neuro.compile(module.network())
    active = []
    for k in range(len(EVENTS)):
        sim.reset()
        train = EVENTS.trains["pixels"].of([k])
        sim.inject("pixels", train.step + 1.0, train.neuron)
        sim.run(20.0)
        active.append(sim.taken().raw_counts.active[1])
    assert outcome.active["hidden"].tolist() == active
