"""Messages that name the nearest right thing."""

import pytest

import neuro
import neuro_models
from neuro import ModelError


def told(make) -> str:
    with pytest.raises(ModelError) as caught:
        make()
    return str(caught.value).partition(": ")[2]


@pytest.fixture
def net() -> neuro.Network:
    net = neuro.Network("n")
    net.population("cells", [2, 3], neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.all_to_all(), name="d")
    return net


def test_a_choice_as_a_mapping():
    assert told(lambda: neuro.distance_dependent(mask={"circular": {"radius": 0.3}})) == (
        "distance_dependent.mask = {circular: {radius: 0.3}}: expected a mask\n  hint: write neuro.circular(radius=0.3)"
    )
    assert told(lambda: neuro.distance_dependent(p={"gaussian": {"std": 2, "a": 0.5}})).endswith(
        "hint: write neuro.gaussian(std=2, a=0.5)"
    )
    assert "hint" not in told(lambda: neuro.distance_dependent(mask={"oval": 3}))


def test_a_function_of_distance_as_a_weight(net):
    message = told(
        lambda: net.connect("cells", "cells", neuro.all_to_all(), weight=neuro.gaussian(std=0.2), name="again")
    )
    assert message == (
        "projection 'again': weight = gaussian(std=0.2): expected a number\n"
        "  hint: write neuro.of_distance(neuro.gaussian(std=0.2))"
    )


def test_projections_can_be_probed(net):
    assert told(lambda: net.probe("zz", "dd", "weight")) == (
        "probe 'zz': unknown population 'dd'\n  hint: did you mean 'd'?"
    )
    assert told(lambda: net.probe("zz", "other", "weight")).endswith("hint: known: cells, d")


def test_words_of_a_part():
    assert told(lambda: neuro.event_camera(crop=[0, 0, 32, 48])) == (
        "event_camera.crop = [0, 0, 32, 48]: expected the words of crop\n  hint: its words are x, y"
    )


@pytest.mark.parametrize("name", ["dense", "dense.yaml"])
def test_a_published_network_by_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hint = "the published network is neuro.load(neuro_models.path('dense'))"
    assert told(lambda: neuro.load(name)) == f"no such file\n  hint: {hint}"
    assert neuro.load(neuro_models.path("dense")).populations
    assert told(lambda: neuro.load("dens")) == "no such file"
    neuro.Network("mine").save(tmp_path / "mine.yaml")
    (tmp_path / "mine.yaml").rename(tmp_path / name)
    assert neuro.load(name).name == "mine"


@pytest.mark.parametrize("micro", ["\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"])
def test_micro(micro):
    message = told(lambda: neuro.iaf_psc_exp(tau_m=f"10000 {micro}s"))
    assert message.endswith("expected a number > 0 ms\n  hint: write 10000 us")


def test_a_name_of_the_library():
    with pytest.raises(AttributeError) as caught:
        neuro.noise_genertor  # noqa: B018
    assert str(caught.value) == "module 'neuro' has no attribute 'noise_genertor': did you mean 'noise_generator'?"
    with pytest.raises(AttributeError) as caught:
        neuro.nothing_like_it  # noqa: B018
    assert str(caught.value) == "module 'neuro' has no attribute 'nothing_like_it'"


