"""What is no number: refused where it is given or set, told where it comes up while a network runs."""

from pathlib import Path

import pytest

import neuro
from neuro.extend import Neuron
from refused import refused, without_place


def cells(model: Neuron, resolution: float = 0.1, **initial: object) -> neuro.Network:
    net = neuro.Network("numbers", resolution=resolution)
    net.population("cells", 2, model, initial=initial)
    return net


def compiled(net: neuro.Network) -> neuro.Simulation:
    return neuro.compile(net, "reference")


LEAK = "(g_L*(E_L - V_m) + g*(E_ex - V_m))/C_m"
OPENING = neuro.equations(
    "opening",
    equations={"V_m": LEAK},
    receptors={"g": {"kernel": "exp", "tau": "tau_syn"}},
    initial={"g": "g_0"},
    parameters={"g_0": "0 nS", "g_L": "10 nS", "E_L": "-70 mV", "E_ex": "0 mV", "C_m": "200 pF", "tau_syn": "2 ms"},
    integrator="rk4",
)


RUNAWAY = neuro.equations(
    "runaway",
    equations={"V_m": "(E_L - V_m)/tau_m*sqrt(V_m/E_L - 2)"},
    parameters={"E_L": "-70 mV", "tau_m": "10 ms"},
    integrator="euler",
)
STEPS = "use a finer resolution, weaker input or currents, and states nearer to rest"


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize("model", [RUNAWAY(), neuro.hh_psc_alpha()], ids=lambda model: model.name)
def test_a_state_that_is_no_number_is_told(backend: str, model: Neuron):
    sim = neuro.compile(cells(model), backend)
    sim.set("cells", V_m=1e4)
    message = without_place(sim.run, 1.0)
    assert message.startswith("population 'cells': V_m of neuron 0 is ")
    assert message.endswith(f" at 1 ms: a numerical instability of {model.name}\n  hint: {STEPS}")


def test_what_has_bounds(messages):
    messages.calls(globals())
    sim = compiled(cells(neuro.hh_psc_alpha(rk4_substeps=2)))
    sim.set("cells", rk4_substeps=20, Act_m=1.0)
    compiled(cells(neuro.hh_psc_alpha(rk4_substeps=20), 1.0))


def learnt(on_pre: str) -> neuro.Network:
    """A linear neuron under a rule in equations."""
    rule = neuro.equations(
        "rule",
        on_pre={"w": on_pre},
        parameters={"tau_plus": "20 ms"},
        traces={"K_plus": {"of": "pre", "tau": "tau_plus"}},
    )
    net = neuro.Network("learnt", resolution=1.0)
    net.population("source", 2, neuro.spike_generator(spike_times=[[], [2.0]]))
    net.population("cell", 1, neuro.iaf_psc_exp())
    net.connect("source", "cell", neuro.all_to_all(), rule(), weight=1.0, delay=2.0, name="plastic")
    return net


@pytest.mark.parametrize(
    ("backend", "on_pre", "shown"),
    [
        ("reference", "log(w - w)", ("nan", "-inf")),
        ("reference", "exp(w*1000)", ("inf",)),
        ("event", "log(w - w)", ("nan", "-inf")),
    ],
)
def test_a_weight_that_is_no_number_is_told(backend: str, on_pre: str, shown: tuple[str, ...], tmp_path: Path):
    sim = neuro.compile(learnt(on_pre), backend)
    sim.run(3.0)
    told_by = {
        without_place(call)
        for call in (
            lambda: sim.weights("plastic"),
            lambda: sim.get("plastic", "weight"),
            lambda: sim.save(tmp_path / "state.h5"),
            sim.network,
            lambda: sim.run(10.0),
        )
    }
    assert told_by <= {
        f"projection 'plastic': weight of synapse 1 is {number}: a numerical instability of rule\n"
        "  hint: bound the weight in the rule, e.g. min(w + ..., Wmax), and avoid divisions by 0"
        for number in shown
    }
    assert len(told_by) == 1


