"""What learns stays where it may lie: delays and parameters of neurons within their bounds, and all of it numbers."""

import numpy as np
import pytest

import neuro
from refused import refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402
from neuro_torch.events import Train  # noqa: E402

BY = ["kernels", "torch", "steps"]
SPIKE = torch.zeros(1, 30, 1, dtype=torch.float64)
SPIKE[0, 2, 0] = 1.0


def one_synapse(resolution=1.0, **cell):
    """One spike that makes a potential, never a spike."""
    net = neuro.Network("one", resolution=resolution)
    net.population("a", 1, neuro.spike_generator(spike_times=[]))
    net.population("out", 1, neuro.iaf_psc_exp(**({"tau_syn_ex": 2.0, "tau_syn_in": 2.0, "V_th": 1000.0} | cell)))
    net.connect("a", "out", neuro.all_to_all(), weight=300.0, delay=2.0, name="w")
    return net


def module_of(learns=("weight", "delay"), by=None, dtype=torch.float64, **neurons):
    return neuro_torch.Module(one_synapse(), {"w": learns, **neurons}, dtype=dtype, by=by)


def fill(tensor, value):
    with torch.no_grad():
        tensor.fill_(value)


def potential(module):
    return module({"a": SPIKE.to(module.weights["w"].dtype)}).V_m["out"]


@pytest.mark.parametrize(("by", "training"), [*zip(BY, [True, False, True], strict=True)])
def test_delays_that_no_array_has_are_refused(by, training, messages):
    module = module_of(by=by).train(training)
    for value in (float("nan"), float("inf"), -float("inf"), 1e20, 1e300):
        fill(module.delays["w"], value)
        messages({str(value): refused(potential, module)})


@pytest.mark.parametrize(("dtype", "resolution"), [(torch.float32, 0.1), (torch.float64, 1.0)])
def test_the_longest_delay_is_one(resolution, dtype):
    longest = 2.0**16 * resolution
    net = one_synapse(resolution)
    module = neuro_torch.Module(net, {"w": ["weight", "delay"]}, dtype=dtype)
    fill(module.delays["w"], longest)
    assert torch.equal(potential(module), torch.full((1, 30, 1), -70.0, dtype=dtype))
    assert neuro.compile(module.network()).program.projections[0].delay.tolist() == [2**16]


@pytest.mark.parametrize("by", BY)
def test_a_delay_below_one_step_goes_no_further(by):
    found = {}
    for delay in (1.0, 0.4, -3.0):
        module = module_of(by=by)
        fill(module.delays["w"], delay)
        for sign in (1.0, -1.0):
            module.zero_grad()
            (sign * potential(module)[:, :8].sum()).backward()
            found[delay, sign] = module.delays["w"].grad.item()
    outwards = 1.0 if found[1.0, 1.0] > 0 else -1.0  # descent makes it shorter
    for delay in (0.4, -3.0):
        assert found[delay, outwards] == 0.0
        assert found[delay, -outwards] == found[1.0, -outwards] < 0.0


def test_parameters_of_neurons_out_of_their_bounds_are_refused(messages):
    values = [("tau_m", -1.0), ("tau_m", 0.0), ("C_m", -250.0), ("V_th", -71.0), ("V_reset", 1000.0)]
    for word, value in values:
        module = module_of("weight", out=[word])
        fill(module.neurons["out"][word], value)
        for run in (lambda m=module: potential(m), module.network):
            messages({f"{word} {value}": refused(run)})


def test_what_left_its_bounds_is_put_back():
    words = ["tau_m", "tau_syn_ex", "tau_syn_in", "V_th", "V_reset", "E_L"]
    module = module_of(out=words)
    before = {word: module.neurons["out"][word].item() for word in words}
    module.hold()
    assert {word: module.neurons["out"][word].item() for word in words} == before
    for word, value in (("tau_m", -3.0), ("tau_syn_ex", 0.0), ("V_th", -80.0), ("V_reset", -60.0), ("E_L", -500.0)):
        fill(module.neurons["out"][word], value)
    fill(module.delays["w"], -3.0)
    fill(module.weights["w"], -1e6)
    module.hold()
    found = {word: module.neurons["out"][word].item() for word in words}
    times = {"tau_m": 1e-3, "tau_syn_ex": 1e-3, "tau_syn_in": 2.0}
    assert found == times | {"V_th": pytest.approx(-59.999), "V_reset": -60.0, "E_L": -500.0}
    assert (module.delays["w"].item(), module.weights["w"].item()) == (1.0, -1e6)
    potential(module).sum().backward()
    assert all(bool(torch.isfinite(p.grad).all()) for p in module.parameters() if p.grad is not None)


@pytest.mark.parametrize("words", [["V_reset"], ["V_th"], ["V_th", "V_reset"]])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_threshold_that_each_neuron_has_stays_above_its_reset(words, dtype):
    net = one_synapse()
    cell = neuro.iaf_psc_exp(V_th=np.array([-55.0, -50.0, -45.0]), V_reset=-70.0)
    net.population("many", 3, cell)
    net.connect("out", "many", neuro.all_to_all(), weight=1.0, delay=1.0)
    module = neuro_torch.Module(net, {"w": "weight", "many": words}, dtype=dtype, outputs=["out"])
    learns = module.neurons["many"]
    with torch.no_grad():
        if "V_th" in words:
            learns["V_th"][0] = -75.0
        if "V_reset" in words:
            learns["V_reset"].fill_(-52.0)
    module.hold()
    top = learns["V_th"].detach().double() if "V_th" in words else torch.tensor([-55.0, -50.0, -45.0])
    bottom = learns["V_reset"].detach().double() if "V_reset" in words else torch.tensor([-70.0])
    assert (top - bottom).min().item() == pytest.approx(1e-3, abs=1e-4)
    if "V_th" in words:
        assert top[2].item() == -45.0
    potential(module)


@pytest.mark.parametrize("by", BY)
def test_what_is_no_number_is_told_and_makes_no_network(by, messages):
    for value in (float("nan"), float("inf")):
        for learns in ("weights", "delays", "neurons"):
            module = module_of(by=by, out=["C_m"])
            fill(module.neurons["out"]["C_m"] if learns == "neurons" else getattr(module, learns)["w"], value)
            messages({f"{learns} {value}: {run.__name__}": refused(run) for run in (module.hold, module.network)})


def test_rounded_weights_that_are_no_numbers_are_told(messages):
    net = neuro.Network("rounded", resolution=1.0)
    net.population("a", 3, neuro.spike_generator(spike_times=[]))
    net.population("out", 2, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=1.0))
    net.connect("a", "out", neuro.all_to_all(), weight=[[0.1, 0.2]] * 3, name="w")
    module = neuro_torch.quantised(neuro_torch.Module(net, ["w"]), 4)
    module.hold()
    fill(module.weights.parametrizations.w.original, float("nan"))
    messages({"w": refused(module.hold)})


@pytest.mark.parametrize("by", BY)
def test_spikes_that_no_array_has_are_refused(by, messages):
    for word, value in (("neuron", 1), ("neuron", -9), ("step", 30), ("step", -1)):
        train = {"ends": np.array([0, 1]), "step": np.array([2], np.int32), "neuron": np.array([0], np.int32)}
        train[word] = np.array([value], dtype=np.int32)
        batch = neuro_torch.Events.of_trains(30, {"a": Train(**train)})
        messages({f"{word} {value}": refused(module_of(by=by), batch)})
