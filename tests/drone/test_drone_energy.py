"""What a control step takes: by hand, beside dense networks, and whether it is in time."""

import json

import numpy as np
import pytest

from neuro_drone.energy import priced, show, words
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

SHORT = load("A60", **{"task": {"ball": {"lap": 0.75, "speed": 0.15}}})  # a lap of 250 steps
MACS = 64 * 64 + 64 * 64 + 64 * 9


@pytest.fixture(scope="module")
def bills():
    return priced(train(SHORT, "static"), ("loihi", "spinnaker", "cpu"))


def test_bills(bills, capsys):
    told = json.loads(words(bills))
    each = told["per_step"]
    assert (told["steps"], each["network_steps"], told["step_us"]) == (250, 20, 20_000)
    assert each["synaptic_ops"] == pytest.approx(4 * each["input_spikes"])
    _, spinnaker, cpu = bills.spiking
    dynamic = each["synaptic_ops"] * 13.3e-9 + each["neuron_updates"] * 26e-9
    assert spinnaker.dynamic_j == pytest.approx(dynamic + spinnaker.by_cost()["packet"])
    assert cpu.total_j == pytest.approx(20 * 256 * 8.6e-9)
    assert all(bill.of == "control step" for bill in bills.spiking)
    assert [(d.target, d.macs, d.joules) for d in bills.dense] == [
        ("cpu", MACS, pytest.approx(MACS * 8.6e-9)),
        ("gpu", MACS, pytest.approx(MACS * 0.3e-9)),
    ]
    loihi, spinnaker, cpu = json.loads(words(bills))["bills"]
    assert (loihi["in_time"], spinnaker["in_time"], cpu["in_time"]) == (True, True, None)
    assert spinnaker["time_us"] == pytest.approx(20_000)  # 1 ms of network in 1 ms
    assert loihi["share_of_step"] == pytest.approx(loihi["time_us"] / 20_000)
    fine = priced(train(SHORT, "static", settings={"resolution": 0.5}), ("spinnaker",))
    assert json.loads(words(fine))["bills"][0]["in_time"] is False
    show(bills)
    assert "Davies" not in capsys.readouterr().out
    show(bills, sources=True)
    out = capsys.readouterr().out
    assert all(word in out for word in ("energy per control step of 20 ms; static in", "dqn: 64-64-64-9"))
    assert all(word in out for word in ("Davies et al., IEEE Micro 38(1):82, 2018", "not in the bill: the camera"))
    assert bills.spiking[0].real_time.static_j == pytest.approx(20e-3 * 0.104)
    (row,) = [line for line in out.splitlines() if line.split()[:1] == ["loihi"]]
    assert " 2.08 mJ (580 uJ to 3.42 mJ) " in row
    assert row.split()[-1] == "yes"
    shapes = {0: (16, 64), 2: (16, 16), 4: (9, 16)}
    learnt = {f"q_net.q_net.{k}.weight": np.zeros(shape, np.float32) for k, shape in shapes.items()}
    learnt |= {f"q_net.q_net.{k}.bias": np.zeros(shape[0], np.float32) for k, shape in shapes.items()}
    model = Model("dqn", SHORT, 0, 1, 100, {"hidden": 16}, learnt=learnt)
    bills = priced(model, ("loihi", "gpu"))
    assert [(d.target, d.what, d.macs) for d in bills.dense] == [("gpu", "dqn: 64-16-16-9", 64 * 16 + 16 * 16 + 16 * 9)]
    assert bills.spiking == ()
