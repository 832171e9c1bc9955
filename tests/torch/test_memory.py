"""What a batch is said to take: beside what processes took, on a GPU from what the GPU has, and refused before."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import neuro
from neuro import ModelError

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import neuro_torch  # noqa: E402
from neuro_torch import memory  # noqa: E402
from neuro_torch.scan.layers import ScanTask  # noqa: E402
from neuro_torch.surrogates import FastSigmoid  # noqa: E402

FACTOR = 2.5
"""What is told may be so many times too high or too low, as `neuro_torch.memory` says."""

MEASURED = """
import json, sys
from pathlib import Path
import numpy as np, torch
import neuro, neuro_torch
from neuro_torch import memory

by, model, inputs, hidden, batch, steps, rate, dense, back = json.loads(sys.argv[1])

def network():
    net = neuro.Network("measured", resolution=1.0)
    net.population("input", inputs, neuro.spike_generator())
    weight = neuro.normal(mean=0.0, std=30.0)
    net.population("out", 10, getattr(neuro, model)())
    net.population("hidden", hidden, getattr(neuro, model)())
    net.connect("input", "hidden", neuro.all_to_all(), weight=weight, delay=1.0, name="up")
    net.connect("hidden", "out", neuro.all_to_all(), weight=weight, delay=1.0, name="down")
    if back:
        net.connect("hidden", "hidden", neuro.all_to_all(), weight=weight, delay=1.0, name="back")
    return net

def batch_of(number):
    spikes = np.random.default_rng(1).random((number, steps, inputs), dtype=np.float32) < rate
    return {"input": torch.tensor(spikes)} if dense else neuro_torch.Events.of_dense({"input": spikes})

def trained(given):
    outcome = module(given)
    (outcome.spikes["out"].sum() + outcome.V_m["out"].sum()).backward()

def bytes_now(what):
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(what))

module = neuro_torch.Module(network(), ["up", "down"], by=by)
trained(batch_of(1))
told, refuse = [], memory.refuse_large
memory.refuse_large = lambda need, task: told.append(need.total)
given = batch_of(batch)
Path("/proc/self/clear_refs").write_text("5")
before = bytes_now("VmRSS")
trained(given)
print(json.dumps([told[0], bytes_now("VmHWM") - before]))
"""

# by, model, inputs, hidden neurons, recordings, steps, spikes of an input and step, dense, recurrent
CASES = {
    "kernels": ("kernels", "iaf_psc_delta", 200, 400, 64, 200, 0.01, False, False),
    "kernels, dense": ("kernels", "iaf_psc_delta", 2000, 100, 64, 150, 0.01, True, False),
    "torch": ("torch", "iaf_psc_exp", 200, 400, 64, 150, 0.01, False, False),
    "torch, many events": ("torch", "iaf_psc_delta", 1000, 300, 64, 60, 0.1, False, False),
    "torch, recurrent": ("torch", "iaf_psc_delta", 200, 400, 64, 150, 0.01, False, True),
    "steps": ("steps", "iaf_psc_delta", 200, 400, 64, 100, 0.01, False, False),
    "steps, dense": ("steps", "iaf_psc_delta", 3000, 100, 64, 60, 0.01, True, False),
    "steps, a large model": ("steps", "iaf_cond_exp", 100, 50, 16, 16, 0.1, False, False),
}


@pytest.mark.slow
@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="no peak of a process that starts anew")
@pytest.mark.parametrize("case", CASES)
def test_what_is_told_is_about_what_a_process_takes(case):
    command = [sys.executable, "-c", MEASURED, json.dumps(CASES[case])]
    alone = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=alone, check=False)
    assert done.returncode == 0, done.stderr
    told, took = json.loads(done.stdout)
    assert took > 2e7, "too little to tell"
    assert told / FACTOR < took < told * FACTOR, f"told {told / 1e6:.0f} MB, took {took / 1e6:.0f} MB"


def network():
    cell = neuro.iaf_psc_delta(tau_m=10.0, E_L=0.0, V_reset=0.0, V_th=1.0)
    net = neuro.Network("small", resolution=1.0)
    net.population("input", 50, neuro.spike_generator())
    net.population("hidden", 20, cell)
    net.connect("input", "hidden", neuro.all_to_all(), weight=neuro.normal(mean=0.1, std=0.1), delay=1.0, name="up")
    return net


def needs(by, given, monkeypatch):
    """What modules of `network` say of some batches."""
    found = []
    monkeypatch.setattr(memory, "refuse_large", lambda need, task: found.append(need))
    module = neuro_torch.Module(network(), ["up"], by=by)
    for one in given:
        module(one)
    return [need.total for need in found]


@pytest.mark.parametrize("by", ["kernels", "torch", "steps"])
def test_more_recordings_steps_spikes_and_gradients_take_more(by, monkeypatch):
    def events(batch, steps, rate):
        return neuro_torch.Events.of_dense({"input": np.random.default_rng(2).random((batch, steps, 50)) < rate})

    batches = [events(4, 30, 0.1), events(8, 30, 0.1), events(4, 60, 0.1), events(4, 30, 0.4)]
    once, twice, longer, dense = needs(by, batches, monkeypatch)
    assert twice == pytest.approx(2 * once, rel=0.1)
    assert longer == pytest.approx(2 * once, rel=0.1)
    assert dense > once
    with torch.no_grad():
        assert needs(by, batches[:1], monkeypatch)[0] < once


def test_counting_what_steps_keep_changes_nothing():
    events = neuro_torch.Events.of_dense({"input": np.random.default_rng(3).random((2, 30, 50)) < 0.2})
    module = neuro_torch.Module(network(), ["up"], by="steps", dtype=torch.float64)
    first, second = module(events), module(events)
    assert torch.equal(first.spikes["hidden"], second.spikes["hidden"])
    assert first.spikes["hidden"].sum() > 0
    assert module.weights["up"].grad is None


@pytest.mark.parametrize("by", ["kernels", "torch", "steps"])
def test_too_large_a_batch_is_refused(by, monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 10_000_000)
    module = neuro_torch.Module(network(), ["up"], by=by)
    few, many = (neuro_torch.Events(batch, 100, {"input": ([], [], [])}) for batch in (2, 4000))
    module(few)
    told = r"a batch of 4000 recordings of 100 steps needs about \S+ GB: expected at most what is free, 0.01 GB"
    with pytest.raises(ModelError, match=told) as caught:
        module(many)
    assert "needs half of that" in caught.value.hint


def test_on_a_gpu_its_own_memory_counts(monkeypatch):
    gpu = torch.device("cuda:1")
    figures = {"mem_get_info": (5_000_000, 80_000_000), "memory_reserved": 900_000, "memory_allocated": 300_000}
    for name, value in figures.items():
        monkeypatch.setattr(torch.cuda, name, lambda device, value=value: {gpu: value}[device])
    assert memory.free(gpu) == 5_600_000
    task = ScanTask(64, 100, torch.float32, gpu, FastSigmoid(), 1.0, {}, frozenset())
    memory.refuse_large(memory.Need(64, 80_000.0, 400_000), task)
    with pytest.raises(ModelError, match=r"expected at most what is free on 'cuda:1', 0.0056 GB") as caught:
        memory.refuse_large(memory.Need(64, 100_000.0, 400_000), task)
    assert caught.value.hint == "use a batch of 26, which needs half of that"
