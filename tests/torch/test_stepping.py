"""A batch is its recordings one by one; its gradients are those of smooth neurons, whenever it begins."""

import numpy as np
import pytest

import neuro
from neuro.compiler import compile_network
from neuro.extend import Neuron
from neuro.program.program import Program
from refused import refusals_of

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from neuro_torch import cells  # noqa: E402
from neuro_torch.stepping import Stepper  # noqa: E402
from neuro_torch.surrogates import ArcTan, FastSigmoid  # noqa: E402

STEPS, BATCH, INPUTS = 16, 3, 5
SLOPE = 2.0
MODELS = {
    "delta": (neuro.iaf_psc_delta(V_th=-62.0, V_min=-75.0), 3.0),
    "exp": (neuro.iaf_psc_exp(V_th=-62.0), 400.0),
    "alpha": (neuro.iaf_psc_alpha(V_th=-62.0, t_ref=1.0), 400.0),
    "adaptive": (neuro.iaf_psc_exp_adaptive_threshold(V_th=-62.0), 400.0),
    "conductance": (neuro.iaf_cond_exp(V_th=-62.0, V_reset=-70.0, rk4_substeps=2), 12.0),
    "izhikevich": (neuro.izhikevich(), 6.0),
}


def program(model: Neuron, w: float) -> Program:
    net = neuro.Network("t", resolution=1.0)
    net.population("in", INPUTS, neuro.spike_generator(spike_times=[[]] * INPUTS))
    net.population("hidden", 4, model)
    net.population("out", 3, model)
    net.population("echo", 3, neuro.parrot_neuron())
    some = neuro.uniform(low=0.5 * w, high=2.0 * w)
    net.connect("in", "hidden", neuro.all_to_all(), weight=some, delay=neuro.uniform(low=1.0, high=4.0), name="ih")
    both = neuro.uniform(low=-w, high=w)
    conductance = "nS" in type(model).weight_unit
    net.connect("hidden", "hidden", neuro.all_to_all(), weight=-w if conductance else both, delay=2.0, name="hh")
    net.connect("hidden", "out", neuro.all_to_all(), weight=some, name="ho")
    net.connect("out", "echo", neuro.one_to_one(), weight=1.0, name="oe")
    net.connect("echo", "hidden", neuro.fixed_indegree(2), weight=some, name="eh")
    return compile_network(net, 1, 1)


def inputs(seed: int = 0) -> torch.Tensor:
    return torch.from_numpy((np.random.default_rng(seed).random((BATCH, STEPS, INPUTS)) < 0.4).astype(np.float64))


def courses(stepper: Stepper, events: torch.Tensor) -> torch.Tensor:
    """Spikes and V_m of both layers in time."""
    found = []
    for k in range(events.shape[1]):
        spikes = stepper.step({"in": events[:, k]})
        found.append(
            torch.cat([spikes["hidden"], spikes["echo"], *(stepper.state(n, "V_m") for n in ("hidden", "out"))], 1)
        )
    return torch.stack(found, 1)


@pytest.mark.parametrize("name", MODELS)
def test_a_batch_is_its_recordings_one_by_one(name):
    part, events = program(*MODELS[name]), inputs()
    whole = courses(Stepper(part, batch=BATCH), events)
    assert whole[:, :, :4].sum() > 0
    for b in range(BATCH):
        alone = courses(Stepper(part, batch=1), events[b : b + 1])
        assert torch.equal(alone[0], whole[b])


@pytest.mark.parametrize("name", MODELS)
def test_a_gradient_changes_no_bit(name):
    part, events = program(*MODELS[name]), inputs()
    weights = {p.name: torch.tensor(p.weight, requires_grad=True) for p in part.projections}
    learnt = courses(Stepper(part, batch=BATCH, surrogate=FastSigmoid(), weights=weights), events)
    assert torch.equal(learnt.detach(), courses(Stepper(part, batch=BATCH), events))


class Smooth:
    """A spike as what the surrogate is the derivative of."""

    @staticmethod
    def apply(spikes, x, free, surrogate):
        return (0.5 + torch.atan(0.5 * torch.pi * SLOPE * x) / (0.5 * torch.pi * SLOPE)) * free


def learnt(part: Program) -> tuple[dict, dict]:
    weights = {p.name: torch.tensor(p.weight, requires_grad=True) for p in part.projections if p.name != "oe"}
    cells = next(p for p in part.populations if p.name == "hidden")
    words = {w: cells.parameters[w] for w in ("tau_m", "V_th") if w in cells.parameters}
    own = {
        w: torch.tensor(np.broadcast_to(v, 4 if w == "V_th" else 1).copy(), requires_grad=True)
        for w, v in words.items()
    }
    return weights, {"hidden": own}


