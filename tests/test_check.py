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


MISTAKES: dict[str, tuple[Callable[[Network], object], str, str]] = {
    "generator as target": (
        connect("cells", "noise", all_to_all()),
        "projection 'p': its target 'noise' is a poisson_generator, which takes no input: expected neurons",
        "is it meant from 'noise' to 'cells'?",
    ),
    "current into parrots": (
        connect("current", "parrots", all_to_all()),
        "projection 'p': a current from 'current' into 'parrots', a parrot_neuron: expected neurons with V_m",
        "",
    ),
    "current that learns": (
        connect("current", "cells", all_to_all(), stdp()),
        "projection 'p': stdp on a current from 'current': expected a static synapse",
        "only spikes teach",
    ),
    "current over a grid": (
        lambda net: (
            net.population("sheet_dc", (5, 5), dc_generator()),
            net.population("under", (1, 3, 3), iaf_psc_exp()),
            net.connect("sheet_dc", "under", grid(kernel=[3, 3]), name="p"),
        ),
        "projection 'p': a grid on a current from 'sheet_dc': expected another rule",
        "",
    ),
    "delay off the grid": (
        connect("noise", "cells", all_to_all(), delay=1.25),
        "projection 'p': delay = 1.25 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 1.2 or 1.3 ms",
    ),
    "delay below a step": (
        connect("noise", "cells", all_to_all(), delay=0.04),
        "projection 'p': delay = 0.04 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest is 0.1 ms",
    ),
    "delay in an array off the grid": (
        connect("noise", "cells", one_to_one(), delay=[1.0, 1.0, 0.17, 1.0]),
        "projection 'p': delay[2] = 0.17 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 0.1 or 0.2 ms",
    ),
    "delay array on a grid rule": (
        regrid(delay=[1.0, 2.0]),
        "projection 'p': delay: a shared kernel has one delay: expected a number",
        "",
    ),
    "dopamine delay off the grid": (
        connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="noise", dopamine_delay=0.33)),
        "projection 'p': stdp_dopa.dopamine_delay = 0.33 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 0.3 or 0.4 ms",
    ),
    "one_to_one of unequal sizes": (
        connect("listed", "cells", one_to_one()),
        "projection 'p': one_to_one from 2 to 4 neurons: expected populations of equal size",
        "all_to_all connects populations of any size",
    ),
    "more partners than there are": (
        connect("noise", "cells", fixed_indegree(n=9, multapses=False)),
        "projection 'p': n = 9 sources of each neuron: expected at most 4, as many as there are",
        "multapses: true allows a pair to be drawn twice",
    ),
    "no partner but itself": (
        lambda net: (
            net.population("one", 1, iaf_psc_exp()),
            net.connect("one", "one", neuro.fixed_outdegree(n=1, autapses=False), name="p"),
        ),
        "projection 'p': n = 1 targets of each neuron: expected at most 0, as many as there are",
        "",
    ),
    "pair beyond the source": (
        connect("noise", "cells", pairs(pre=[0, 4], post=[0, 1])),
        "projection 'p': pairs.pre[1] = 4: expected a neuron below 4, the population's size",
        "",
    ),
    "pair beyond the target": (
        connect("noise", "cells", pairs(pre=[0, 3], post=[7, 1])),
        "projection 'p': pairs.post[0] = 7: expected a neuron below 4, the population's size",
        "",
    ),
    "weights for random synapses": (
        connect("noise", "cells", fixed_indegree(n=1), weight=[1.0, 2.0, 3.0, 4.0]),
        "projection 'p': weight: an array of shape [4] for synapses that are drawn at random: "
        "expected a number or a distribution",
        "neuro.pairs lists synapses that can have a value each",
    ),
    "weights of the wrong shape": (
        connect("listed", "cells", all_to_all(), weight=np.ones((4, 2))),
        "projection 'p': weight: an array of shape [4, 2]: expected [2, 4] or [8]",
        "",
    ),
    "kernels of the wrong shape": (
        regrid(weight=np.ones((4, 3, 3))),
        "projection 'p': weight: an array of shape [4, 3, 3]: expected [4, 2, 3, 3] or [72]",
        "",
    ),
    "weight beyond the rule's bounds": (
        connect("noise", "cells", all_to_all(), stdp_dopa(Wmax=10.0), weight=11.0),
        "projection 'p': weight = 11: expected 0 to 10, the bounds of stdp_dopa",
        "change the weight or stdp_dopa.Wmax",
    ),
    "drawn weight beyond the bounds of stdp": (
        connect("noise", "cells", pairs(pre=[0, 1], post=[0, 1]), stdp(Wmax=10.0), weight=[1.0, -2.0]),
        "projection 'p': weight[1] = -2: expected 0 to 10, the bounds of stdp",
        "give the distribution 'low' and 'high', or raise stdp.Wmax",
    ),
    "stdp on a grid": (
        regrid(stdp()),
        "projection 'p': stdp on a shared kernel: expected static or a rule for trials",
        "all_to_all gives each pair a weight",
    ),
    "r_stdp without trials": (
        connect("noise", "cells", all_to_all(), r_stdp(), weight=0.5),
        "projection 'p': r_stdp learns at the end of trials: expected a section 'trials'",
        "add one, or use stdp",
    ),
    "unknown signal": (
        connect("noise", "cells", all_to_all(), stdp_dopa(signal="rewards")),
        "projection 'p': stdp_dopa.signal: unknown signal 'rewards'",
        "did you mean 'reward'?",
    ),
    "signal to another population": (
        connect("noise", "parrots", all_to_all(), stdp_dopa(signal="reward")),
        "projection 'p': stdp_dopa.signal 'reward' goes to 'cells': expected one to 'parrots', the target",
        "",
    ),
    "unknown dopamine population": (
        connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="nois")),
        "projection 'p': stdp_dopa.dopamine: unknown population 'nois'",
        "did you mean 'noise'?",
    ),
    "dopamine from a current": (
        connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="current")),
        "projection 'p': stdp_dopa.dopamine 'current' is a dc_generator: expected a population that spikes",
        "",
    ),
    "dopamine one to one of unequal sizes": (
        connect("noise", "cells", all_to_all(), stdp_dopa(dopamine="listed", dopamine_rule="one_to_one")),
        "projection 'p': stdp_dopa.dopamine_rule one_to_one from 'listed' of 2 neurons to 'cells' of 4: "
        "expected as many",
        "",
    ),
    "name of a population": (
        lambda net: net.connect("noise", "cells", all_to_all(), name="cells"),
        "projection 'cells': a population has the same name: expected a name of its own",
        "",
    ),
    "spike lists for another size": (
        population(spike_generator(spike_times=[[1.0], [2.0]])),
        "population 'extra': spike_generator.spike_times has 2 lists: expected 3, one for each neuron",
        "",
    ),
    "spike time off the grid": (
        population(spike_generator(spike_times=[[1.0], [], [0.5, 2.03]])),
        "population 'extra': spike_generator.spike_times[2][1] = 2.03 ms: "
        "expected a multiple of the resolution, 0.1 ms",
        "the nearest are 2 or 2.1 ms",
    ),
    "t_ref off the grid": (
        population(iaf_psc_exp(t_ref=2.05)),
        "population 'extra': iaf_psc_exp.t_ref = 2.05 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 2 or 2.1 ms",
    ),
    "start off the grid": (
        population(poisson_generator(start=0.55)),
        "population 'extra': poisson_generator.start = 0.55 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 0.5 or 0.6 ms",
    ),
    "stop off the grid": (
        population(dc_generator(stop=7.77)),
        "population 'extra': dc_generator.stop = 7.77 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 7.7 or 7.8 ms",
    ),
    "reset above threshold": (
        population(iaf_psc_exp(V_reset=-50.0)),
        "population 'extra': iaf_psc_exp.V_reset = -50 mV: expected less than V_th = -55 mV",
        "lower V_reset or raise V_th",
    ),
    "reset above threshold in an array": (
        population(iaf_psc_exp(V_th=[-55.0, -71.0, -55.0])),
        "population 'extra': iaf_psc_exp.V_reset[1] = -70 mV: expected less than V_th = -71 mV",
        "lower V_reset or raise V_th",
    ),
    "rate too high": (
        population(poisson_generator(rate=6e6)),
        "population 'extra': poisson_generator.rate = 6e+06 Hz: expected at most 5e+06 Hz, 500 spikes a step",
        "",
    ),
    "parameter array of another size": (
        population(iaf_psc_exp(tau_m=[10.0, 20.0])),
        "population 'extra': iaf_psc_exp.tau_m: an array of shape [2]: expected [3]",
        "one value for each neuron, or one number for all",
    ),
    "initial array of another size": (
        population(iaf_psc_exp(), shape=(2, 2), initial={"V_m": [1.0, 2.0]}),
        "population 'extra': initial.V_m: an array of shape [2]: expected [2, 2] or [4]",
        "one value for each neuron, or one number for all",
    ),
    "auto without a grid": (
        population(iaf_psc_exp(), shape=(2, "auto", "auto")),
        "population 'extra': shape [2, 'auto', 'auto']: 'auto' needs a grid projection onto it, found none",
        "write the numbers",
    ),
    "auto with two grids": (
        lambda net: net.connect("sheet", "maps", grid(kernel=[2, 2]), name="p"),
        "projection 'p': grid onto 'maps' of shape [4, 3, 4]: expected [maps, 4, 5]",
        "give 'maps' the shape [maps, auto, auto], and all grids onto it one size",
    ),
    "auto maps": (
        lambda net: (
            net.population("extra", ("auto", "auto", "auto"), iaf_psc_exp()),
            net.connect("sheet", "extra", grid(kernel=[2, 2]), name="p"),
        ),
        "population 'extra': shape ['auto', 'auto', 'auto']: expected [maps, auto, auto] with a number of maps",
        "",
    ),
    "auto in a circle": (
        lambda net: (
            net.population("a", (1, "auto", "auto"), iaf_psc_exp()),
            net.population("b", (1, "auto", "auto"), iaf_psc_exp()),
            net.connect("a", "b", grid(kernel=[1, 1])),
            net.connect("b", "a", grid(kernel=[1, 1])),
        ),
        "population 'a': shape [1, 'auto', 'auto']: its grids form a circle: expected numbers in one shape of it",
        "",
    ),
    "kernel too large": (
        lambda net: (
            net.population("extra", (1, "auto", "auto"), iaf_psc_exp()),
            net.connect("sheet", "extra", grid(kernel=[9, 3], padding=1), name="p"),
        ),
        "projection 'p': grid.kernel = [9, 3]: expected at most [7, 8], the size of 'sheet' with its padding",
        "a smaller kernel or more padding",
    ),
    "grid from a line": (
        connect("noise", "maps", grid(kernel=[3, 3])),
        "projection 'p': grid from 'noise' of shape [4]: expected [height, width] or [channels, height, width]",
        "",
    ),
    "maps that channels do not share evenly": (
        lambda net: (
            net.population("flat", (7, "auto", "auto"), iaf_psc_exp()),
            net.connect("maps", "flat", grid(kernel=[2, 2], padding="same", depthwise=True), name="p"),
        ),
        "projection 'p': depthwise grid from 4 channels onto 7 maps of 'flat': expected a multiple of 4",
        "",
    ),
    "grid from a row": (
        lambda net: (
            net.population("flat", (1, 2, 2), iaf_psc_exp()),
            net.connect("noise", "flat", grid(kernel=[3, 3]), name="p"),
        ),
        "projection 'p': grid from 'noise' of shape [4]: expected [height, width] or [channels, height, width]",
        "",
    ),
    "grid onto another shape": (
        lambda net: (
            net.population("flat", (1, 2, 2), iaf_psc_exp()),
            net.connect("sheet", "flat", grid(kernel=[3, 3]), name="p"),
        ),
        "projection 'p': grid onto 'flat' of shape [1, 2, 2]: expected [maps, 3, 4]",
        "give 'flat' the shape [maps, auto, auto], and all grids onto it one size",
    ),
    "group of an unknown population": (
        lambda net: net.group("choice", winner_take_all(of="cell")),
        "group 'choice': winner_take_all.of: unknown population 'cell'",
        "did you mean 'cells'?",
    ),
    "group of parrots": (
        lambda net: net.group("choice", winner_take_all(of="parrots")),
        "group 'choice': winner_take_all of 'parrots', a parrot_neuron: expected neurons with V_m and V_th",
        "",
    ),
    "rivals along an axis that is not there": (
        lambda net: net.group("choice", lateral_reset(of="maps", axis=3)),
        "group 'choice': lateral_reset.axis = 3 of 'maps', whose shape is [4, 3, 4]: expected at most 2",
        "",
    ),
    "rivals that reset themselves": (
        lambda net: net.group("choice", lateral_reset(of="parrots")),
        "group 'choice': lateral_reset of 'parrots', a parrot_neuron: expected neurons with V_m and V_th",
        "",
    ),
    "two groups of one population": (
        lambda net: (net.group("a", winner_take_all(of="cells")), net.group("b", winner_take_all(of="cells"))),
        "group 'b': 'cells' is already in group 'a': expected one group for each population",
        "",
    ),
    "probe of an unknown state": (
        lambda net: net.probe("x", "cells", "V"),
        "probe 'x': 'cells', an iaf_psc_exp, has no state 'V'",
        "did you mean 'V_m'?",
    ),
    "probe of a hidden state": (
        lambda net: net.probe("x", "cells", "refractory"),
        "probe 'x': 'cells', an iaf_psc_exp, has no state 'refractory'",
        "known: I_syn_ex, I_syn_in, V_m, rate, spikes",
    ),
    "spikes of a current": (
        lambda net: net.probe("x", "current"),
        "probe 'x': spikes of 'current', a dc_generator: it emits a current",
        "",
    ),
    "spikes at intervals": (
        lambda net: net.probe("x", "cells", every=1.0),
        "probe 'x': every is for states: spikes are all recorded",
        "leave 'every' out",
    ),
    "spikes among states": (
        lambda net: net.probe("x", "cells", ["V_m", "spikes"]),
        "probe 'x': 'spikes' is recorded alone",
        "give it a probe of its own",
    ),
    "a rate without bins": (
        lambda net: net.probe("x", "cells", "rate"),
        "probe 'x': a rate needs every, the length of its bins",
        "every: 10.0 is a common one",
    ),
    "the mean of a rate": (
        lambda net: net.probe("x", "cells", "rate", every=1.0, mean=True),
        "probe 'x': a rate is a mean over the neurons",
        "leave 'mean' out",
    ),
    "the mean of spikes": (
        lambda net: net.probe("x", "cells", mean=True),
        "probe 'x': mean is for states",
        "record: rate gives that of spikes",
    ),
    "pre spikes of a population": (
        lambda net: net.probe("x", "cells", "V_m", at="pre_spikes"),
        "probe 'x': at is for projections: 'cells' is a population",
        "",
    ),
    "synapses of a population": (
        lambda net: net.probe("x", "cells", "V_m", synapses=[1]),
        "probe 'x': synapses is for projections: 'cells' is a population",
        "",
    ),
    "two traces of a name": (
        lambda net: (net.probe("x", "cells", ["V_m"]), net.probe("x.V_m", "cells", "V_m")),
        "probe 'x.V_m': probe 'x' has a trace of the name 'x.V_m', too: expected another name",
        "",
    ),
    "interval off the grid": (
        lambda net: net.probe("x", "cells", "V_m", every=0.25),
        "probe 'x': every = 0.25 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 0.2 or 0.3 ms",
    ),
    "trials from an unknown population": (
        lambda net: trials(net, input="sheets"),
        "trials: input: unknown population 'sheets'",
        "did you mean 'sheet'?",
    ),
    "trials from noise": (
        lambda net: trials(net, input="noise"),
        "trials: input 'noise' is a poisson_generator: expected a spike_generator",
        "",
    ),
    "trials with listed spikes": (
        lambda net: (
            net.population("extra", 1, spike_generator(spike_times=[[1.0]])),
            trials(net, input="extra"),
        ),
        "trials: input 'extra' has spike_times: expected none, as trials bring their own",
        "",
    ),
    "trials off the grid": (
        lambda net: trials(net, duration=10.05),
        "trials: duration = 10.05 ms: expected a multiple of the resolution, 0.1 ms",
        "the nearest are 10 or 10.1 ms",
    ),
    "trials without a group": (
        lambda net: net.trials(input="sheet", duration=10.0, labels={"of": "maps"}),
        "trials: no group decides in 'maps'",
        "add a group winner_take_all of 'maps'",
    ),
    "trials without an output": (
        lambda net: net.trials(input="sheet", duration=10.0),
        "trials: 0 groups and no labels: expected labels that name the output",
        "",
    ),
    "trials that decide at each step": (
        lambda net: (
            net.group("choice", winner_take_all(of="maps", first_to_fire=False)),
            net.trials(input="sheet", duration=10.0),
        ),
        "trials: group 'choice' decides at each step: expected first_to_fire: true",
        "",
    ),
    "labels of an unknown population": (
        lambda net: trials(net, labels={"of": "map"}),
        "trials: labels.of: unknown population 'map'",
        "did you mean 'maps'?",
    ),
    "labels that do not divide the maps": (
        lambda net: trials(net, labels={"of": "maps", "maps_per_label": 3}),
        "trials: labels.maps_per_label = 3: expected a divisor of 4, the maps of 'maps'",
        "",
    ),
    "dropout elsewhere": (
        lambda net: trials(net, dropout={"of": "cells"}),
        "trials: labels of 'maps' but dropout of 'cells': expected one population",
        "",
    ),
    "reset of an unknown state": (
        lambda net: trials(net, reset=["v_m"]),
        "trials: reset: 'maps' has no state 'v_m'",
        "did you mean 'V_m'?",
    ),
    "reward for silence": (
        lambda net: trials(net, reward={"silent": -1.0}),
        "trials: reward.silent = -1: expected 0, as no neuron decided that could be rewarded",
        "r_stdp.epsilon and r_stdp.rescue say what silence teaches",
    ),
    "r_stdp elsewhere": (
        lambda net: (connect("noise", "cells", all_to_all(), r_stdp(), weight=0.5)(net), trials(net)),
        "projection 'p': r_stdp onto 'cells': expected 'maps', which decides",
        "",
    ),
    "r_stdp without labels": (
        lambda net: (regrid(r_stdp(), weight=0.5)(net), trials(net, labels=None)),
        "trials: r_stdp of 'p' needs 'labels', as rewards depend on them",
        "",
    ),
    "stdp beside trials": (
        lambda net: (connect("noise", "cells", all_to_all(), stdp())(net), trials(net)),
        "projection 'p': stdp in a network with trials: expected static or a rule for trials",
        "a trial drops what is under way, which would cut the traces of spike pairs",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake(mistake: str):
    make, message, hint = MISTAKES[mistake]
    net = base()
    make(net)
    with pytest.raises(ModelError) as caught:
        compile_network(net, 1)
    assert caught.value.message == message
    assert caught.value.hint == hint
    assert caught.value.where is not None
    assert caught.value.where.file == "test_check.py"
    assert caught.value.where.line > 0


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
