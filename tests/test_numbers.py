"""What is no number: refused where it is given or set, told where it comes up while a network runs."""

import pytest

import neuro
from neuro.extend import Neuron


def cells(model: Neuron, resolution: float = 0.1, **initial: object) -> neuro.Network:
    net = neuro.Network("numbers", resolution=resolution)
    net.population("cells", 2, model, initial=initial)
    return net


def told(call, *args, **words) -> str:
    """The message of the error of a call, without the place in this file."""
    with pytest.raises(neuro.ModelError) as error:
        call(*args, **words)
    return str(error.value).removeprefix(f"{error.value.where}: ")


@pytest.mark.parametrize(
    ("resolution", "substeps", "length", "expected"), [(0.1, 1, "0.1", 2), (1.0, 19, "0.0526316", 20)]
)
def test_rk4_steps_too_long_for_the_axon_are_refused(resolution: float, substeps: int, length: str, expected: int):
    net = cells(neuro.hh_psc_alpha(rk4_substeps=substeps), resolution)
    assert told(neuro.compile, net) == (
        f"population 'cells': hh_psc_alpha.rk4_substeps = {substeps}: steps of {length} ms run away: "
        f"expected at most 0.05 ms\n  hint: write rk4_substeps={expected}, or 0 for RKF45"
    )
    neuro.compile(cells(neuro.hh_psc_alpha(rk4_substeps=expected), resolution))


def test_rk4_steps_too_long_cannot_be_set_either():
    sim = neuro.compile(cells(neuro.hh_psc_alpha()), "reference")
    assert told(sim.set, "cells", rk4_substeps=1).startswith("population 'cells': hh_psc_alpha.rk4_substeps = 1: steps")
    sim.set("cells", rk4_substeps=2)


BOUNDED = [
    (neuro.iaf_cond_exp, "g_ex", -5.0, ">= 0 nS"),
    (neuro.iaf_cond_alpha, "g_in", -3.0, ">= 0 nS"),
    (neuro.aeif_cond_exp, "g_ex", -1.0, ">= 0 nS"),
    (neuro.hh_psc_alpha, "Inact_h", -1.0, ">= 0 and <= 1"),
    (neuro.hh_psc_alpha, "Act_m", 2.0, ">= 0 and <= 1"),
]


@pytest.mark.parametrize(("model", "state", "value", "expected"), BOUNDED)
def test_states_have_bounds(model: type[Neuron], state: str, value: float, expected: str):
    message = f"{state} = {value:g}: expected a number {expected}"
    assert told(cells, model(), **{state: value}) == f"population 'cells': initial.{message}"
    sim = neuro.compile(cells(model(), **{state: 0.5}), "reference")
    assert told(sim.set, "cells", **{state: value}) == f"cells.{message}"
    assert (
        told(sim.set, "cells", **{state: [0.5, value]}) == f"cells.{state}[1] = {value:g}: expected a number {expected}"
    )
    sim.set("cells", **{state: 1.0})


def test_drawn_states_have_bounds():
    net = cells(neuro.iaf_cond_exp(), g_ex=neuro.uniform(low=-2.0, high=-1.0))
    assert told(neuro.compile, net) == (
        "population 'cells': initial.g_ex[0] = -1.8787842103688903: expected a number >= 0 nS"
    )


LEAK = "(g_L*(E_L - V_m) + g*(E_ex - V_m))/C_m"
OPENING = neuro.equations(
    "opening",
    equations={"V_m": LEAK},
    receptors={"g": {"kernel": "exp", "tau": "tau_syn"}},
    initial={"g": "g_0"},
    parameters={"g_0": "0 nS", "g_L": "10 nS", "E_L": "-70 mV", "E_ex": "0 mV", "C_m": "200 pF", "tau_syn": "2 ms"},
    integrator="rk4",
)


def test_conductances_of_equations_have_bounds():
    assert told(cells, OPENING(), g=-1.0) == "population 'cells': initial.g = -1: expected a number >= 0 nS"
    assert told(neuro.compile, cells(OPENING(g_0=-3.0))) == (
        "population 'cells': initial.g = -3: expected a number >= 0 nS"
    )
