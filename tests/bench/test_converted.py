"""What a converted network says is what its layers say in whole numbers."""

import numpy as np
import pytest

import neuro
from neuro_bench import Examples, Spikes
from neuro_bench.spiking import OUTPUT, _Converted, spike_counts

LEVELS = 8


def drawn(rng, n=5):
    spikes = Spikes.of_dense(rng.random((n, 7, 2, 9, 9)) < 0.15, 2.5)
    shapes = ((3, 2, 5, 5), (4, 3, 5, 5), (5, 4, 3, 3), (3, 20))
    weights = [rng.normal(0.0, 0.4 if len(shape) == 4 else 1.0, shape).astype(np.float32) for shape in shapes]
    weights[0], weights[1] = weights[0] * 0.6, weights[1] * 0.3
    weights = [(weight, rng.normal(0.0, 0.4, len(weight))) for weight in weights]
    return Examples(np.zeros((n, 1, 1, 1), np.float32), np.zeros(n, np.int64), ("a", "b", "c"), spikes), weights


def in_whole_numbers(counts, weights):
    """Rectified sums, rounded, layer by layer; and the potentials of the classes."""
    torch = pytest.importorskip("torch", reason="the extra torch is not installed")
    x, said = torch.from_numpy(counts).double(), []
    for weight, bias in weights[:-1]:
        w, b = torch.from_numpy(weight).double(), torch.from_numpy(bias)
        x = torch.floor(torch.nn.functional.conv2d(x, w, b, stride=2, padding=w.shape[2] // 2) + 0.5).clamp_min(0.0)
        said.append(x.numpy())
    return said, (x.flatten(1) @ torch.from_numpy(weights[-1][0]).double().T).numpy()


def test_each_layer_fires_its_rectified_sum_in_whole_numbers():
    rng = np.random.default_rng(3)
    (shown, weights), (_, second) = drawn(rng), drawn(rng)
    said, potentials = in_whole_numbers(spike_counts(shown.spikes, 5), weights)
    assert 0 < max(each.max() for each in said) <= LEVELS
    potentials = potentials + in_whole_numbers(spike_counts(shown.spikes, 5), second)[1]
    made = _Converted([weights, second], shown.spikes, LEVELS)
    sim = neuro.compile(made.net)
    for k in range(5):
        classes, _ = made._show(sim, shown.take(np.array([k])))
        for layer in range(3):
            _, ids = sim.spikes(f"maps_0_{layer}")
            assert np.array_equal(np.bincount(ids, minlength=said[layer][k].size), said[layer][k].ravel())
        assert sim.get(OUTPUT, "V_m") == pytest.approx(potentials[k], abs=1e-9)
        assert classes[0] == potentials[k].argmax()
    shown, _ = drawn(np.random.default_rng(4))
    assert spike_counts(shown.spikes, 5).sum() == len(shown.spikes.at)
    assert spike_counts(shown.spikes.take(np.array([2]), 5), 1)[0].sum() == (shown.spikes.example == 2).sum()
    _, weights = drawn(np.random.default_rng(4))
    with pytest.raises(neuro.ModelError, match=r"steps of 0\.5 ms: expected 1 ms or more"):
        _Converted([weights], Spikes.of_dense(np.zeros((1, 2, 2, 9, 9)), 0.5), LEVELS)


@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_chips_run_it_and_say_nearly_as_much(backend):
    shown, weights = drawn(np.random.default_rng(3))
    weights[1] = weights[1][0], np.array([3.0, -3.0, 3.0, -3.0])  # without room beside what holds the layer
    made = _Converted([weights], shown.spikes, LEVELS, backend)
    exact, sim = neuro.compile(made.net), neuro.compile(made.net, backend=backend)
    for k in range(5):
        one = shown.take(np.array([k]))
        made._show(exact, one)
        made._show(sim, one)
        for part in exact.program.populations:
            if part.name.startswith("maps"):
                said, wanted = (np.bincount(each.spikes(part.name)[1], minlength=part.size) for each in (sim, exact))
                assert np.abs(said - wanted).mean() < 0.3 * wanted.mean() + 0.05
    costs = made.costs(shown)
    assert not costs.refused
    assert [name.split(",")[0] for name in costs.joules] == ["Loihi", "Loihi", "SpiNNaker", "SpiNNaker"]
    macs = 6 * len(shown.spikes.at) / len(shown) + len(shown.classes)
    assert costs.host["macs"] == pytest.approx(macs), "6 operations a spike of the input, and a comparison a class"
    assert costs.host["joules"] == pytest.approx(macs * 8.6e-9)
