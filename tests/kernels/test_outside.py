"""Third-party models, registered or not: compiled by themselves, anew after an edit, and equal to the reference."""

import os
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import neuro
from alike import alike, same
from neuro.extend import Neuron, Synapse, Trace, quantity
from neuro.testing import observe
from neuro.testing.case import differences


@dataclass(frozen=True, kw_only=True, eq=False)
class my_cell(neuro.iaf_psc_exp):
    """A neuron with the arithmetic of its base."""


@dataclass(frozen=True, kw_only=True, eq=False)
class my_rule(neuro.stdp):
    """A rule with the arithmetic of its base."""


def network(cell, rule):
    net = neuro.Network("own")
    net.population("g", 30, neuro.poisson_generator(rate=400.0))
    net.population("c", 70, cell(tau_m=neuro.uniform(low=5.0, high=15.0)))
    net.connect("g", "c", neuro.fixed_indegree(n=10), weight=100.0, delay=1.0)
    delay = neuro.uniform(low=0.1, high=4.0)
    net.connect("c", "c", neuro.fixed_indegree(n=5), rule(Wmax=90.0, lambda_=0.1), weight=50.0, delay=delay, name="w")
    return net


def found(net, backend, threads=1):
    sim = neuro.compile(net, backend, threads=threads)
    sim.run(60.0)
    sim.set("w", tau_plus=10.0, alpha=0.8)
    sim.set("c", V_th=-56.0)
    sim.run(3.3)
    between = sim.get("w", "weight")
    sim.run(60.0)
    return {"between": between, **observe(sim)}


def test_by_address_as_compiled_in():
    ours = found(network(neuro.iaf_psc_exp, neuro.stdp), "event")
    assert np.ptp(ours["between"]) > 10.0
    for threads in (1, 2):
        theirs = found(network(my_cell, my_rule), "event", threads)
        assert differences(ours, theirs, exact=False) == []


@dataclass(frozen=True, kw_only=True, eq=False)
class my_dopa(neuro.stdp_dopa):
    """A rule under dopamine with the arithmetic of its base."""


def under_dopamine(rule, backend, threads=1):
    net = neuro.Network("dopamine")
    net.population("noise", 20, neuro.poisson_generator(rate=300.0))
    net.population("cells", 15, neuro.iaf_psc_exp())
    net.population("reward", 3, neuro.poisson_generator(rate=100.0))
    net.signal("level", to="cells")
    level = rule(signal="level", Wmax=400.0, A_plus=3.0, A_minus=1.0, tau_n=30.0, deliver_interval=3)
    delay = neuro.uniform(low=0.5, high=3.0)
    net.connect("noise", "cells", neuro.all_to_all(), level, weight=200.0, delay=delay, name="w")
    spikes = rule(dopamine="reward", Wmax=80.0, b=0.01, tau_n=30.0)
    net.connect("cells", "cells", neuro.all_to_all(), spikes, weight=20.0, delay=1.0)
    sim = neuro.compile(net, backend, threads=threads)
    for n, tau_c in ((0.03, 1000.0), (-0.02, 300.0)):
        sim.run(30.0)
        sim.signal("level", n)
        sim.set("w", tau_c=tau_c, tau_plus=12.0)
        sim.run(21.0)
    return observe(sim)


def test_under_dopamine_by_address_as_compiled_in():
    ours = under_dopamine(neuro.stdp_dopa, "event")
    assert np.ptp(ours["weight of w"]) > 10.0
    for backend, threads in (("event", 2), ("reference", 1)):
        assert differences(ours, under_dopamine(my_dopa, backend, threads), exact=False) == []


@dataclass(frozen=True, kw_only=True, eq=False)
class without_functions(Neuron):
    """A neuron that says nothing of what it does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class without_tau(Synapse):
    """A rule whose trace has no time constant."""

    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_x"),)
    Wmax: float = quantity(1.0, "", "largest weight")


def test_what_is_incomplete_is_refused_where_it_stands():
    net = neuro.Network("own")
    net.population("c", 3, without_functions())
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net)
    assert "population 'c': neuron model 'without_functions': " in str(error.value)
    assert "has no function 'constants'" in str(error.value)
    net = neuro.Network("own")
    net.population("c", 3, neuro.iaf_psc_exp())
    net.connect("c", "c", neuro.all_to_all(), without_tau(), name="w")
    with pytest.raises(neuro.ModelError, match="projection 'w': synapse model 'without_tau' has no 'tau_x'"):
        neuro.compile(net)


MINE = """
from dataclasses import dataclass
import neuro