def loss(part: Program, events: torch.Tensor, weights: dict, parameters: dict) -> torch.Tensor:
    stepper = Stepper(part, batch=BATCH, surrogate=ArcTan(slope=SLOPE), weights=weights, parameters=parameters)
    course = courses(stepper, events)
    return (course * torch.from_numpy(np.random.default_rng(7).normal(size=course.shape))).sum()


@pytest.mark.parametrize("name", MODELS)
def test_gradients_are_finite_differences_of_smooth_neurons(name, monkeypatch):
    monkeypatch.setattr(cells, "Surrogated", Smooth)
    part, events = program(*MODELS[name]), inputs()
    weights, parameters = learnt(part)
    loss(part, events, weights, parameters).backward()
    for each in (*weights.values(), *parameters["hidden"].values()):
        for i in range(0, each.numel(), 13):
            before, step = float(each.data[i]), 1e-6 * max(1.0, abs(float(each.data[i])))
            sides = []
            for moved in (before - step, before + step):
                each.data[i] = moved
                sides.append(float(loss(part, events, weights, parameters).detach()))
            each.data[i] = before
            assert float(each.grad[i]) == pytest.approx((sides[1] - sides[0]) / (2.0 * step), rel=1e-5, abs=1e-5)


def delayed(part: Program, events: torch.Tensor, ms: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    stepper = Stepper(part)
    stepper.begin(batch=BATCH, weights={"ih": weights}, delays={"ih": ms})
    return courses(stepper, events)


@pytest.mark.parametrize("name", ["delta", "exp"])
def test_learnt_delays_on_the_grid_are_those_of_the_program(name):
    part, events = program(*MODELS[name]), inputs()
    wires = next(p for p in part.projections if p.name == "ih")
    found = delayed(part, events, torch.from_numpy(wires.delay * 1.0), torch.tensor(wires.weight))
    assert torch.equal(found, courses(Stepper(part, batch=BATCH), events))


@pytest.mark.parametrize("start", [0.0, 0.3])
def test_the_gradient_of_a_delay_is_a_finite_difference(start, monkeypatch):
    monkeypatch.setattr(cells, "Surrogated", Smooth)
    part, events = program(*MODELS["exp"]), inputs()
    wires = next(p for p in part.projections if p.name == "ih")
    mixed = torch.tensor(np.where(np.arange(20) % 3, 1.0, -1.0) * wires.weight, requires_grad=True)

    def loss(ms: torch.Tensor) -> torch.Tensor:
        stepper = Stepper(part, batch=BATCH, surrogate=ArcTan(slope=SLOPE), weights={"ih": mixed}, delays={"ih": ms})
        course = courses(stepper, events)
        return (course * torch.from_numpy(np.random.default_rng(3).normal(size=course.shape))).sum()

    delays = torch.tensor(wires.delay + start, requires_grad=True)
    now = loss(delays)
    now.backward()
    for i in range(0, 20, 5):
        later = delays.detach().clone()
        later[i] += 1e-6
        difference = float(loss(later).detach() - now.detach()) / 1e-6
        assert float(delays.grad[i]) == pytest.approx(difference, rel=1e-4, abs=1e-4)
    assert delays.grad.abs().min() > 0


def test_what_cannot_be_is_told(messages):
    part, net = program(*MODELS["delta"]), neuro.Network("t")
    net.population("cells", 1, neuro.aeif_cond_exp())

    def of(*shape):
        return torch.ones(*shape, dtype=torch.float64)

    messages(refusals_of(messages.cases, globals() | locals()))


@pytest.mark.parametrize("model", ["iaf_psc_exp", "iaf_psc_alpha"])
@pytest.mark.parametrize("tau", [0.001, 0.4, 10.0])
def test_equal_time_constants_have_gradients(model, tau):
    net = neuro.Network("equal", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[2.0]))
    cell = getattr(neuro, model)(tau_m=20.0, tau_syn_ex=20.0, tau_syn_in=3.0, V_th=1000.0)
    net.population("b", 1, cell)
    net.connect("a", "b", neuro.all_to_all(), weight=300.0, delay=1.0)
    stepper = Stepper(compile_network(net, 0), surrogate=FastSigmoid())

    def mean(tau_m, tau_syn):
        stepper.begin(parameters={"b": {"tau_m": tau_m, "tau_syn_ex": tau_syn}})
        found = []
        for _ in range(20):
            stepper.step()
            found.append(stepper.state("b", "V_m").mean())
        return torch.stack(found).mean()

    both = [torch.full((1,), tau, dtype=torch.float64, requires_grad=True) for _ in range(2)]
    mean(*both).backward()
    assert all(bool(torch.isfinite(each.grad).all()) for each in both)
    e = 1e-5 * tau
    up, down = (torch.full((1,), tau + way, dtype=torch.float64) for way in (e, -e))
    along = (mean(up, up) - mean(down, down)) / (2 * e)
    assert sum(each.grad.item() for each in both) == pytest.approx(along.item(), rel=1e-5, abs=1e-12)
