"""Third-party parts that are not what they should be: each is reported, none runs on with other numbers."""

import math
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import neuro
from alike import alike, same
from beside import beside
from neuro.extend import Distribution, Neuron, Rule, State, Synapse, Trace, quantity
from refused import refused


def network(**words):
    net = neuro.Network("own")
    net.population("in", 3, neuro.poisson_generator(rate=200.0))
    net.population("out", 2, words.pop("model", neuro.iaf_psc_exp()))
    words = {"weight": 10.0, "delay": 1.0, "name": "w", "rule": neuro.all_to_all(), **words}
    net.connect("in", "out", **words)
    return net


@dataclass(frozen=True, kw_only=True, eq=False)
class since_pre(Synapse):
    """Potentiates less the longer ago the pre spike was; depresses by post spikes of long ago."""

    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_y"), Trace("tau_minus"))

    tau_y: float = quantity(30.0, "ms", "of a post trace", above=0)
    window: float = quantity(10.0, "ms", "of the pre spike", above=0)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:2] = p[:2]


def on_post(y, e, c, pre, post):
    """Potentiate."""
    y[0, e] += math.exp(-pre[0] / c[1])


def on_pre(y, e, c, pre, post):
    """Depress."""
    y[0, e] -= 0.1 * post[0] * post[1]


def test_times_of_pre_spikes_are_alike():
    sims = alike(network(synapse=since_pre(), model=neuro.iaf_psc_exp(I_e=500.0)), 60.0)
    for sim in sims:
        sim.set("w", window=4.0)
        sim.run(60.0)
    assert np.ptp(sims[0].get("w", "weight")) > 0.1
    same(*sims, exact=False)


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_a_trace_of_post_spikes_keeps_its_time_constant(backend, messages):
    sim = neuro.compile(network(synapse=since_pre()), backend)
    messages({"fixed": refused(sim.set, "w", tau_y=5.0)})


class bare(Neuron):
    """No dataclass."""

    a: float = quantity(1.0, "", "of no use")


@dataclass(frozen=True, kw_only=True, eq=False)
class plain(Neuron):
    """A field that says nothing of itself."""

    a: float = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class wordy(Synapse):
    """A default that is no number."""

    top: float = quantity("big", "", "largest weight")


@dataclass(frozen=True, kw_only=True, eq=False)
class forgetful(Synapse):
    """Has functions for spikes, and does not say that it learns."""

    a: float = quantity(1.0, "", "of no use")


@dataclass(frozen=True, kw_only=True, eq=False)
class lone(Synapse):
    """A trace that is not in a tuple."""

    learns: ClassVar[str] = "pairs"
    pre = Trace("tau_plus")
    tau_plus: float = quantity(20.0, "ms", "time constant", above=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class short(Rule):
    """Takes too little."""

    def connect(self, source, target):
        """Say the pairs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class longer(Distribution):
    """Draws one too many."""

    def sample(self, rng, n):
        """Draw."""
        return rng.uniform(size=n + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class nothing(Distribution):
    """Draws what is no number."""

    def sample(self, rng, n):
        """Draw."""
        return np.full(n, np.nan)


@dataclass(frozen=True, kw_only=True, eq=False)
class absent(Distribution):
    """Does not say how it is drawn."""


def test_what_is_not_as_it_should_be_is_told(messages):
    messages.calls(globals())


def test_a_state_of_other_states_is_refused(tmp_path):
    """An edit may swap two states, which all arrays fit."""

    def made(names):
        base = neuro.iaf_psc_exp
        states = tuple(State(name, "pA", "") if name.startswith("I_") else State(name, "mV", "") for name in names)
        hidden = (State("refractory", "steps", "", hidden=True),)
        body = {"states": states + hidden, "__doc__": "Edited.", "__module__": __name__}
        mine = dataclass(frozen=True, kw_only=True, eq=False)(type("edited", (base,), body))
        return neuro.compile(network(model=mine()), "reference")

    made(("V_m", "I_syn_ex", "I_syn_in")).save(tmp_path / "state.h5")
    with pytest.raises(neuro.ModelError, match="a state of another network 'own'"):
        made(("V_m", "I_syn_in", "I_syn_ex")).restore(tmp_path / "state.h5")


UNCOMPILABLE, HELPED, RUN, BROKEN = beside(__file__, "UNCOMPILABLE", "HELPED", "RUN", "BROKEN")


def test_what_numba_cannot_compile_is_told_in_one_error(tmp_path, registries, monkeypatch, answer, messages):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_odd.py").write_text(UNCOMPILABLE)
    (tmp_path / "net.yaml").write_text("neuro: 1\nname: one\npopulations:\n  cells: {model: odd, shape: 2}\n")
    done = answer("run", "net.yaml", "--with", "my_odd.py", "--for", "1")
    assert done.status == 2
    messages({"told": "\n".join(done.err.splitlines()[-2:]).replace(f"{tmp_path}/", "")})


def test_what_lies_beside_a_file_is_found(tmp_path):
    (tmp_path / "beside_it.py").write_text("RATE = 5.0\n")
    (tmp_path / "mine_with_help.py").write_text(HELPED)
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    words = [sys.executable, "-c", RUN.format(tmp_path)]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == (str(tmp_path), "")


def test_an_installed_package_that_is_broken_troubles_only_who_names_it(tmp_path, messages):
    info = tmp_path / "broken-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[neuro.models]\nlost = nowhere:lost\nizhikevich = nowhere:other\n")
    done = subprocess.run([sys.executable, "-c", BROKEN, str(tmp_path)], capture_output=True, text=True, check=True)
    messages({"told": done.stdout})


@dataclass(frozen=True, kw_only=True, eq=False)
class late(Neuron):
    """Fires in the step after an arrival; its functions are in its body."""

    states: ClassVar[tuple[State, ...]] = (State("came", "", "what the last step brought"),)

    def constants(p, h, c):
        """There are none."""

    def step(s, c, x, i_0, lo, hi, fired):
        """Fire after an arrival."""
        for i in range(lo, hi):
            fired[i] = s[0, i] > 0.0
            s[0, i] = x[0, i]

    def fire(s, c, i):
        """Nothing is reset."""

    def quiet(s, c, i_0, lo, hi):
        """As long as nothing came."""
        came = 0
        for i in range(lo, hi):
            came += s[0, i] != 0.0
        return came == 0


class silent_once(late):
    """As `late`, but a spike takes what came meanwhile; the other functions are those of its base."""

    def fire(s, c, i):
        """Forget."""
        s[0, i] = 0.0


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_functions_may_stand_in_the_body_of_a_class_and_are_inherited(backend):
    counts = []
    for model in (late, silent_once):
        net = neuro.Network("own", resolution=1.0)
        net.population("in", 1, neuro.spike_generator(spike_times=[[1.0, 2.0, 3.0, 4.0]]))
        net.population("out", 1, model())
        net.connect("in", "out", neuro.all_to_all(), weight=1.0, delay=1.0)
        sim = neuro.compile(net, backend)
        sim.run(10.0)
        counts.append(len(sim.spikes("out")[0]))
    assert counts == [4, 2]
