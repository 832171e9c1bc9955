"""neuro train: delays and neurons learn within their bounds, decay is of weights, and weights may have any unit."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import torch

import neuro as snn
import neuro_models
from neuro.events import recordings
from neuro_train import trainer
from neuro_train.data import show
from neuro_train.plan import TrainingPlan

# Few epochs at rates that are too large: some networks end silent.
pytestmark = pytest.mark.filterwarnings("ignore:population 'out'. no neuron fired")
QUICK = ("--for", 60, "--epochs", 8, "--batch", 6)
SMALL = {"height": 12, "width": 12, "hidden": 10, "classes": 3, "in_std": 0.2, "out_std": 0.4}
DELAYS = ("--learn", "in_hidden", "--learn", "hidden_out=weight,delay")


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """The network with delays that learn, small."""
    path = tmp_path_factory.mktemp("late") / "late.yaml"
    snn.load(neuro_models.path("learnt_delays"), params=SMALL).save(path)
    return path


@pytest.fixture
def learn(folder, late):
    """Train; gives what came of it."""

    def learnt(net=None, **words):
        net = snn.load(late) if net is None else net
        plan = TrainingPlan(**({"input": "pixels", "output": "out", "duration": 60.0, "epochs": 4, "batch": 6} | words))
        return trainer.learn(net, show(net, recordings(folder, part="Train"), plan, lambda *told: None), plan)

    return learnt


def spoil(monkeypatch, which, value, at):
    """Make one number that learns another one after a step of the optimiser."""
    steps = []

    def step(self, *told):
        found = whole(self, *told)
        steps.append(None)
        if len(steps) == at:
            with torch.no_grad():
                which(self).view(-1)[0] = value
        return found

    whole = torch.optim.AdamW.step
    monkeypatch.setattr(torch.optim.AdamW, "step", step)


def sized(size):
    """The parameter of so many numbers."""
    return lambda self: next(p for group in self.param_groups for p in group["params"] if p.numel() == size)


@pytest.mark.parametrize(
    ("size", "value", "told"),
    [
        (2 * 12 * 12 * 10, float("inf"), "weights of 'in_hidden': found inf: expected numbers"),
        (1, float("nan"), "tau_m of 'hidden': found nan: expected numbers"),
    ],
)
def test_nan_and_infinity_stop_at_once(neuro, folder, file, monkeypatch, size, value, told):
    spoil(monkeypatch, sized(size), value, at=6)
    words = ("--learn", "in_hidden", "--learn", "hidden=tau_m")
    status, out, err = neuro(file, "--data", folder, *QUICK, *words)
    assert (status, out) == (2, "")
    kept = "; what was learnt until the end of epoch 1 is kept in trained.yaml.training"
    assert f"error: epoch 2, batch 2 of 4: {told}{kept}\n  hint: lower --rate" in err


@pytest.mark.parametrize(("value", "found"), [(float("nan"), "nan: expected numbers"), (1e20, "1e+20 ms: expected at")])
def test_delays_that_are_no_times_stop_at_once(neuro, folder, late, monkeypatch, value, found):
    delays = iter(range(100))

    def which(self):
        both = [p for group in self.param_groups for p in group["params"] if p.numel() == 30]
        assert next(delays) == 0
        return both[-1]

    spoil(monkeypatch, which, value, at=2)
    status, out, err = neuro(late, "--data", folder, *QUICK, *DELAYS)
    assert (status, out) == (2, "")
    assert f"error: epoch 1, batch 2 of 4: delays of 'hidden_out': found {found}" in err
    assert "hint: lower --rate" in err


@pytest.mark.parametrize("what", ["hidden_out=delay", "hidden=tau_m,V_th"])
def test_only_weights_decay(learn, what):
    without, strong = (learn(trainable=(what,), decay=decay) for decay in (0.0, 10.0))
    for name, values in without.module.named_parameters():
        assert torch.equal(values, strong.module.get_parameter(name))
    with_weights = what.replace("=delay", "=weight,delay")
    both = (learn(trainable=("hidden_out", with_weights), decay=decay) for decay in (0.0, 10.0))
    plain, small = (float(one.module.weights["hidden_out"].detach().norm()) for one in both)
    assert small < 0.9 * plain


@pytest.mark.parametrize(
    ("words", "rate", "lowest"),
    [
        (("in_hidden", "hidden=V_th"), 0.5, ["V_th"]),
        (("in_hidden", "hidden=V_th,V_reset"), 0.5, []),
        (("hidden=tau_m,V_th",), 2.0, ["tau_m"]),
    ],
)
def test_neurons_learn_within_their_bounds(learn, words, rate, lowest):
    trained = learn(trainable=words, rate=rate, epochs=8, decay=0.0)
    hidden = trained.net.populations["hidden"].model
    assert hidden.tau_m > 0.0
    assert hidden.V_th > hidden.V_reset
    for word in lowest:  # it would have left them
        assert 0.0 < getattr(hidden, word) < 2e-3
    snn.compile(trained.net, backend="event").run(5.0)


def test_delays_learn_within_their_bounds(learn):
    assert float(learn(trainable=("hidden_out=delay",), rate=8.0).module.delays["hidden_out"].detach().min()) == 5.0


def in_pa(times=1.0):
    """Neurons of NEST's own numbers, with weights in pA."""
    net = snn.Network("pA", resolution=5.0)
    net.population("pixels", (2, 12, 12), snn.spike_generator(spike_times=[]))
    cell = snn.iaf_psc_exp(tau_syn_ex=5.0, tau_syn_in=5.0, t_ref=0.0, C_m=250.0 * times)
    net.population("hidden", 10, cell)
    net.population("out", 3, cell)
    rng = np.random.default_rng(1)
    for a, b, n, std in (("pixels", "hidden", 2880, 150.0), ("hidden", "out", 30, 400.0)):
        net.connect(a, b, snn.all_to_all(), weight=times * rng.normal(0.0, std, n), delay=5.0, name=f"{a}_{b}")
    return net