@pytest.mark.parametrize("backend", ["reference", "event", "torch", "nest"])
def test_input_without_bounds_is_told_of_a_linear_neuron(backend: str, messages):
    if backend in ("torch", "nest"):
        pytest.importorskip(backend)
    net = neuro.Network("flooded", resolution=0.1)
    net.population("spikes", 3, neuro.spike_generator(spike_times=[[1.0]] * 3))
    net.population("cells", 2, neuro.iaf_psc_delta())
    net.connect("spikes", "cells[1:]", neuro.all_to_all(), weight=-1e308, delay=1.0)
    sim = neuro.compile(net, backend)
    sim.run(1.0)
    messages({"told": without_place(sim.run, 2.0)})
    sim.reset()
    sim.run(1.0)
    assert "V_m of neuron 1 is -inf" in without_place(sim.run, 1.5)


@pytest.mark.parametrize("backend", ["reference", "event", "torch"])
def test_linear_equations_that_grow_by_themselves_are_told_even_in_runs_of_one_step(backend: str):
    if backend == "torch":
        pytest.importorskip(backend)
    growing = neuro.equations("growing", equations={"V_m": "V_m/tau"}, parameters={"tau": "1 ms"})
    sim = neuro.compile(cells(growing(), 100.0, V_m=[0.0, 1.0]), backend)
    message = without_place(lambda: [sim.run(100.0) for _ in range(30)])
    assert message.startswith(
        "population 'cells': V_m of neuron 1 is inf at 800 ms: a numerical instability of growing"
    )


def test_constants_that_are_not_finite_are_refused(messages):
    parameters = {"E_L": "-70 mV", "tau_m": "0 ms", "b": "10 ms"}
    messages.of(lambda text: without_place(neuro.equations, "m", equations={"V_m": text}, parameters=parameters))


def test_values_that_make_a_divisor_0_are_refused(messages):
    parameters = {"E_L": "-70 mV", "a": "10 ms", "b": "5 ms"}
    words = {"let": {"tau": "a - b"}, "equations": {"V_m": "where(b > 7 ms, E_L - V_m, 2*E_L - 2*V_m)/tau"}}
    model = neuro.equations("own", **words, parameters=parameters, integrator="euler")
    messages({"told": without_place(neuro.compile, cells(model(b=[1.0, 10.0])))})


def test_what_is_never_chosen_may_divide_by_0():
    guarded = {"V_m": "where(b > 0 ms, V_m/b, -V_m/tau)", "x": "1 mV/ms*where(b > 0 ms, 1 ms/b, 2) - x/tau"}
    model = neuro.equations(
        "guarded", equations=guarded, parameters={"b": "0 ms", "tau": "5 ms"}, integrator="euler", initial={"x": "1 mV"}
    )
    sim = neuro.compile(cells(model()), "reference")
    sim.run(1.0)
    assert sim.get("cells", "V_m")[0] == 0.0


def test_time_constants_of_0_are_refused_in_rules():
    words = {"on_pre": {"w": "w + a/b"}, "traces": {"K": {"of": "pre", "tau": "tau"}}, "on_post": {"w": "w + K"}}
    rule = neuro.equations("own", **words, parameters={"a": 1, "b": 1, "tau": "5 ms"})
    assert without_place(rule, b=0.0).startswith("own: on_pre.w, column 6: 'b' is 0: expected a divisor other than 0")
    message = without_place(neuro.equations, "none", **words, parameters={"a": 1, "b": 1, "tau": "0 ms"})
    assert message.startswith("model 'none': parameters.tau, column 1: 'tau' is not above 0: expected a time constant")


def test_a_conductance_that_ran_away_is_given_up():
    """Its neuron would need 10^12 steps of the integrator in one of the grid."""
    net = neuro.Network("away", resolution=0.1)
    net.population("spike", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("cells", 2, neuro.aeif_cond_exp())
    net.connect("spike", "cells[:1]", neuro.all_to_all(), weight=1e15, delay=0.5)
    sim = neuro.compile(net)
    assert "V_m of neuron 0 is nan at 2 ms: a numerical instability of aeif_cond_exp" in refused(sim.run, 2.0)
    assert abs(sim.get("cells", "V_m")[1]) < 100.0
