"""Generators that could never emit: a beginning after the end."""

import re

import neuro
from refused import refused


def test_start_after_stop(messages):
    messages.calls({})
    neuro.poisson_generator(rate=100.0, start=10, stop=10)


def test_in_yaml(tmp_path):
    file = tmp_path / "net.yaml"
    file.write_text(
        "neuro: 1\npopulations:\n"
        "  noise: {model: {poisson_generator: {rate: 100, start: 10 ms, stop: 5 ms}}, shape: 3}\n"
    )
    assert re.search(r"net.yaml:3:\d+: population 'noise': poisson_generator.stop = 5 ms", refused(neuro.load, file))