def test_weights_in_pa_and_of_networks_that_ship_learn_at_the_default_rate(learn, late):
    trained = learn(in_pa(), epochs=20)
    assert trained.curves["right"][-1] >= 0.9
    assert trained.rates == {"pixels_hidden": 10.0, "hidden_out": 10.0}
    for name in ("dense", "conv", "recurrent", "learnt_delays"):
        module = trainer.module_of(snn.load(neuro_models.path(name)), TrainingPlan(input="pixels", output="out"))
        assert set(trainer.sizes(module).values()) == {1.0}


@pytest.mark.parametrize("times", [1e3])
def test_another_unit_changes_nothing_that_is_learnt(learn, times):
    plain, other = (learn(in_pa(each), epochs=4, decay=0.5) for each in (1.0, times))
    assert other.rates == {name: pytest.approx(times * rate) for name, rate in plain.rates.items()}
    for name, weight in plain.module.weights.items():
        torch.testing.assert_close(other.module.weights[name], times * weight, rtol=1e-3, atol=1e-2 * times)
    np.testing.assert_allclose(other.curves["loss"], plain.curves["loss"], rtol=1e-3)


@pytest.mark.parametrize(
    ("weight", "size"), [(0.0, 1.0), (0.05, 1.0), (-0.9, 1.0), (2.0, 10.0), (-400.0, 1000.0), (5e-3, 0.1)]
)
def test_sizes_are_powers_of_ten(weight, size):
    net = snn.Network("one", resolution=5.0)
    net.population("pixels", (2, 2), snn.spike_generator(spike_times=[]))
    net.population("out", 2, snn.iaf_psc_delta(t_ref=0.0))
    net.connect("pixels", "out", snn.all_to_all(), weight=weight, delay=5.0, name="up")
    found = trainer.sizes(trainer.module_of(net, TrainingPlan(input="pixels", output="out")))
    assert found == {"up": pytest.approx(size, rel=1e-12)}
