"""The backend torch: it gives what the reference gives, cut, steered, saved and reset; and what it refuses."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro import ModelError
from neuro.core.errors import Where
from neuro.core.extras import install
from neuro.model.network import Network
from neuro.testing import laws
from neuro.testing.case import differences, observe
from neuro.testing.laws import Subject, steer_wired, wired
from neuro_torch import backend
from refused import error_of, refused
from strategies import networks

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

STEPS = 60
LAWS = [
    laws.cutting_does_not_matter_when_steered,
    laws.a_reset_repeats,
    laws.a_state_saved_after_a_change_continues,
    laws.counts_follow_from_spikes,
]


def static(net: Network) -> Network:
    """The network without what learns and competes."""
    net.groups.clear()
    net.signals.clear()
    net.projections.update({name: replace(p, synapse=neuro.static()) for name, p in net.projections.items()})
    return net


def start(net: Network, seed: int = 1, threads: int = 1, **options: object):
    return neuro.compile(net, backend, seed=seed, threads=threads, **options)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_laws_of_a_network_without_a_group(law):
    subject = Subject("_of_static_synapses", "static synapses, no group", lambda: static(wired()), steer_wired)
    assert differences(*law(start, subject), exact=True) == []


def test_steered_it_gives_what_the_reference_gives():
    subject = Subject("", "", lambda: static(wired()), steer_wired)
    sims = [neuro.compile(subject.make(), each, seed=1) for each in ("reference", backend)]
    expected, found = (laws.steered(sim, subject) for sim in sims)
    assert differences(expected, found, exact=False) == []
    assert len(expected["spikes of delta: steps"]) > 20


@settings(max_examples=6, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(net=networks().map(static), seed=st.integers(0, 5), cut=st.integers(1, STEPS - 1))
def test_random_networks(net: Network, seed: int, cut: int):
    expected, found = (neuro.compile(net, each, seed=seed) for each in ("reference", backend))
    laws.steps(expected, STEPS)
    for n in (cut, STEPS - cut):
        laws.steps(found, n)
    assert differences(observe(expected), observe(found), exact=False) == []


def poisson(**words: object):
    net = neuro.Network("p")
    net.population("noise", 3, neuro.poisson_generator(rate=900.0))
    net.population("cells", 3, neuro.iaf_psc_delta(**words))
    net.connect("noise", "cells", neuro.all_to_all(), weight=3.0)
    return net


def test_weights_change_between_a_spike_and_its_arrival():
    found = []
    for each in ("reference", backend):
        net = neuro.Network("late")
        net.population("in", 1, neuro.spike_generator(spike_times=[[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]))
        net.population("cells", 1, neuro.iaf_psc_delta(tau_m=float("inf")))
        net.connect("in", "cells", neuro.one_to_one(), weight=1.0, delay=3.0)
        sim = neuro.compile(net, each)
        for weight in (1.0, 2.0, 4.0, 0.5):
            sim.set_weights("in_cells", weight)
            sim.run(2.0)
        found.append(observe(sim))
    assert differences(*found, exact=False) == []
    # What a generator emits in the step before the weights change keeps the former ones.
    assert found[1]["V_m of cells"].tolist() == [-70.0 + 1.0 + 1.0 + 2.0 + 2.0 + 4.0]


def test_threads_are_given_back():
    before = torch.get_num_threads()
    sim = start(poisson(), threads=2)
    sim.run(1.0)
    assert torch.get_num_threads() == before


def test_what_is_refused(messages):
    wrong = ({"devise": "cpu"}, {"device": "cuda:99"}, {"device": "gpu"})
    told = {str(words): refused(start, poisson(), **words).replace(", cuda:0", "") for words in wrong}
    net = wired()
    net.place = Where("here")
    net.connect("relay", "delta", neuro.all_to_all(), neuro.stdp(Wmax=5.0), weight=1.0, name="learnt")
    messages(told | {"two problems": "\n".join(map(str, error_of(start, net).others)).partition(": ")[2]})


def test_one_error_where_torch_is_missing(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("neuro_torch.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert refused(start, poisson()) == f"backend 'torch': torch is not installed\n  hint: {install('torch')}"


def test_names_and_problems_need_no_torch():
    import subprocess

    code = (
        "import sys, neuro, neuro_torch; from neuro.compiler import compile_network; "
        "net = neuro.Network('n'); net.population('c', 1, neuro.hh_psc_alpha()); "
        "assert not neuro_torch.backend.problems(compile_network(net, 0)); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


STRANGE = '''
"""A neuron with a loop, branches and a return in the middle."""
from dataclasses import dataclass
from neuro.extend import Neuron, State, quantity

@dataclass(frozen=True, kw_only=True, eq=False)
class ladder(Neuron):
    """Climbs by rungs."""
    states = (State("V_m", "mV", "potential"), State("rungs", "", "climbed"))
    weight_unit = "mV"
    V_th: float = quantity(4.0, "mV", "threshold", arrays=True)
    V_reset: float = quantity(0.0, "mV", "after a spike")

def constants(p, h, c):
    """Threshold and reset."""
    c[0], c[1] = p[1], p[2]

def climbed(v, x):
    """Rungs up to 3, as far as x carries."""
    rungs = 0
    while x > 0.5:
        if v + rungs > 5.0:
            return rungs
        x -= 0.5 + 0.1 * rungs
        rungs += 1
        if rungs == 3:
            break
    else_ = rungs
    return else_

def step(s, c, x, i_0, lo, hi, fired):
    """Climb."""
    for i in range(lo, hi):
        fired[i] = 0
        if x[0, i] == 0.0:
            s[0, i] -= 0.01 if s[0, i] > 0.0 else 0.0
            continue
        k = climbed(s[0, i], x[0, i])
        s[1, i] += max(0.0, float(k))
        for _ in range(k):
            s[0, i] += 0.75
        fired[i] = s[0, i] >= c[0] and not k == 1

def fire(s, c, i):
    """Down."""
    s[0, i] = c[1]

def quiet(s, c, i_0, lo, hi):
    """Never."""
    return False
'''


def beside_the_reference(cells, weight):
    """What the reference finds of eight neurons under noise, which this backend finds, too."""
    net = neuro.Network("noisy")
    net.population("noise", 12, neuro.poisson_generator(rate=800.0))
    net.population("cells", 8, cells)
    net.connect("noise", "cells", neuro.all_to_all(), weight=weight, delay=0.2)
    expected, found = (neuro.compile(net, each, seed=2) for each in ("reference", backend))
    for sim in (expected, found):
        sim.run(30.0)
    assert differences(observe(expected), observe(found), exact=False) == []
    return expected


def test_a_third_party_codes_neuron_with_branches_and_loops(tmp_path: Path, monkeypatch):
    (tmp_path / "my_ladder.py").write_text(STRANGE)
    monkeypatch.syspath_prepend(tmp_path)
    from my_ladder import ladder

    cells = ladder(V_th=neuro.uniform(low=2.0, high=5.0))
    expected = beside_the_reference(cells, neuro.uniform(low=0.1, high=1.5))
    assert len(expected.spikes("cells")[0]) > 10
    assert len(set(expected.get("cells", "rungs"))) > 1


EQUATIONS = yaml.safe_load((Path(__file__).parents[1] / "equations" / "models.yaml").read_text())["models"]


@pytest.mark.parametrize(
    ("name", "weight", "words"),
    [
        ("own_iaf_psc_alpha", 300.0, {}),
        ("own_izhikevich", 6.0, {}),
        ("own_iaf_cond_exp", 8.0, {"integrator": {"rk4": {"substeps": 2}}}),
    ],
)
def test_neurons_of_equations(name, weight, words):
    cells = neuro.equations(name, **{**EQUATIONS[name], **words})(I_e=neuro.uniform(low=0.0, high=9.0))
    expected = beside_the_reference(cells, neuro.uniform(low=0.0, high=weight))
    assert len(expected.spikes("cells")[0]) > 5


def test_what_is_no_arithmetic_is_refused_with_its_line(tmp_path: Path, monkeypatch):
    text = STRANGE.replace("k = climbed(s[0, i], x[0, i])", "k = sum([1 for _ in range(2)])")
    (tmp_path / "my_listed.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    from my_listed import ladder

    net = neuro.Network("strange")
    net.population("cells", 8, ladder())
    line = 1 + text.splitlines().index("        k = sum([1 for _ in range(2)])")
    told = (
        rf"cannot run for all neurons at once \(my_listed.step, line {line}: '\[1 for _ in range\(2\)\]'\)\n  hint: w"
    )
    with pytest.raises(ModelError, match=told):
        start(net)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")
@pytest.mark.parametrize("name", ["networks_of_all_models", "delta_neuron", "ports_do_what_calls_do", "drawn_weights"])
def test_a_gpu_gives_the_same(name):
    from neuro.testing import CASES

    found = CASES[name].run(lambda net, seed=1, **more: start(net, seed, device="cuda"))
    expected = CASES[name].run(lambda net, seed=1, **more: neuro.compile(net, "reference", seed=seed))
    assert differences(expected, found, exact=False) == []
