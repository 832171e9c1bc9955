"""Every mistake that only shows in the whole network: the message's text, its hint and its place."""

from collections.abc import Callable

import numpy as np
import pytest

import neuro
from neuro import (
    Network,
    all_to_all,
    dc_generator,
    fixed_indegree,
    grid,
    iaf_psc_delta,
    iaf_psc_exp,
    lateral_reset,
    one_to_one,
    pairs,
    parrot_neuron,
    poisson_generator,
    r_stdp,
    spike_generator,
    stdp,
    stdp_dopa,
    winner_take_all,
)
from neuro.compiler import compile_network
from neuro.core.errors import ModelError
from neuro.model.synapses import Synapse
from refused import error_of


def base(resolution: float = 0.1) -> Network:
    net = Network("base", resolution=resolution)
    net.population("noise", 4, poisson_generator())
    net.population("listed", 2, spike_generator())
    net.population("current", 1, dc_generator())
    net.population("cells", 4, iaf_psc_exp())
    net.population("parrots", 2, parrot_neuron())
    net.population("sheet", (2, 5, 6), spike_generator())
    net.population("maps", (4, "auto", "auto"), iaf_psc_delta())
    net.connect("sheet", "maps", grid(kernel=[3, 3]), name="s2")
    net.signal("reward", to="cells")
    return net


def trials(net: Network, **words: object) -> None:
    told = {"input": "sheet", "duration": 10.0, "labels": {"of": "maps", "maps_per_label": 2}}
    net.group("choice", winner_take_all(of="maps"))
    net.trials(**(told | words))


def connect(*arguments: object, **words: object) -> Callable[[Network], object]:
    return lambda net: net.connect(*arguments, name="p", **words)  # type: ignore[arg-type]


def regrid(*arguments: object, **words: object) -> Callable[[Network], object]:
    def make(net: Network) -> None:
        del net.projections["s2"]
        connect("sheet", "maps", grid(kernel=[3, 3]), *arguments, **words)(net)

    return make


def population(model: object, shape: object = 3, **words: object) -> Callable[[Network], object]:
    return lambda net: net.population("extra", shape, model, **words)  # type: ignore[arg-type]


