"""Generators whose current or rate changes: their statistics, what they refuse, and that a run may be cut anywhere."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import neuro
from neuro.core.errors import ModelError
from neuro.program.currents import Emission
from neuro.testing.connections import steered
from neuro.testing.trials import chooser

NOISE = {"mean": 50.0, "std": 120.0, "dt": 0.5}


def emitted(model: Any, targets: int = 30, steps: int = 20000) -> Any:
    """What a generator of currents sends along all its connections to some neurons, shape (steps, columns)."""
    net = neuro.Network("sent", resolution=0.1)
    net.population("source", 1, model)
    net.population("cells", targets, neuro.iaf_psc_delta())
    net.connect("source", "cells", neuro.all_to_all())
    program = neuro.compile(net, "reference", seed=3).program
    words = {word: [(0, values)] for word, values in program.populations[0].parameters.items()}
    return Emission(program, 0).during(np.arange(1, steps + 1), words)


def test_noise_is_white_of_its_mean_and_variance_and_held():
    sent = emitted(neuro.noise_generator(**NOISE))
    assert sent.shape == (20000, 30)
    drawn = sent.reshape(4000, 5, 30)
    assert np.all(drawn == drawn[:, :1])  # dt is 5 steps
    z = (drawn[:, 0] - NOISE["mean"]) / NOISE["std"]
    n = z.size
    assert abs(z.mean()) < 4.0 / np.sqrt(n)
    assert abs(z.var() - 1.0) < 4.0 * np.sqrt(2.0 / n)
    assert abs((z**4).mean() - 3.0) < 4.0 * np.sqrt(96.0 / n)
    for lag in (1, 2, 7):
        assert abs((z[lag:] * z[:-lag]).mean()) < 4.0 / np.sqrt(n)
    power = (np.abs(np.fft.rfft(z, axis=0)[1:-1]) ** 2).mean(axis=1) / len(z)
    assert np.abs(power.reshape(-1, 1)[:1990].reshape(10, -1).mean(axis=1) - 1.0).max() < 4.0 / np.sqrt(199 * 30)


def test_connections_have_noise_of_their_own_unless_it_is_shared():
    own = emitted(neuro.noise_generator(**NOISE))[::5]
    apart = np.corrcoef(own.T) - np.eye(30)
    assert np.abs(apart).max() < 5.0 / np.sqrt(4000)
    assert emitted(neuro.noise_generator(**NOISE, individual_noise=False)).shape == (20000, 1)


def test_the_variance_of_noise_follows_a_sine():
    sent = emitted(neuro.noise_generator(std=100.0, std_mod=80.0, frequency=5.0, phase=90.0), targets=400, steps=4000)
    t = 0.1 * np.arange(1, 4001, 10)
    expected = 100.0**2 + 80.0**2 * np.sin(2 * np.pi * 0.005 * t + np.pi / 2)
    assert np.abs(sent[::10].var(axis=1) / expected - 1.0).max() < 5.0 * np.sqrt(2.0 / 400)


def spikes_of(model: Any, n: int, ms: float) -> tuple[Any, Any]:
    """Steps and neurons."""
    net = neuro.Network("emitting", resolution=0.1)
    net.population("source", n, model)
    net.probe("all", "source")
    sim = neuro.compile(net, "event", seed=5)
    sim.run(ms)
    times, ids = sim.spikes("source")
    return np.rint(times / 0.1).astype(int), ids


def test_a_sinusoidal_rate_is_followed_and_cut_off_at_zero():
    model = neuro.sinusoidal_poisson_generator(rate=100.0, amplitude=300.0, frequency=10.0, phase=30.0)
    steps, _ = spikes_of(model, 2000, 200.0)
    k = np.arange(1, 2001)
    rate = np.maximum(0.0, 100.0 + 300.0 * np.sin(2 * np.pi * 10.0 * k * 1e-4 + np.pi / 6))
    counts = np.bincount(steps, minlength=2001)[1:]
    assert counts[rate == 0.0].sum() == 0
    expected, found = (each.reshape(40, 50).sum(axis=1) for each in (rate * 1e-4 * 2000, counts))
    some = expected > 20
    assert some.sum() > 20
    assert np.abs((found - expected)[some] / np.sqrt(expected[some])).max() < 4.5


def test_an_inhomogeneous_rate_holds_from_its_time_on():
    model = neuro.inhomogeneous_poisson_generator(rate_times=[10.0, 30.0], rate_values=[200.0, 1000.0])
    steps, _ = spikes_of(model, 1000, 60.0)
    before, first, second = (
        np.count_nonzero((steps >= a) & (steps < b)) for a, b in ((0, 100), (100, 300), (300, 601))
    )
    assert before == 0
    assert abs(first - 4000) < 4.5 * np.sqrt(4000)
    assert abs(second - 30100) < 4.5 * np.sqrt(30100)


@pytest.mark.parametrize("shape", [1, 3, 10])
def test_intervals_of_a_gamma_process(shape):
    rate, n = 50.0, 300
    steps, ids = spikes_of(neuro.gamma_sup_generator(rate=rate, gamma_shape=shape), n, 2000.0)
    gaps = np.concatenate([np.diff(np.sort(steps[ids == i])) for i in range(n)])
    p = rate * shape * 1e-4
    assert abs(gaps.mean() / (shape / p) - 1.0) < 0.02  # a long interval is cut off by the end
    assert abs(gaps.var() / (shape * (1 - p) / p**2) - 1.0) < 0.06


def test_superposed_gamma_processes_come_to_their_rate_and_more_even_counts():
    rate, n_proc, n, ms = 10.0, 200, 200, 1000.0
    steps, ids = spikes_of(neuro.gamma_sup_generator(rate=rate, gamma_shape=4, n_proc=n_proc, start=5.0), n, ms + 5.0)
    assert steps.min() > 50
    counts = np.bincount(ids, minlength=n)
    expected = rate * n_proc * ms / 1000.0
    assert abs(counts.mean() - expected) < 4.0 * np.sqrt(expected / n)
    assert counts.var() < 0.5 * expected  # a Poisson process has 1.0, gamma processes of shape 4 come to 1/4


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_a_run_may_be_cut_and_continued_from_a_file(backend, tmp_path):
    def made(**options: Any) -> neuro.Simulation:
        net = steered(neuro.noise_generator(mean=100.0, std=300.0, dt=0.7), 1)
        net.connect("source", "cells", neuro.all_to_all(), neuro.static(receptor="ex"), weight=0.5, name="filtered")
        net.population("gamma", 3, neuro.gamma_sup_generator(rate=60.0, gamma_shape=3, n_proc=30))
        net.population("steps", 3, neuro.inhomogeneous_poisson_generator(rate_times=[1.0, 9.0], rate_values=[3e3, 9e2]))
        for name in ("gamma", "steps"):
            net.connect(name, "cells", neuro.one_to_one(), weight=30.0, delay=0.5)
        return neuro.compile(net, backend, seed=4, **options)

    whole, cut, later = made(), made(threads=2) if backend == "event" else made(), made()
    whole.run(11.0)
    whole.set("source", mean=-40.0)
    whole.set_weights("to_cells", 2.0)
    whole.run(19.0)
    for _ in range(110):
        cut.run(0.1)
    cut.set("source", mean=-40.0)
    cut.set_weights("to_cells", 2.0)
    cut.run(0.3)
    if backend == "reference":
        cut.save(tmp_path / "state.h5")
        later.restore(tmp_path / "state.h5")
        later.run(18.7)
    cut.run(18.7)
    for other in (cut, later) if backend == "reference" else (cut,):
        for name in ("cells", "slow"):
            assert np.array_equal(whole.get(name, "V_m"), other.get(name, "V_m"))
    cut.reset()
    whole.reset()
    for sim in (whole, cut):
        sim.run(30.0)
    assert np.array_equal(whole.get("cells", "V_m"), cut.get("cells", "V_m"))


def test_a_state_on_event_continues(tmp_path):
    sims = [neuro.compile(steered(neuro.noise_generator(std=300.0), 1), "event", seed=4) for _ in range(2)]
    sims[0].run(11.0)
    sims[0].set("source", mean=-40.0)
    sims[0].set_weights("to_cells", 2.0)
    sims[0].run(0.3)
    sims[0].save(tmp_path / "state.h5")
    sims[1].restore(tmp_path / "state.h5")
    for sim in sims:
        sim.run(20.0)
    assert np.array_equal(sims[0].get("cells", "V_m"), sims[1].get("cells", "V_m"))


def noisy(backend: str, steps: int, ms: float, change: Callable[[neuro.Simulation, int], None], **words: float):
    """Potentials of cells with noise, after so many stretches, each of which begins with a change."""
    net = neuro.Network("noisy", resolution=0.1)
    net.population("noise", 1, neuro.noise_generator(std=50.0, **words))
    net.population("cells", 3, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.all_to_all(), delay=0.2, name="w")
    sim = neuro.compile(net, backend, seed=2)
    for k in range(steps):
        change(sim, k)
        sim.run(ms)
    return sim.get("cells", "V_m")


def test_numbers_set_at_every_step_are_those_of_the_draw_that_holds():
    v = {}
    for backend in ("reference", "event"):
        net = neuro.Network("steered", resolution=0.1)
        net.population("noise", 1, neuro.noise_generator(std=50.0, dt=5.0))
        net.population("cells", 3, neuro.iaf_psc_exp())
        net.connect("noise", "cells", neuro.all_to_all(), delay=0.2)
        sim = neuro.compile(net, backend, seed=2)
        for k in range(120):
            sim.set("noise", mean=float(k))
            sim.run(0.1)
        v[backend] = sim.get("cells", "V_m")
    assert np.array_equal(v["event"], v["reference"])


def test_weights_of_noise_that_are_set_hold_from_the_next_step_on():
    v = {}
    for backend in ("reference", "event"):
        net = neuro.Network("weighted", resolution=0.1)
        net.population("noise", 1, neuro.noise_generator(mean=300.0, std=50.0))
        net.population("cells", 3, neuro.iaf_psc_exp())
        net.connect("noise", "cells", neuro.all_to_all(), delay=0.2, name="w")
        sim = neuro.compile(net, backend, seed=2)
        for weight in (1.0, 2.0, 0.5):
            sim.set_weights("w", weight)
            sim.run(2.0)
        v[backend] = sim.get("cells", "V_m")
    assert np.abs(v["event"] - v["reference"]).max() < 1e-12


def test_chips_take_listed_currents_and_rates_and_refuse_what_changes_at_every_step():
    net = neuro.Network("chip", resolution=1.0)
    net.population("steps", 1, neuro.step_current_generator(amplitude_times=[5.0, 60.0], amplitude_values=[400.0, 0.0]))
    net.population("rates", 5, neuro.inhomogeneous_poisson_generator(rate_times=[80.0], rate_values=[10.0]))
    net.population("cells", 5, neuro.iaf_psc_exp())
    net.connect("steps", "cells", neuro.all_to_all())
    net.connect("rates", "cells", neuro.one_to_one(), weight=200.0)
    spikes = {}
    for backend in ("event", "loihi"):
        sim = neuro.compile(net, backend, seed=2)
        sim.run(200.0)
        spikes[backend] = sim.spikes("cells")[0]
        times, ids = sim.spikes("rates")
        spikes[f"{backend} rates"] = np.stack([times, ids])
    assert np.array_equal(np.unique(spikes["loihi rates"], axis=1), np.unique(spikes["event rates"], axis=1))
    early = {
        name: np.count_nonzero((times > 5) & (times < 62)) for name, times in spikes.items() if "rates" not in name
    }
    assert early["event"] > 0
    assert abs(early["loihi"] - early["event"]) <= 5
    assert not np.any((spikes["loihi"] > 65) & (spikes["loihi"] < 80))
    net.population("noise", 1, neuro.noise_generator(std=10.0))
    net.connect("noise", "cells", neuro.all_to_all())
    with pytest.raises(ModelError) as told:
        neuro.compile(net, "loihi")
    assert "population 'noise': noise_generator" in str(told.value)
    assert "its current changes at every step, and the host writes a current only when it changes" in str(told.value)


def onto_two(model: Any, shape: int = 2) -> None:
    """Compile a generator that reaches all of two cells."""
    net = neuro.Network("refused", resolution=0.1)
    net.population("source", shape, model)
    net.population("cells", 2, neuro.iaf_psc_exp())
    net.connect("source", "cells", neuro.all_to_all())
    neuro.compile(net, "reference")


def test_mistakes_are_told(messages):
    messages.calls(globals())


def test_what_is_fixed_is_told(messages):
    net = neuro.Network("fixed", resolution=0.1)
    net.population("noise", 1, neuro.noise_generator(std=5.0))
    net.population("steps", 1, neuro.step_current_generator(amplitude_times=[1.0], amplitude_values=[1.0]))
    net.population("gamma", 1, neuro.gamma_sup_generator(rate=5.0))
    net.population("cells", 2, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.all_to_all())
    sim = neuro.compile(net, "reference")
    sim.set("noise", std_mod=5.0)
    messages.calls({"sim": sim})


def test_currents_and_rates_change_within_a_trial():
    def run(backend: str) -> Any:
        net = chooser()
        net.population(
            "steps", 1, neuro.step_current_generator(amplitude_times=[7.0, 33.0], amplitude_values=[9.0, 2.0])
        )
        net.population("waves", 1, neuro.ac_generator(amplitude=5.0, frequency=30.0))
        net.population("rates", 54, neuro.inhomogeneous_poisson_generator(rate_times=[12.0], rate_values=[100.0]))
        net.connect("steps", "maps", neuro.all_to_all(), weight=0.1)
        net.connect("waves", "maps", neuro.all_to_all(), weight=0.1, delay=3.0)
        net.connect("rates", "maps", neuro.one_to_one(), weight=1.0)
        sim = neuro.compile(net, backend, seed=2)
        told = sim.trials([3.0, 3.0, 4.0, 9.0], [0, 40, 7, 11], [0, 2, 3, 4])
        return told, sim.get("maps", "V_m"), sim.spikes("rates")[0]

    (told, v, times), (expected, expected_v, expected_times) = run("event"), run("reference")
    assert np.array_equal(told.winner, expected.winner)
    assert np.abs(v - expected_v).max() < 1e-9
    assert np.array_equal(times, expected_times)
    assert times.size
