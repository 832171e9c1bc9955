"""Energy as fast as the chip can, and in real time: what a chip takes that waits for events."""

import json

import pytest

from bills import STEPS, counted, placed
from neuro.chips import chip, neurobench, price

REAL = STEPS * 1e-3
"""Seconds that the run lasts."""


@pytest.fixture(scope="module")
def run():
    return counted()


def table(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    return chip(path)


def test_a_fast_chip_waits_in_real_time(run):
    bill = price(*run, placed(), chip("loihi"))
    real = bill.real_time
    assert (bill.clock, real.clock) == ("as fast as the chip can", "in real time")
    assert bill.duration_s == real.duration_s == real.chip_time_s == pytest.approx(REAL)
    assert bill.chip_time_s < 1e-5
    assert real.dynamic_j == bill.dynamic_j
    assert real.static_j == pytest.approx(REAL * 0.104)
    low, high = bill.as_dict()["dynamic_low_j"], bill.as_dict()["dynamic_high_j"]
    assert (real.low_j, real.high_j) == pytest.approx((low + REAL * 0.029, high + REAL * 0.171))
    assert real.real_time is real
    assert not bill.late


def test_a_chip_of_real_time_has_one_clock():
    bill = price(*counted(learns=False), placed(), chip("spinnaker"))
    assert bill.real_time is bill
    assert bill.totals() == "3.602 mJ (3.6 to 10 mJ) as fast as the chip can, the same in real time"


def test_a_late_chip_does_not_wait_and_says_so(run, tmp_path):
    slow = table(tmp_path, "like: truenorth\nstep_s: {value: 2.0e-3, low: 0.5e-3, high: 3.0e-3, source: x}\n")
    bill = price(*run, None, slow)
    assert bill.late
    assert bill.real_time.chip_time_range_s == pytest.approx((REAL, 3 * REAL))
    assert bill.real_time.static_j == bill.static_j == pytest.approx(2 * REAL * 0.0644)
    assert "late: real time is not kept, the chip takes 20 ms for 10 ms" in bill.notes
    assert bill.cells()[2].endswith(" late")


def test_a_chip_without_times_is_priced_in_real_time_only(run, tmp_path):
    bill = price(*run, None, table(tmp_path, "costs: {static_per_chip: {value: 2, low: 1, high: 4, source: x}}"))
    assert (bill.static_known, bill.chip_time_s) == (False, None)
    assert (bill.real_time.low_j, bill.real_time.total_j, bill.real_time.high_j) == pytest.approx(
        (1 * REAL, 2 * REAL, 4 * REAL)
    )
    assert "static power is in the sums in real time only: no time of a step is published" in bill.notes


def test_all_that_is_told_has_both_with_their_range(run):
    whole = price(*run, placed(), chip("loihi"))
    bill = whole.per(4, "recording")
    assert bill.real_time.total_j == pytest.approx(whole.real_time.total_j / 4)
    assert bill.duration_s == whole.duration_s / 4
    told = json.loads(json.dumps(bill.as_dict()))
    for figures, clock in ((told, bill), (told["real_time"], bill.real_time)):
        assert [figures[f"total{end}_j"] for end in ("_low", "", "_high")] == [clock.low_j, clock.total_j, clock.high_j]
    lines = str(bill).splitlines()
    end = next(k for k, line in enumerate(lines) if line.startswith("total"))
    head, _, _, static, total = lines[end - 4 : end + 1]
    assert head.split() == ["as", "fast", "as", "the", "chip", "can", "in", "real", "time"]
    assert static.split()[3:] == ["260", "uJ"]
    assert total.endswith("260 uJ (72.5 to 428 uJ)")
    assert bill.cells()[2] == "260 uJ (72.5 to 428 uJ)"
    assert bill.cells()[3] == f"{bill.chip_time_s * 1e9:.3g} ns of 2.5 ms"
    joules = neurobench(*run, samples=2, energy=whole)["energy_j"]
    assert joules["clock"] == "as fast as the chip can"
    ends = (whole.real_time.total_j, whole.real_time.low_j, whole.real_time.high_j)
    assert tuple(joules["real_time"].values()) == pytest.approx([each / 2 for each in ends])
