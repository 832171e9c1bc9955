"""NeuroBench's metrics from counters, against plain NumPy and, where it is installed, the harness itself."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest

import neuro
from neuro.chips import chip, neurobench, price
from refused import refusals_of

SIZES = (34, 16, 4)
SAMPLES, TICKS = 8, 20
BETA = 0.9
THRESHOLD = 1.0


def layers():
    """Weights of two layers, a quarter of them 0, on a grid that float32 holds."""
    rng = np.random.default_rng(3)
    made = []
    for n_pre, n_post in pairwise(SIZES):
        w = np.round(rng.normal(0.05, 0.3, (n_pre, n_post)) * 1024) / 1024
        made.append(np.where(rng.random(w.shape) < 0.24, 0.0, w))
    return made


def inputs():
    return np.random.default_rng(5).random((SAMPLES, TICKS, SIZES[0])) < 0.2


def by_hand(w, x):
    """Two layers without delay as plain arrays: spikes of all layers and V after each step."""
    spikes, potentials = [x], []
    for weight in w:
        v = np.zeros((SAMPLES, weight.shape[1]))
        fired, trace = [], []
        for tick in range(TICKS):
            v = BETA * v + spikes[-1][:, tick] @ weight
            now = v >= THRESHOLD
            v = np.where(now, 0.0, v)
            fired.append(now)
            trace.append(v)
        spikes.append(np.stack(fired, axis=1))
        potentials.append(np.stack(trace, axis=1))
    return spikes, potentials


def network(w):
    lif = neuro.iaf_psc_delta(tau_m=-1.0 / math.log(BETA), E_L=0.0, V_reset=0.0, V_th=THRESHOLD, t_ref=0.0)
    net = neuro.Network("layers", resolution=1.0)
    net.population("input", SIZES[0], neuro.spike_generator())
    net.population("hidden", SIZES[1], lif)
    net.population("out", SIZES[2], lif)
    net.connect("input", "hidden", neuro.all_to_all(), weight=w[0], delay=1.0, name="first")
    net.connect("hidden", "out", neuro.all_to_all(), weight=w[1], delay=1.0, name="second")
    net.probe("v_hidden", "hidden", "V_m", every=1.0)
    net.probe("v_out", "out", "V_m", every=1.0)
    return net


def ran(w, x):
    """The network in neuro: each sample needs two steps more, for the delays; V at 0 before the next."""
    sim = neuro.compile(network(w), "reference")
    steps = TICKS + 2
    for sample in range(SAMPLES):
        tick, neuron = np.nonzero(x[sample])
        sim.inject("input", sim.time + 1.0 + tick, neuron)
        sim.run(float(steps))
        sim.set("hidden", V_m=0.0)
        sim.set("out", V_m=0.0)
    traces = {}
    for late, name in ((1, "hidden"), (2, "out")):
        values = sim.trace(f"v_{name}")[1][-SAMPLES * steps :].reshape(SAMPLES, steps, -1)
        traces[name] = values[:, late : late + TICKS]
    return sim, traces


@pytest.fixture(scope="module")
def run():
    w, x = layers(), inputs()
    return w, x, *ran(w, x)


@pytest.fixture(scope="module")
def report(run):
    _, _, sim, traces = run
    return neurobench(sim.program, sim._engine.counts(), samples=SAMPLES, steps=TICKS, potentials=traces)


def test_the_network_is_the_one_computed_by_hand(run):
    w, x, sim, traces = run
    spikes, potentials = by_hand(w, x)
    assert [sim.counts().populations[name].spikes for name in ("input", "hidden", "out")] == [s.sum() for s in spikes]
    assert min(s.sum() for s in spikes) > 30
    for name, v in zip(("hidden", "out"), potentials, strict=True):
        assert traces[name] == pytest.approx(v, abs=1e-12)


def test_the_harness_definitions_in_numpy(run, report):
    w, x, _, _ = run
    spikes, potentials = by_hand(w, x)
    acs = sum(
        int(((w_layer != 0).T.astype(int) @ before[sample, tick]).sum())
        for w_layer, before in zip(w, spikes[:-1], strict=True)
        for sample in range(SAMPLES)
        for tick in range(TICKS)
    )
    dense = TICKS * sum(weight.size for weight in w)
    assert report["synaptic_operations"] == {"effective_acs": acs / SAMPLES, "effective_macs": 0.0, "dense": dense}
    zeros = sum(int((weight == 0).sum()) for weight in w)
    assert report["connection_sparsity"] == round(zeros / sum(weight.size for weight in w), 4)
    fired, outputs = (sum(f(s) for s in spikes[1:]) for f in (np.count_nonzero, np.size))
    assert report["activation_sparsity"] == (outputs - fired) / outputs
    updates = sum(v[:, 0].size + np.count_nonzero(v[:, 1:] - v[:, :-1]) for v in potentials)
    assert report["membrane_updates"] == updates / SAMPLES
    assert report["neuron_ops"] == {"effective": 4 * updates / SAMPLES, "dense": 4.0 * TICKS * 20, "left_out": []}


@pytest.mark.filterwarnings("ignore")
def test_operations_and_sparsity_of_connections_are_those_of_the_package(run, report):
    pytest.importorskip("neurobench", reason="neurobench is not installed: make test-oracles")
    torch = pytest.importorskip("torch", reason="the extra torch is not installed")
    from neurobench.benchmarks import Benchmark
    from neurobench.metrics.static import ConnectionSparsity
    from neurobench.metrics.workload import SynapticOperations
    from neurobench.models import TorchModel

    w, x, _, _ = run
    shown = [torch.as_tensor(np.asarray(s), dtype=torch.float32) for s in by_hand(w, x)[0][:-1]]

    class Layers(torch.nn.Module):
        """Each layer sees, tick by tick, the spikes of the layer before."""

        def __init__(self):
            super().__init__()
            each = [torch.nn.Linear(*weight.shape, bias=False) for weight in w]
            for layer, weight in zip(each, w, strict=True):
                layer.weight.data = torch.as_tensor(weight.T.copy(), dtype=torch.float32)
            self.layers = torch.nn.ModuleList(each)

        def forward(self, _):
            for tick in range(TICKS):
                out = [layer(spikes[:, tick]) for layer, spikes in zip(self.layers, shown, strict=True)]
            return out[-1]

    data = torch.utils.data.TensorDataset(shown[0], torch.zeros(SAMPLES))
    loader = torch.utils.data.DataLoader(data, batch_size=SAMPLES)
    theirs = Benchmark(TorchModel(Layers()), loader, [], [], [[ConnectionSparsity], [SynapticOperations]]).run(
        quiet=True
    )
    ops = theirs["SynapticOperations"]
    ours = report["synaptic_operations"]
    assert ours["effective_acs"] == pytest.approx(ops["Effective_ACs"], rel=1e-6)
    assert (ours["effective_macs"], ours["dense"]) == (ops["Effective_MACs"], pytest.approx(ops["Dense"], rel=1e-6))
    assert report["connection_sparsity"] == pytest.approx(theirs["ConnectionSparsity"], abs=1e-3)


def test_what_stands_beside(run, report):
    _, x, sim, _ = run
    counts = sim.counts()
    assert report["parameter_count"] == 34 * 16 + 16 * 4
    assert report["membrane_updates_dense"] == TICKS * 20
    assert report["membrane_updates_performed"] == counts.neuron_updates_active / SAMPLES
    spikes = report["spikes"]
    assert spikes["in"] == x.sum() / SAMPLES
    assert spikes["in"] + spikes["hidden"] + spikes["out"] == spikes["total"] == counts.spikes / SAMPLES
    assert spikes["per_population"]["out"] == spikes["out"] > 0
    assert report["packets"] == spikes["in"] + spikes["hidden"]
    assert (report["weight_writes"], report["energy_j"], report["hops"]) == (0, None, None)
    # 608 weights, 2 shared delays, 2 empty row ends and targets, parameters and a state each of 20 neurons
    weights = 8 * 608 + 2 * 4
    parameters = sum(p.nbytes for part in sim.program.populations for p in part.parameters.values())
    states = 8 * sum(part.size * len(part.model.states) for part in sim.program.populations)
    assert report["footprint_bytes"] == weights + parameters + states
    assert json.loads(json.dumps(report)) == report


def test_the_bill_of_a_sample(run):
    _, _, sim, _ = run
    counts = sim._engine.counts()
    energy = price(sim.program, counts, None, chip("spinnaker2"))
    report = neurobench(sim.program, counts, samples=SAMPLES, energy=energy, stride_s=0.02)
    parts = report["energy_j"]
    assert parts.pop("model") == "spinnaker2"
    assert parts["total"] == pytest.approx(energy.total_j / SAMPLES, rel=1e-12)
    assert parts["synop"] == pytest.approx(0.45e-9 * sim.counts().synaptic_ops / SAMPLES, rel=1e-12)
    assert parts["neuron"] == pytest.approx(2.19e-9 * 20 * (TICKS + 2), rel=1e-12)
    assert (parts["route"], parts["learn"], parts["static"]) == (0, 0, 0)
    assert len(report["table_source"]) == 2
    assert "Höppner et al." in report["table_source"][0]
    assert report["model_execution_rate_hz"] == 50.0
    assert report["steps_per_sample"] == TICKS + 2


def test_several_spikes_in_a_step_are_multiplied():
    net = neuro.Network("several", resolution=1.0)
    net.population("twice", 2, neuro.spike_generator(spike_times=((1.0, 1.0, 3.0), ())))
    net.population("once", 2, neuro.spike_generator(spike_times=((1.0,), (2.0,))))
    net.population("out", 3, neuro.iaf_psc_delta())
    net.connect("twice", "out", neuro.all_to_all(), weight=np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]), delay=1.0)
    net.connect("once", "out", neuro.pairs([0, 0, 1], [0, 2, 1]), weight=np.array([1.0, 1.0, 0.0]), delay=1.0)
    sim = neuro.compile(net, "reference")
    sim.run(4.0)
    report = neurobench(sim.program, sim._engine.counts())
    # two events of the first neuron, each along two weights that are not 0; one event along two
    assert report["synaptic_operations"] == {"effective_acs": 2, "effective_macs": 4, "dense": 4 * (6 + 6)}
    assert report["connection_sparsity"] == round((1 + 4) / 12, 4)
    assert report["membrane_updates"] is None
    assert report["neuron_ops"]["effective"] is None


@pytest.mark.parametrize("padding", [0, 2])
@pytest.mark.parametrize("stride", [1, 2])
def test_a_grid_is_a_convolution(stride, padding):
    rng = np.random.default_rng(1)
    kernels = rng.normal(size=(3, 2, 3, 3)) * (rng.random((3, 2, 3, 3)) < 0.6)
    net = neuro.Network("grid", resolution=1.0)
    net.population("input", (2, 6, 7), neuro.spike_generator())
    rows, columns = ((n + 2 * padding - 3) // stride + 1 for n in (6, 7))
    net.population("maps", (3, rows, columns), neuro.iaf_psc_delta())
    net.connect("input", "maps", neuro.grid((3, 3), stride, padding), weight=kernels, delay=1.0)
    sim = neuro.compile(net, "reference")
    x = rng.random((2, 6, 7)) < 0.4
    sim.inject("input", np.ones(x.sum()), np.flatnonzero(x))
    sim.run(2.0)
    padded = np.pad(x, ((0, 0), (padding, padding), (padding, padding)))
    real = np.pad(np.ones_like(x), ((0, 0), (padding, padding), (padding, padding)))
    acs = dense = 0
    for r in range(rows):
        for c in range(columns):
            here = (slice(None), slice(r * stride, r * stride + 3), slice(c * stride, c * stride + 3))
            acs += int((padded[here] * (kernels != 0)).sum())
            dense += int(3 * real[here].sum())
    report = neurobench(sim.program, sim._engine.counts())
    assert report["synaptic_operations"] == {"effective_acs": acs, "effective_macs": 0, "dense": 2 * dense}
    assert report["connection_sparsity"] == round(float((kernels == 0).mean()), 4)


def test_mistakes(run, messages):
    program, counts = run[2].program, run[2]._engine.counts()
    messages(refusals_of(messages.cases, globals() | locals()))
