"""Models that are not in the tables: refused where they would do nothing or crash."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass

import pytest

import neuro
from neuro.model.neurons import Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class bursts(Generator):
    """A generator that no backend knows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class my_cell(neuro.iaf_psc_exp):
    """A neuron that is in no table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class my_rule(neuro.stdp):
    """A rule that is in no table."""


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_a_generator_of_ones_own(backend):
    net = neuro.Network("own")
    net.population("g", 3, bursts())
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net, backend=backend)
    assert without_places(error.value) == (
        f"backend '{backend}' cannot run this network (1 problem)\n"
        "population 'g': bursts: a generator of one's own emits nothing: backends know poisson_generator, "
        "spike_generator, dc_generator\n"
        "  hint: inject the spikes that it emits into a spike_generator"
    )


def test_a_neuron_and_a_rule_that_are_not_listed():
    net = neuro.Network("own")
    net.population("g", 3, neuro.poisson_generator())
    net.population("c", 3, my_cell())
    net.connect("g", "c", neuro.all_to_all(), my_rule(), weight=1.0, delay=1.0, name="w")
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net, backend="event")
    assert without_places(error.value) == (
        "backend 'event' cannot run this network (2 problems)\n"
        "population 'c': my_cell: it was not listed when this backend was first used\n"
        "  hint: enter it in NEURONS of neuro.model.neurons before\n"
        "projection 'w': my_rule: it was not listed when this backend was first used\n"
        "  hint: enter it in SYNAPSES of neuro.model.synapses before"
    )


def without_places(error):
    return re.sub(r"test_unlisted\.py:\d+: ", "", str(error))


MINE = """
import sys
from dataclasses import dataclass
import neuro.model.neurons, neuro.model.synapses
from neuro.model.neurons import iaf_psc_delta
from neuro.model.neurons.iaf_psc_delta import constants, quiet, step
from neuro.model.synapses import stdp
from neuro.model.synapses.stdp import on_post

@dataclass(frozen=True, kw_only=True, eq=False)
class my_cell(iaf_psc_delta):
    "Resets to its own number."

@dataclass(frozen=True, kw_only=True, eq=False)
class my_rule(stdp):
    "Sets the weight."

my_cell.arithmetic = my_rule.arithmetic = sys.modules[__name__]

def fire(s, c, i):
    s[0, i] = NUMBER

def on_pre(y, e, c, k_minus):
    y[0, e] = NUMBER
"""
REGISTER = """
from mine import my_cell, my_rule
neuro.model.neurons.NEURONS = (*neuro.model.neurons.NEURONS, my_cell)
neuro.model.synapses.SYNAPSES["my_rule"] = my_rule
"""
RUN = """
import numpy as np
from neuro.kernels.jit import kernel
from neuro_event import dispatch

@kernel
def act(cell, rule, s, c):
    dispatch.fire(cell, s, c, 0)
    dispatch.on_pre(rule, s, 1, c, 0.0)

s = np.zeros((4, 2))
act(len(dispatch.NEURONS) - 1, len(dispatch.RULES) - 1, s, np.ones(20))
print(*s[0])
"""


def test_a_model_from_outside_runs_as_it_is_now(tmp_path):
    """Registered after the kernels were kept, and edited after that."""

    def acts(source):
        (tmp_path / "mine.py").write_text(source)
        (tmp_path / "run.py").write_text(
            "import neuro.model.neurons, neuro.model.synapses\n" + (REGISTER if source else "") + RUN
        )
        path = os.pathsep.join([str(tmp_path), *sys.path])
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": path}
        done = subprocess.run(
            [sys.executable, str(tmp_path / "run.py")], env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    without = acts("")

    assert acts(MINE.replace("NUMBER", "5.0")) == "5.0 5.0" != without
    assert acts(MINE.replace("NUMBER", "7.0")) == "7.0 7.0"
