"""Random networks, steered on the way: the event backend and the reference do what NEST does.

`NEURO_RANDOM_NETWORKS` says how many; `make test-nest` runs 5,000. What differs must be shown to be one of two things:

- Rounding is amplified: the event backend itself, with a few last places moved, gives other spikes or weights, too.
- NEST's propagators are inexact for nearly equal time constants: with them the reference gives what NEST gives.
"""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import HealthCheck, Phase, event, given, note, seed, settings

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
    phases=[Phase.generate],  # to shrink a network takes minutes
)


def start(scenario: Scenario, backend: str = "event") -> Simulation:
    return neuro.compile(scenario.net, backend, seed=scenario.seed)


def readings(scenario: Scenario, backend: str) -> list[Found]:
    try:
        return [read(sim) for sim in scenario.play(start(scenario, backend))]
    except neuro.ModelError as error:
        traceback.clear_frames(error.__traceback__)  # a process has one NEST: let go of it
        raise


def nest_exponential(tau_m: float, tau_syn: float, c_m: float, h: float) -> float:
    """The propagator of an exponential current as NEST 3.10's IAFPropagator computes it."""
    if tau_m == tau_syn:
        return h / c_m * math.exp(-h / tau_m)
    beta = tau_syn * tau_m / (tau_m - tau_syn)
    return beta / c_m * math.exp(-h / tau_syn) * math.expm1(h * ((tau_m - tau_syn) / (tau_syn * tau_m)))


def nest_alpha(tau_m: float, tau_syn: float, c_m: float, h: float) -> float:
    """That of an alpha current likewise: that of equal time constants where h is short for their difference."""
    if tau_m == tau_syn or h <= 1e-7 * tau_m * tau_m / abs(tau_m - tau_syn):
        return 0.5 * h * h / c_m * math.exp(-h / tau_m)
    beta = tau_syn * tau_m / (tau_m - tau_syn)
    growth = math.expm1(h * ((tau_m - tau_syn) / (tau_syn * tau_m)))
    return beta / c_m * math.exp(-h / tau_syn) * (beta * growth - h)


@contextmanager
def propagators_of_nest() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for model in (neuro.iaf_psc_exp, neuro.iaf_psc_alpha):
            patch.setattr(model.arithmetic, "from_exponential", nest_exponential)
        patch.setattr(neuro.iaf_psc_alpha.arithmetic, "from_alpha", nest_alpha)
        yield


def follows_from_propagators(scenario: Scenario, judged: list[Found]) -> bool:
    """Whether the reference with NEST's propagators does what NEST does."""
    with propagators_of_nest():
        twin = readings(scenario, "reference")
    return not any(differences(expected, found) for expected, found in zip(judged, twin, strict=True))


def check(scenario: Scenario) -> None:
    ours = readings(scenario, "event")
    for judge in ("nest", "reference"):
        judged = readings(scenario, judge)
        for k, (expected, found) in enumerate(zip(judged, ours, strict=True)):
            if other := differences(expected, found):
                note(f"after part {k} event differs from {judge} in {other}")
                event(f"event differs from {judge}: {cause(scenario, judge, judged, ours[: k + 1])}")
                break
    event("a long silence" if any(steps > SILENCE // 2 for _, steps in scenario.parts) else "no long silence")


def cause(scenario: Scenario, judge: str, judged: list[Found], ours: list[Found]) -> str:
    """Why event differs from a judge; fails where nothing shows it."""
    if judge == "nest" and follows_from_propagators(scenario, judged):
        return "NEST's propagators for nearly equal time constants"
    assert amplifies_rounding(scenario, start, ours), f"unexplained difference from {judge}"
    return "rounding is amplified"


@pytest.mark.parametrize("part", range(PARTS))
def test_event_and_reference_do_what_nest_does(part: int, nest):
    seed(part)(SETTINGS(given(scenarios())(check)))()
