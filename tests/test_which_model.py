"""The pages that say which model is for what name every model, and where each runs."""

import re
from pathlib import Path

import pytest

import neuro
from built_in import NATIVE, NEURONS
from neuro.compiler import compile_network
from neuro.model.parts import GROUPS
from neuro.model.synapses import SYNAPSES
from neuro.program.backend import find_backend
from neuro_nest.tables import NODES, SYNAPSES as NEST_SYNAPSES

PAGES = Path(__file__).parents[1] / "docs" / "how-to"
BACKENDS = ("reference", "event", "nest", "torch", "loihi", "loihi2", "spinnaker")
RULES = [name for name in SYNAPSES if not SYNAPSES[name].chip]
OF_TRIALS = [name for name in RULES if SYNAPSES[name].learns == "trials"]

WITHOUT_A_WINDOW = {"td_moves": "learns by moves", "hedonistic": "releases by chance"}


def told(page):
    """The last cell of the rows of a page's tables, by the first; each is a list of backends, and what else it says."""
    rows = re.findall(r"^\| `(\w+)` \|(?:.* \|)? (reference.*|loihi2?|spinnaker) \|$", (PAGES / page).read_text(), re.M)
    return {name: cell.partition("; ")[0] for name, cell in rows}


def runs_on(net):
    program = compile_network(net, 0)
    return ", ".join(name for name in BACKENDS if not any(p.refused for p in find_backend(name).problems(program)))


def of_neuron(model):
    net = neuro.Network("where", resolution=1.0)
    net.population("cells", 1, model())
    return net


def of_group(name):
    net = neuro.Network("where", resolution=1.0)
    net.population("cells", (2, 1, 1), neuro.iaf_psc_delta())
    more = {"radius": 1} if name == "local_winners" else {}
    net.group("one", GROUPS[name](of="cells", **more))
    return net


def test_the_page_has_each_neuron_and_each_group_and_where_it_runs():
    neurons = {model.__name__: runs_on(of_neuron(model)) for model in (*NEURONS, *NATIVE)}
    groups = {name: runs_on(of_group(name)) for name in GROUPS}
    assert told("choose-a-model.md") == neurons | groups


def of_rule(name):
    rule = SYNAPSES[name]
    net = neuro.Network("where", resolution=1.0)
    net.population("source", 1, neuro.spike_generator(spike_times=[[]]))
    net.population("cells", 1, neuro.pp_psc_delta() if SYNAPSES[name].learns == "moves" else neuro.iaf_psc_exp())
    told_by_signal = rule.modulated or rule.learns == "moves"
    if told_by_signal:
        net.signal("reward", to="cells")
    synapse = rule(signal="reward") if told_by_signal else rule()
    weight = -1.0 if rule.defaults().get("Wmax", 1.0) < 0.0 else 1.0
    net.connect("source", "cells", neuro.one_to_one(), synapse, weight=weight, delay=1.0)
    return net


def of_rule_of_trials(name):
    net = neuro.Network("where", resolution=1.0)
    net.population("input", 1, neuro.spike_generator())
    net.population("cells", (1, 1), neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=1.0))
    net.connect("input", "cells", neuro.all_to_all(), SYNAPSES[name](), weight=0.5, delay=1.0)
    net.group("choice", neuro.winner_take_all(of="cells"))
    net.trials(input="input", duration=10.0, labels={"of": "cells"})
    return net


def test_the_page_has_each_rule_and_where_it_runs():
    nets = {name: of_rule_of_trials(name) if name in OF_TRIALS else of_rule(name) for name in RULES}
    assert told("choose-a-synapse-rule.md") == {name: runs_on(net) for name, net in nets.items()}


def test_the_first_table_of_the_page_has_each_rule():
    wanted = (PAGES / "choose-a-synapse-rule.md").read_text().partition("\n\n`stdp` between")[0]
    assert [name for name in RULES if f"`{name}`" not in wanted] == []


def test_the_page_of_nest_has_all_that_maps_to_it():
    maps = (PAGES / "run-on-nest.md").read_text().partition("## Limits")[0]
    assert [name for name in (*NODES, *NEST_SYNAPSES) if f"`{name}`" not in maps] == []


@pytest.mark.parametrize(
    ("example", "names"),
    [
        ("neurons", {model.__name__ for model in NEURONS if not model.most and not model.graded}),
        ("windows", {name for name in RULES if SYNAPSES[name].learns == "pairs"} - WITHOUT_A_WINDOW.keys()),
    ],
)
def test_the_pictures_have_each_of_them(example, names):
    text = (PAGES.parents[1] / "examples" / f"{example}.py").read_text()
    assert names - set(re.findall(r"neuro\.(\w+)\(", text)) == set()
