"""Generators that could never emit: a beginning after the end, and a recording that is over before it begins."""

import pytest

import neuro
from neuro import ModelError
from neuro.compiler.resolve import compile_network
from neuro.events import Events

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
RECORDING = Events([1000, 3000], [0, 1], [0, 1], [0, 1], (2, 2))


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


def camera(**words) -> None:
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(events=RECORDING, **words))
    compile_network(net, 1)


def test_an_offset_beyond_the_recording():
    with pytest.raises(ModelError) as caught:
        camera(offset=1e6)
    assert str(caught.value).partition(": ")[2] == (
        "population 'eyes': event_camera.offset = 1000000 ms: the recording has no event after that"
    )
    with pytest.raises(ModelError, match=r"event_camera.origin = 3001 us: the recording has no event after that"):
        camera(origin=3001)
    camera(offset=2)
    camera(origin=3000)


def test_an_offset_beyond_a_file(tmp_path):
    file = tmp_path / "walk.aedat4"
    neuro.events.save(RECORDING, file)
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=str(file), offset=2.001))
    with pytest.raises(ModelError, match=r"event_camera.offset = 2.001 ms: the recording has no event after that"):
        compile_network(net, 1)
