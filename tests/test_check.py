"""Every mistake that only shows in the whole network: the message's text, its hint and its place."""

from collections.abc import Callable

import pytest

import neuro
from neuro.compiler import compile_network
from neuro.model.synapses import Synapse
from refused import error_of, without_place


def base(resolution: float = 0.1) -> neuro.Network:
    net = neuro.Network("base", resolution=resolution)
    net.population("noise", 4, neuro.poisson_generator())
    net.population("listed", 2, neuro.spike_generator())
    net.population("current", 1, neuro.dc_generator())
    net.population("cells", 4, neuro.iaf_psc_exp())
    net.population("parrots", 2, neuro.parrot_neuron())
    net.population("sheet", (2, 5, 6), neuro.spike_generator())
    net.population("maps", (4, "auto", "auto"), neuro.iaf_psc_delta())
    net.connect("sheet", "maps", neuro.grid(kernel=[3, 3]), name="s2")
    net.signal("reward", to="cells")
    return net


def trials(net: neuro.Network, **words: object) -> None:
    told = {"input": "sheet", "duration": 10.0, "labels": {"of": "maps", "maps_per_label": 2}}
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(**(told | words))


def connect(*arguments: object, **words: object) -> Callable[[neuro.Network], object]:
    return lambda net: net.connect(*arguments, name="p", **words)  # type: ignore[arg-type]


def regrid(*arguments: object, **words: object) -> Callable[[neuro.Network], object]:
    def make(net: neuro.Network) -> None:
        del net.projections["s2"]
        connect("sheet", "maps", neuro.grid(kernel=[3, 3]), *arguments, **words)(net)

    return make


def population(model: object, shape: object = 3, **words: object) -> Callable[[neuro.Network], object]:
    return lambda net: net.population("extra", shape, model, **words)  # type: ignore[arg-type]


def test_mistakes(messages):
    messages.calls(lambda: globals() | {"net": base()})


def test_what_is_right_compiles():
    net = base()
    trials(net)
    program = compile_network(net, 1)
    assert program.populations[-1].shape == (4, 3, 4)
    assert program.projections[0].size == 4 * 2 * 3 * 3


def modulated(rule: Synapse) -> neuro.Network:
    net = base()
    connect("noise", "cells", neuro.all_to_all(), rule, weight=0.5)(net)
    return net


ALONE = neuro.equations(
    "alone", states={"z": {"tau": "tau"}}, on_pre={"w": "w + z", "z": "z + 1"}, parameters={"tau": "5 ms"}
)


@pytest.mark.parametrize("rule", [neuro.stdp_dopa(b=0.1), neuro.mstdpet(b=-0.2), neuro.hedonistic(), ALONE()])
def test_modulated_rules_that_do_something_without_a_modulator(rule: Synapse):
    compile_network(modulated(rule), 1)


def test_a_part_that_is_added_after_compilation_is_told_at_the_next_run(messages):
    net = neuro.Network("growing")
    net.population("cells", 2, neuro.parrot_neuron())
    first = neuro.compile(net, "reference")
    first.run(1.0)
    net.connect("cells", "cells", neuro.all_to_all(), name="late")
    error = error_of(first.run, 1.0)
    assert (error.where.file, error.where.line > 0) == ("test_check.py", True)
    second = neuro.compile(net, "reference")
    second.run(1.0)
    net.trials(input="cells", duration=5.0)
    messages({"a projection": without_place(first.run, 1.0), "trials": without_place(second.run, 1.0)})