MISTAKES: dict[str, Callable[[Network], object]] = {
    "generator as target": connect("cells", "noise", all_to_all()),
    "current into parrots": connect("current", "parrots", all_to_all()),
    "current that learns": connect("current", "cells", all_to_all(), stdp()),
    "current over a grid": lambda net: (
        net.population("sheet_dc", (5, 5), dc_generator()),
        net.population("under", (1, 3, 3), iaf_psc_exp()),
        net.connect("sheet_dc", "under", grid(kernel=[3, 3]), name="p"),
    ),
    "delay off the grid": connect("noise", "cells", all_to_all(), delay=1.25),
    "delay below a step": connect("noise", "cells", all_to_all(), delay=0.04),
    "delay in an array off the grid": connect("noise", "cells", one_to_one(), delay=[1.0, 1.0, 0.17, 1.0]),
    "delay array on a grid rule": regrid(delay=[1.0, 2.0]),
    "dopamine delay off the grid": connect(
        "noise", "cells", all_to_all(), stdp_dopa(dopamine="noise", dopamine_delay=0.33)
    ),
    "one_to_one of unequal sizes": connect("listed", "cells", one_to_one()),
    "more partners than there are": connect("noise", "cells", fixed_indegree(n=9, multapses=False)),
    "no partner but itself": lambda net: (
        net.population("one", 1, iaf_psc_exp()),
        net.connect("one", "one", neuro.fixed_outdegree(n=1, autapses=False), name="p"),
    ),
    "pair beyond the source": connect("noise", "cells", pairs(pre=[0, 4], post=[0, 1])),
    "pair beyond the target": connect("noise", "cells", pairs(pre=[0, 3], post=[7, 1])),
    "weights for random synapses": connect("noise", "cells", fixed_indegree(n=1), weight=[1.0, 2.0, 3.0, 4.0]),
    "weights of the wrong shape": connect("listed", "cells", all_to_all(), weight=np.ones((4, 2))),
    "kernels of the wrong shape": regrid(weight=np.ones((4, 3, 3))),
    "weight beyond the rule's bounds": connect("noise", "cells", all_to_all(), stdp_dopa(Wmax=10.0), weight=11.0),
    "drawn weight beyond the bounds of stdp": connect(
        "noise", "cells", pairs(pre=[0, 1], post=[0, 1]), stdp(Wmax=10.0), weight=[1.0, -2.0]
    ),
    "stdp on a grid": regrid(stdp()),
    "r_stdp without trials": connect("noise", "cells", all_to_all(), r_stdp(), weight=0.5),
    "unknown signal": connect("noise", "cells", all_to_all(), stdp_dopa(signal="rewards")),
    "signal to another population": connect("noise", "parrots", all_to_all(), stdp_dopa(signal="reward")),
    "unknown dopamine population": connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="nois")),
    "dopamine from a current": connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="current")),
    "dopamine one to one of unequal sizes": connect(
        "noise", "cells", all_to_all(), stdp_dopa(dopamine="listed", dopamine_rule="one_to_one")
    ),
    "name of a population": lambda net: net.connect("noise", "cells", all_to_all(), name="cells"),
    "spike lists for another size": population(spike_generator(spike_times=[[1.0], [2.0]])),
    "spike time off the grid": population(spike_generator(spike_times=[[1.0], [], [0.5, 2.03]])),
    "t_ref off the grid": population(iaf_psc_exp(t_ref=2.05)),
    "start off the grid": population(poisson_generator(start=0.55)),
    "stop off the grid": population(dc_generator(stop=7.77)),
    "reset above threshold": population(iaf_psc_exp(V_reset=-50.0)),
    "reset above threshold in an array": population(iaf_psc_exp(V_th=[-55.0, -71.0, -55.0])),
    "rate too high": population(poisson_generator(rate=6e6)),
    "parameter array of another size": population(iaf_psc_exp(tau_m=[10.0, 20.0])),
    "initial array of another size": population(iaf_psc_exp(), shape=(2, 2), initial={"V_m": [1.0, 2.0]}),
    "auto without a grid": population(iaf_psc_exp(), shape=(2, "auto", "auto")),
    "auto with two grids": lambda net: net.connect("sheet", "maps", grid(kernel=[2, 2]), name="p"),
    "auto maps": lambda net: (
        net.population("extra", ("auto", "auto", "auto"), iaf_psc_exp()),
        net.connect("sheet", "extra", grid(kernel=[2, 2]), name="p"),
    ),
    "auto in a circle": lambda net: (
        net.population("a", (1, "auto", "auto"), iaf_psc_exp()),
        net.population("b", (1, "auto", "auto"), iaf_psc_exp()),
        net.connect("a", "b", grid(kernel=[1, 1])),
        net.connect("b", "a", grid(kernel=[1, 1])),
    ),
    "kernel too large": lambda net: (
        net.population("extra", (1, "auto", "auto"), iaf_psc_exp()),
        net.connect("sheet", "extra", grid(kernel=[9, 3], padding=1), name="p"),
    ),
    "grid from a line": connect("noise", "maps", grid(kernel=[3, 3])),
    "maps that channels do not share evenly": lambda net: (
        net.population("flat", (7, "auto", "auto"), iaf_psc_exp()),
        net.connect("maps", "flat", grid(kernel=[2, 2], padding="same", depthwise=True), name="p"),
    ),
    "grid from a row": lambda net: (
        net.population("flat", (1, 2, 2), iaf_psc_exp()),
        net.connect("noise", "flat", grid(kernel=[3, 3]), name="p"),
    ),
    "grid onto another shape": lambda net: (
        net.population("flat", (1, 2, 2), iaf_psc_exp()),
        net.connect("sheet", "flat", grid(kernel=[3, 3]), name="p"),
    ),
    "group of an unknown population": lambda net: net.group("choice", winner_take_all(of="cell")),
    "group of parrots": lambda net: net.group("choice", winner_take_all(of="parrots")),
    "rivals along an axis that is not there": lambda net: net.group("choice", lateral_reset(of="maps", axis=3)),
    "rivals that reset themselves": lambda net: net.group("choice", lateral_reset(of="parrots")),
    "two groups of one population": lambda net: (
        net.group("a", winner_take_all(of="cells")),
        net.group("b", winner_take_all(of="cells")),
    ),
    "probe of an unknown state": lambda net: net.probe("x", "cells", "V"),
    "probe of a hidden state": lambda net: net.probe("x", "cells", "refractory"),
    "spikes of a current": lambda net: net.probe("x", "current"),
    "spikes at intervals": lambda net: net.probe("x", "cells", every=1.0),
    "spikes among states": lambda net: net.probe("x", "cells", ["V_m", "spikes"]),
    "a rate without bins": lambda net: net.probe("x", "cells", "rate"),
    "the mean of a rate": lambda net: net.probe("x", "cells", "rate", every=1.0, mean=True),
    "the mean of spikes": lambda net: net.probe("x", "cells", mean=True),
    "pre spikes of a population": lambda net: net.probe("x", "cells", "V_m", at="pre_spikes"),
    "synapses of a population": lambda net: net.probe("x", "cells", "V_m", synapses=[1]),
    "two traces of a name": lambda net: (net.probe("x", "cells", ["V_m"]), net.probe("x.V_m", "cells", "V_m")),
    "interval off the grid": lambda net: net.probe("x", "cells", "V_m", every=0.25),
    "trials from an unknown population": lambda net: trials(net, input="sheets"),
    "trials from noise": lambda net: trials(net, input="noise"),
    "trials with listed spikes": lambda net: (
        net.population("extra", 1, spike_generator(spike_times=[[1.0]])),
        trials(net, input="extra"),
    ),
    "trials off the grid": lambda net: trials(net, duration=10.05),
    "trials without a group": lambda net: net.trials(input="sheet", duration=10.0, labels={"of": "maps"}),
    "trials without an output": lambda net: net.trials(input="sheet", duration=10.0),
    "trials that decide at each step": lambda net: (
        net.group("choice", winner_take_all(of="maps", first_to_fire=False)),
        net.trials(input="sheet", duration=10.0),
    ),
    "labels of an unknown population": lambda net: trials(net, labels={"of": "map"}),
    "labels that do not divide the maps": lambda net: trials(net, labels={"of": "maps", "maps_per_label": 3}),
    "dropout elsewhere": lambda net: trials(net, dropout={"of": "cells"}),
    "reset of an unknown state": lambda net: trials(net, reset=["v_m"]),
    "reward for silence": lambda net: trials(net, reward={"silent": -1.0}),
    "r_stdp elsewhere": lambda net: (connect("noise", "cells", all_to_all(), r_stdp(), weight=0.5)(net), trials(net)),
    "r_stdp without labels": lambda net: (regrid(r_stdp(), weight=0.5)(net), trials(net, labels=None)),
    "stdp beside trials": lambda net: (connect("noise", "cells", all_to_all(), stdp())(net), trials(net)),
}


