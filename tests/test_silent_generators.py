"""Generators that could never emit: a beginning after the end."""

import re

import neuro
from neuro.compiler.resolve import compile_network
from neuro.events import Events
from refused import refused

RECORDING = Events([1000, 3000], [0, 1], [0, 1], [0, 1], (2, 2))


def test_start_after_stop(tmp_path, messages):
    neuro.events.save(RECORDING, tmp_path / "walk.aedat4")
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(file=str(tmp_path / "walk.aedat4"), offset=2.001))
    messages.calls(globals() | {"beside": net})
    neuro.poisson_generator(rate=100.0, start=10, stop=10)
    camera(offset=2)
    camera(origin=3000)


def test_in_yaml(tmp_path):
    file = tmp_path / "net.yaml"
    file.write_text(
        "neuro: 1\npopulations:\n"
        "  noise: {model: {poisson_generator: {rate: 100, start: 10 ms, stop: 5 ms}}, shape: 3}\n"
    )
    assert re.search(r"net.yaml:3:\d+: population 'noise': poisson_generator.stop = 5 ms", refused(neuro.load, file))


def camera(**words) -> None:
    net = neuro.Network("seen")
    net.population("eyes", "auto", neuro.event_camera(events=RECORDING, **words))
    compile_network(net, 1)
