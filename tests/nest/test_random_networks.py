"""Random networks, steered on the way: the event backend and the reference do what NEST does.

`NEURO_RANDOM_NETWORKS` says how many; `make test-nest` runs 5,000. What differs must be shown to amplify rounding: the
event backend itself, with a few last places moved, then gives other spikes or weights, too.
"""

from __future__ import annotations

import os
import traceback

import pytest
from hypothesis import HealthCheck, event, given, note, seed, settings

import neuro
from neuro.simulation import Simulation
from neuro.testing.case import Found
from neuro.testing.scenarios import SILENCE, Scenario, amplifies_rounding, differences, read, scenarios

NETWORKS = int(os.environ.get("NEURO_RANDOM_NETWORKS", "200"))
PARTS = 20
SETTINGS = settings(
    max_examples=max(1, NETWORKS // PARTS),
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)


def start(scenario: Scenario, backend: str = "event") -> Simulation:
    return neuro.compile(scenario.net, backend, seed=scenario.seed)


def readings(scenario: Scenario, backend: str) -> list[Found]:
    try:
        return [read(sim) for sim in scenario.play(start(scenario, backend))]
    except neuro.ModelError as error:
        traceback.clear_frames(error.__traceback__)  # a process has one NEST: let go of it
        raise


def check(scenario: Scenario) -> None:
    ours = readings(scenario, "event")
    for judge in ("nest", "reference"):
        for k, (expected, found) in enumerate(zip(readings(scenario, judge), ours, strict=True)):
            if other := differences(expected, found):
                note(f"after part {k} event differs from {judge} in {other}")
                assert amplifies_rounding(scenario, start, ours[: k + 1]), other
                event(f"rounding is amplified: event differs from {judge}")
                break
    event("a long silence" if scenario.parts[-2:-1] and scenario.parts[-2][1] > SILENCE // 2 else "no silence")


@pytest.mark.parametrize("part", range(PARTS))
def test_event_and_reference_do_what_nest_does(part: int, nest):
    seed(part)(SETTINGS(given(scenarios())(check)))()