def test_mistake(messages):
    told = {}
    for mistake, change in MISTAKES.items():
        net = base()
        change(net)
        error = error_of(compile_network, net, 1)
        assert error.where.file == "test_check.py"
        assert error.where.line > 0
        told[mistake] = str(error).removeprefix(f"{error.where}: ")
    messages(told)


def test_an_empty_network_is_a_mistake():
    with pytest.raises(ModelError, match="network 'nothing' has no population: expected at least one"):
        compile_network(Network("nothing"), 1)


def test_what_is_right_compiles():
    net = base()
    trials(net)
    program = compile_network(net, 1)
    assert program.populations[-1].shape == (4, 3, 4)
    assert program.projections[0].size == 4 * 2 * 3 * 3


def modulated(rule: Synapse) -> Network:
    net = base()
    connect("noise", "cells", all_to_all(), rule, weight=0.5)(net)
    return net


@pytest.mark.parametrize(
    ("rule", "source", "way_out"),
    [
        (stdp_dopa(), "'signal' and 'dopamine'", ", or the population that releases dopamine"),
        (neuro.mstdpet(), "'signal'", ""),
        (neuro.td_ltp(), "'signal'", ""),
        (neuro.td_moves(), "'signal'", ""),
    ],
    ids=lambda part: getattr(part, "name", None),
)
def test_a_modulated_rule_without_a_modulator_that_can_never_learn(rule: Synapse, source: str, way_out: str):
    with pytest.raises(ModelError) as caught:
        compile_network(modulated(rule), 1)
    assert caught.value.message == (
        f"projection 'p': {rule.name} without {source}: n stays 0, at which its weights never change: "
        "expected a source of n"
    )
    assert caught.value.hint == f"name a signal to 'cells'{way_out}; static has weights that stay"


ALONE = neuro.equations(
    "alone", states={"z": {"tau": "tau"}}, on_pre={"w": "w + z", "z": "z + 1"}, parameters={"tau": "5 ms"}
)


@pytest.mark.parametrize("rule", [stdp_dopa(b=0.1), neuro.mstdpet(b=-0.2), neuro.hedonistic(), ALONE()])
def test_modulated_rules_that_do_something_without_a_modulator(rule: Synapse):
    compile_network(modulated(rule), 1)


def test_a_part_that_is_added_after_compilation_is_told_at_the_next_run():
    net = Network("growing")
    net.population("cells", 2, parrot_neuron())
    first = neuro.compile(net, "reference")
    first.run(1.0)
    net.connect("cells", "cells", all_to_all(), name="late")
    with pytest.raises(ModelError) as caught:
        first.run(1.0)
    assert caught.value.message == (
        "network 'growing': projection 'late' was added after it was compiled, and has no effect here: "
        "expected the network as it was"
    )
    assert caught.value.hint == "compile the network again"
    assert caught.value.where is not None
    second = neuro.compile(net, "reference")
    second.run(1.0)
    net.trials(input="cells", duration=5.0)
    with pytest.raises(ModelError, match="network 'growing': trials were added after it was compiled"):
        second.run(1.0)