constants, quiet, step = neuro.iaf_psc_delta.constants, neuro.iaf_psc_delta.quiet, neuro.iaf_psc_delta.step

@neuro.register
@dataclass(frozen=True, kw_only=True, eq=False)
class my_cell(neuro.iaf_psc_delta):
    "Resets to its own number."

def fire(s, c, i):
    s[0, i] = NUMBER
"""
RUN = """
import sys
import neuro
WITH
net = neuro.Network("own")
net.population("c", 1, neuro.my_cell(I_e=1000.0, t_ref=0.0) if NUMBER else neuro.iaf_psc_delta(I_e=1000.0, t_ref=0.0))
sim = neuro.compile(net)
sim.run(101.0)
print(len(sim.spikes("c")[0]))
"""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache with the engine, as one process leaves it."""
    cache = tmp_path_factory.mktemp("compiled")
    told(RUN.replace("WITH", "").replace("NUMBER", "0"), cache, cache)
    return cache


def told(code, folder, cache):
    """What a process says that runs in a folder."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.slow
def test_an_edited_model_is_compiled_anew_and_nothing_else(compiled, tmp_path):
    def kept():
        return {path.name for path in compiled.rglob("*-*") if path.is_file()}

    def run(number):
        (tmp_path / "mine.py").write_text(MINE.replace("NUMBER", str(number)))
        (spikes,) = told(RUN.replace("WITH", "import mine").replace("NUMBER", str(number)), tmp_path, compiled)
        return int(spikes), kept()

    engine = kept()
    one, with_one = run(-60.0)
    two, with_two = run(-90.0)
    assert one > two > 0
    assert len(with_one - engine) == len(with_two - with_one) == 1


RULE = """
from dataclasses import dataclass
import neuro

@dataclass(frozen=True, kw_only=True, eq=False)
class ruleNUMBER(neuro.stdp):
    "Sends its own number."

def constants(p, h, c):
    c[0] = NUMBER

def on_post(y, e, c, pre, post):
    pass

def on_pre(y, e, c, pre, post):
    y[0, e] = c[0]MORE
"""


@pytest.mark.slow
def test_models_that_other_processes_compiled_do_not_mix(compiled, tmp_path):
    """Numba numbers functions within a process: two entries of one factory could have one name."""

    def run(*numbers):
        code = "import neuro\n"
        for n in numbers:
            (tmp_path / f"mine{n}.py").write_text(RULE.replace("NUMBER", str(n)).replace("MORE", " + 1.0" * (n - 1)))
            code += f"from mine{n} import rule{n}\n"
        for n in numbers:
            code += "net = neuro.Network(); net.population('g', 1, neuro.spike_generator(spike_times=[[1.0]]))\n"
            code += "net.population('c', 1, neuro.iaf_psc_exp())\n"
            code += f"net.connect('g', 'c', neuro.all_to_all(), rule{n}(), weight=9.0, name='w')\n"
            code += "sim = neuro.compile(net); sim.run(10.0); print(sim.get('w', 'weight')[0])\n"
        return [float(weight) for weight in told(code, tmp_path, compiled)]

    assert run(1) == [1.0]  # all but the rule is compiled then, so that the next two number their functions alike
    assert [run(2), run(3)] == [[3.0], [5.0]]
    assert run(2, 3) == [3.0, 5.0]


@dataclass(frozen=True, kw_only=True, eq=False)
class wide(neuro.iaf_psc_delta):
    """A neuron with room for more numbers than ours have."""

    width: ClassVar[int] = 45


def test_a_model_says_how_many_numbers_it_has():
    net = neuro.Network("wide")
    net.population("noise", 20, neuro.poisson_generator(rate=300.0))
    net.population("ours", 70, neuro.iaf_psc_delta())
    net.population("theirs", 70, wide(tau_m=neuro.uniform(low=5.0, high=15.0)))
    for name in ("ours", "theirs"):
        net.connect("noise", name, neuro.fixed_indegree(n=10), weight=2.0, delay=1.0)
    sims = alike(net, 40.0)
    for sim in sims:
        sim.set("theirs", V_th=np.linspace(-60.0, -55.0, 70))
        sim.run(40.0)
    assert sims[0].counts().populations["theirs"].spikes > 10
    same(*sims, exact=False)
