"""Generators that could never emit: a beginning after the end."""

import pytest

import neuro
from neuro import ModelError

WORDS = {
    "poisson_generator": {"rate": 100.0},
    "inhomogeneous_poisson_generator": {"rate_times": [1.0], "rate_values": [1.0]},
    "sinusoidal_poisson_generator": {"rate": 100.0},
    "gamma_sup_generator": {"rate": 100.0},
    "dc_generator": {"amplitude": 1.0},
    "ac_generator": {"amplitude": 1.0},
    "noise_generator": {"std": 1.0},
    "step_current_generator": {"amplitude_times": [1.0], "amplitude_values": [1.0]},
    "event_camera": {},
}


@pytest.mark.parametrize("name", WORDS)
def test_start_after_stop(name):
    with pytest.raises(ModelError) as caught:
        getattr(neuro, name)(**WORDS[name], start=10, stop=5)
    message = str(caught.value)
    assert message.startswith("test_silent_generators.py:")
    assert message.endswith(f": {name}.stop = 5 ms: expected at least start = 10 ms")
    getattr(neuro, name)(**WORDS[name], start=10, stop=10)


def test_in_yaml(tmp_path):
    file = tmp_path / "net.yaml"
    file.write_text(
        "neuro: 1\npopulations:\n"
        "  noise: {model: {poisson_generator: {rate: 100, start: 10 ms, stop: 5 ms}}, shape: 3}\n"
    )
    with pytest.raises(ModelError, match=r"net.yaml:3:\d+: population 'noise': poisson_generator.stop = 5 ms"):
        neuro.load(file)
