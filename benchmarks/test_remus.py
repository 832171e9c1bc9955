"""Object recognition: how long training takes from kept C1 spikes, and the front end of one recording."""

import time
from pathlib import Path

import pytest

from neuro.events import recordings
from neuro_recognise.methods.remus import Remus
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data" / "nmnist" / "nmnist_train1000_bin.zip"


@pytest.fixture(scope="module")
def data():
    if not RECORDINGS.is_file():
        pytest.skip("../shared is not here")
    return recordings(RECORDINGS)[::3][:300]


@pytest.mark.parametrize(("per_class", "aim"), [(2, "at most 4"), (8, "at most 12")])
def test_training(benchmark, figure, data, tmp_path_factory, per_class, aim):
    method = Remus().preset("thesis").changed({"per_class": per_class}).fitting((34, 34))
    shown = observe(method, data, cache=tmp_path_factory.getbasetemp())
    learn(method, shown.take(range(2)), "two")
    cpu = []

    def work():
        began = time.process_time()
        learn(method, shown, "all")
        cpu.append(time.process_time() - began)

    benchmark.pedantic(work, rounds=2)
    benchmark.extra_info["cpu_s"] = min(cpu)
    figure(f"300 recordings x 8 epochs, {per_class} grids a class", min(cpu), "s of one core", aim)


def test_front_end(benchmark, figure, data):
    front, events = Remus().fitting((34, 34)), [item.load() for item in data[:50]]
    front.observe(events[0])
    benchmark.pedantic(lambda: [front.observe(e) for e in events], rounds=3)
    figure("front end of a recording", benchmark.stats.stats.min / len(events) * 1e3, "ms", "at most 10")
