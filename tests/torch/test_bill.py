"""The bill as a tensor: that of `neuro.chips` for the same spikes, on every chip, with the gradient of its counts."""

from types import SimpleNamespace

import numpy as np
import pytest

import neuro
from refused import refused

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402
from neuro_torch import Bill  # noqa: E402

STEPS = 40
CHIPS = ("loihi", "spinnaker", "spinnaker2", "truenorth")


def network():
    """Every layout, a recurrent projection, several delays."""
    net = neuro.Network("mixed", resolution=1.0)
    rng = np.random.default_rng(4)
    times = [np.sort(rng.choice(np.arange(1, STEPS), 5, replace=False)).astype(float) for _ in range(72)]
    net.population("pixels", (2, 6, 6), neuro.spike_generator(spike_times=[t.tolist() for t in times]))
    cell = neuro.iaf_psc_delta(tau_m=10.0, t_ref=1.0, E_L=0.0, V_reset=0.0, V_th=1.0)
    net.population("maps", (3, 2, 2), cell)
    net.population("hidden", 30, cell)
    net.population("relays", 30, cell)
    net.population("out", 5, cell)
    net.connect("pixels", "maps", neuro.grid(kernel=[3, 3], stride=2), weight=0.3, delay=1.0)
    net.connect("maps", "hidden", neuro.all_to_all(), weight=0.5, delay=2.0)
    net.connect("hidden", "relays", neuro.one_to_one(), weight=1.0, delay=1.0)
    net.connect("relays", "hidden", neuro.fixed_indegree(n=4), weight=-0.2, delay=3.0)
    net.connect("relays", "out", neuro.pairwise_bernoulli(p=0.5), weight=0.3, delay=1.0)
    return net


@pytest.fixture(scope="module")
def ran():
    sim = neuro.compile(network())
    sim.run(STEPS)
    assert sim.counts().populations["out"].spikes > 0
    return sim


def outcome_of(sim, shares=(1.0,)):
    """What a batch of runs would have counted, each a multiple of this one."""
    counts = sim.taken().raw_counts
    names = [part.name for part in sim.program.populations]
    scaled = torch.tensor(shares, dtype=torch.float64)
    spikes = {n: torch.outer(scaled, torch.from_numpy(s).double()) for n, s in zip(names, counts.spikes, strict=True)}
    active = {n: scaled * float(a) for n, a in zip(names, counts.active, strict=True)}
    return SimpleNamespace(counts=spikes, active=active, steps=STEPS)


def billed(sim, **words):
    return lambda target: Bill(SimpleNamespace(program=sim.program), target, **words)


@pytest.mark.parametrize("target", CHIPS)
def test_it_is_the_bill_of_the_chips(ran, target):
    """Also of a batch, which takes what its mean recording takes."""
    bill, energy, outcome = billed(ran)(target), ran.energy(target), outcome_of(ran)
    assert float(bill.dynamic(outcome)) == pytest.approx(energy.dynamic_j, rel=1e-12)
    assert float(bill.static(outcome)) == pytest.approx(energy.static_j, rel=1e-12)
    for shown in (outcome, outcome_of(ran, (0.5, 1.5))):
        assert float(bill(shown)) == pytest.approx(energy.total_j, rel=1e-12)
    assert float(bill.real_time(outcome)) == pytest.approx(energy.real_time.total_j, rel=1e-12)
    assert float(bill.seconds(outcome)) == pytest.approx(energy.chip_time_s or 0.0, rel=1e-12)


def test_what_a_module_counts_is_what_event_counts(ran):
    """Spikes, updates and joules of a batch, by every layout: not only those of a stand-in."""
    module = neuro_torch.Module(network(), trainable=["maps_hidden"], dtype=torch.float64)
    outcome = module(neuro_torch.Events(2, STEPS, {}))
    raw = ran.taken().raw_counts
    for index, part in enumerate(ran.program.populations):
        assert outcome.counts[part.name].shape == (2, part.size)
        np.testing.assert_array_equal(outcome.counts[part.name].detach()[1], raw.spikes[index])
        if part.kind == "neuron":
            assert outcome.active[part.name].tolist() == [raw.active[index]] * 2
    for target in CHIPS:
        assert float(Bill(module, target)(outcome).detach()) == pytest.approx(ran.energy(target).total_j, rel=1e-12)


@pytest.mark.parametrize("target", CHIPS)
def test_the_gradient_is_what_a_spike_takes(ran, target):
    bill, outcome = billed(ran)(target), outcome_of(ran)
    for name, counts in outcome.counts.items():
        outcome.counts[name] = counts.requires_grad_()
    bill(outcome).backward()
    generator = np.random.default_rng(3)
    for name, counts in outcome.counts.items():
        k = int(generator.integers(counts.shape[1]))
        more = outcome_of(ran)
        more.counts[name][0, k] += 1.0
        change = float(bill(more).detach() - bill(outcome).detach())
        found = 0.0 if counts.grad is None else float(counts.grad[0, k])
        assert found == pytest.approx(change, rel=1e-6, abs=1e-18)


def test_mistakes(ran, messages):
    messages({target: refused(billed(ran), target) for target in ("loih", "gpu")})