RECORDING = "spikes are recorded without a device; 'probes' (YAML) or net.probe (Python) records the rest"
OF_OTHERS = {
    "model: spike_recorder": RECORDING,
    "model: spike_detector": RECORDING,
    "model: multimeter": RECORDING,
    "model: SpikeMonitor": RECORDING,
    "model: weight_recorder": RECORDING,
    "model: static_synapse": "'static' is a synapse, not a model",
    "model: stdp_synapse": "'stdp' is a synapse, not a model",
    "model: volume_transmitter": "dopamine is a signal, or the spikes of a population: neuro models stdp_dopa",
    "model: poisson_generator_ps": "did you mean 'poisson_generator'?",
    "model: iaf_neuron": "did you mean 'iaf_psc_alpha'?",
    "model: RLeaky": "did you mean 'iaf_psc_delta'?",
    "model: HH_cond_exp": "did you mean 'hh_psc_alpha'?",
    "model: {iaf_psc_exp: {R: 40.0}}": "the resistance is tau_m / C_m",
    "model: {iaf_psc_exp: {g_L: 10.0}}": "the leak conductance is C_m / tau_m",
    "model: {iaf_psc_exp: {V_m: -60.0}}": "a state at the start is a word of 'initial', beside the model",
    "model: {iaf_psc_exp: {tau_m: 10*ms}}": "write 10 ms",
    "model: iaf_psc_exp, params: {tau_m: 10.0}": "write {name: {parameter: value}}",
    "model: iaf_psc_exp, threshold: -50.0": "write model: {iaf_psc_exp: {V_th: -50}}",
    "model: iaf_psc_exp, num_neurons: 3": "did you mean 'shape'?",
    "rule: fixed_indegree, indegree: 5": "write rule: {fixed_indegree: {n: 5}}",
    "rule: {rule: fixed_indegree, indegree: 5}": "write {fixed_indegree: {n: 5}}",
    "rule: {pairwise_bernoulli: {prob: 0.1}}": "did you mean 'p'?",
    "rule: all_to_all, synapse: {weight: 10.0}": "weight and delay are words of a projection, beside its synapse",
    "rule: all_to_all, synapses: stdp": "in YAML {from: source, to: target, rule: all_to_all} in 'projections'",
    "connect: all_to_all": "did you mean 'rule'?",
    "population: {}": "in YAML name: {shape: 3, model: iaf_psc_exp} in 'populations'",
    "rule: all_to_all, syn_model: stdp": "did you mean 'synapse'?",
    "rule: all_to_all, receptor_type: ex": "write synapse: {static: {receptor: ex}}",
    "rule: all_to_all, weight: normal(10, 2)": "write {name: {word: value}}",
    "to: spike_recorder": RECORDING,
    "record_from: V_m": "did you mean 'record'?",
    "variables: V_m": "did you mean 'record'?",
    "weight_recorder: {}": "did you mean 'probes'?",
    "duration: 100.0": "it is given when the network runs: neuro run FILE --for 100, or sim.run(100.0)",
    "seed: 3": "it is given when the network runs: neuro run FILE --seed 1, or neuro.compile(net, seed=1)",
}
PLACES = {
    "model": "populations: {{cells: {{shape: 3, {}}}}}",
    "rule": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\n"
    "projections: {{p: {{from: cells, to: cells, {}}}}}",
    "to": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\n"
    "projections: {{p: {{from: cells, rule: all_to_all, {}}}}}",
    "record_from": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\nprobes: {{v: {{of: cells, {}}}}}",
}
PLACES["connect"] = PLACES["rule"]
PLACES["variables"] = PLACES["record_from"]


@pytest.mark.parametrize(("written", "hint"), OF_OTHERS.items())
def test_habits_of_other_tools_in_a_file(written, hint, tmp_path):
    (tmp_path / "net.yaml").write_text(PLACES.get(written.partition(":")[0], "{}").format(written), "utf-8")
    assert hint in told(lambda: neuro.load(tmp_path / "net.yaml")).partition("hint: ")[2]


IN_PYTHON = {
    "neuro.Network('n', dt=0.1)": "did you mean 'resolution'?",
    "net.population('x', N=3, model=neuro.iaf_psc_exp())": "did you mean 'shape'?",
    "net.connect('cells', 'cells', conn_spec=neuro.all_to_all())": "did you mean 'rule'?",
    "net.connect('cells', 'cells', neuro.all_to_all(), w=3.0)": "did you mean 'weight'?",
    "net.connect(pre='cells', post='cells', rule=neuro.all_to_all())": "did you mean 'source'?",
    "net.probe('v', 'cells', 'V_m', interval=1.0)": "did you mean 'every'?",
    "net.connect(['cells'], 'cells', neuro.all_to_all())": "expected a name",
    "net.run(100.0)": "write sim = neuro.compile(net), then sim.run(100.0)",
    "net.record('cells')": RECORDING,
    "net.create(3)": "write net.population(name, shape, model)",
    "net.conect('cells', 'cells')": "did you mean 'connect'?",
    "neuro.simulate(net, 100.0)": "write sim = neuro.compile(net), then sim.run(100.0)",
    "neuro.Create('iaf_psc_exp')": "write net.population(name, shape, model)",
    "neuro.NeuronGroup(3)": "write net.population(name, shape, model)",
    "neuro.Synapses()": "write net.connect(source, target, rule)",
    "neuro.SpikeMonitor()": RECORDING,
    "neuro.compile(net, simulator='nest')": "did you mean 'backend'?",
    "neuro.compile(net, n_threads=2)": "did you mean 'threads'?",
}


@pytest.mark.parametrize(("written", "hint"), IN_PYTHON.items())
def test_habits_of_other_tools_in_python(written, hint, net):
    with pytest.raises((AttributeError, TypeError, ModelError)) as caught:
        eval(written)
    assert hint in str(caught.value)
