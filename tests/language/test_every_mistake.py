"""Mistakes that have nothing to do with each other: `neuro check` tells all of them, where they are, and no other."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from neuro.compiler.mistakes import mistakes
from rewording import same_if_reworded

PAIRS = """\
neuro: 1
name: rich
resolution: 0.1
parameters:
  w: 300.0 pA
  g: 4.0
  few: $(20 / 4)
models:
  fading:
    equations: {V_m: -V_m/tau + I/C_m}
    threshold: V_m >= theta
    reset: {V_m: 0 mV}
    parameters: {tau: 10 ms, theta: 20 mV, C_m: 250 pF}
populations:
  noise:
    model:
      poisson_generator:
        rate: 100.0 Hz
        start: 10.0
        stop: 900.0
    shape: 20
  drive:
    model:
      noise_generator:
        std: 20.0
        dt: 1.0
    shape: 1
  eyes:
    model:
      event_camera:
        scale: 1
    shape: [2, 4, 4]
  exc:
    model:
      iaf_psc_exp:
        tau_m: 10.0
        C_m: 250.0
        V_th: -50.0
        t_ref: 2.0
    shape: [2, 4]
    initial:
      V_m: -65.0
      I_syn_ex: 0.0
    extent: [2.0, 4.0]
  inh:
    model:
      iaf_psc_exp:
        tau_syn_ex: 2.0
        I_e: 0.0
    shape: 8
  out:
    model: iaf_psc_delta
    shape: 4
  own:
    model:
      fading:
        tau: 5.0
    shape: 3
projections:
  noise_exc:
    from: noise
    to: exc
    rule: all_to_all
    weight: $w
    delay: 1.0
    synapse:
      stdp:
        Wmax: 1000.0
        lambda: 0.01
        tau_plus: 20.0
  drive_inh:
    from: drive
    to: inh
    rule: all_to_all
  exc_exc:
    from: exc
    to: exc
    rule:
      distance_dependent:
        p: {gaussian: {a: 0.5, std: 1.0}}
        autapses: false
    weight: 20.0
    delay: 1.5
  exc_inh:
    from: exc
    to: inh
    rule: one_to_one
    weight:
      normal:
        mean: 10.0
        std: 1.0
    delay: 1.5
    synapse:
      stdp_dopa:
        signal: reward
        tau_c: 1000.0
        Wmax: 100.0
  inh_out:
    from: {inh: "0:4"}
    to: out
    rule:
      fixed_indegree:
        n: 3
        multapses: true
    weight: $(-g * 5)
    delay: 2.0
  inh_own:
    from: inh
    to: own
    rule:
      pairs:
        pre: [0, 1]
        post: [0, 2]
    weight: [1.0, 2.0]
    delay: 2.0
groups:
  choice:
    winner_take_all:
      of: out
      first_to_fire: true
signals:
  reward:
    to: inh
probes:
  v:
    of: {exc: "0, :"}
    record: [V_m, I_syn_ex]
    every: 1.0
  u:
    of: inh
    record: rate
    every: 10.0
  weights:
    of: noise_exc
    record: weight
    every: 100.0
    synapses: [0, 5]
  some:
    of: inh_out
    record: weight
    every: 50.0
    pre: {inh: 3}
  traces:
    of: exc_inh
    record: [weight, c]
    every: 50.0
"""
TRIALS = """\
neuro: 1
resolution: 1.0
populations:
  input:
    model: spike_generator
    shape: [2, 6, 6]
  s1:
    model:
      iaf_psc_delta:
        V_th: -60.0
        t_ref: 2.0
    shape: [4, auto, auto]
  s2:
    model: iaf_psc_delta
    shape: [4, 1, 1]
projections:
  input_s1:
    from: input
    to: s1
    rule:
      grid:
        kernel: [3, 3]
        stride: 1
    weight: {uniform: {low: 0.1, high: 0.9}}
    delay: 1.0
  s1_s2:
    from: s1
    to: s2
    rule: all_to_all
    weight: 0.5
    delay: 2.0
    synapse:
      r_stdp:
        Ar_plus: 0.01
groups:
  decide:
    winner_take_all:
      of: s2
trials:
  input: input
  duration: 20.0
  stop: full
  labels:
    of: s2
    maps_per_label: 2
  reward:
    correct: 1.0
    silent: 0.0
  reset: [V_m]
probes:
  v:
    of: s1
    record: V_m
"""
# What is written in place of a line's end, by what the line begins with, below the part; and what is told.
Planted = dict[str, tuple[str, str, str, str]]
IN_PAIRS: Planted = {
    "version": ("neuro: 1", "", "2", "neuro = 2: expected 1"),
    "resolution": ("resolution", "", "-0.1", "resolution = -0.1"),
    "twice": ("noise", "start: 10.0", "rate: 10.0", "'rate' is said twice"),
    "no model of inh": ("inh", "iaf_psc_exp:", "iaf_psc_ex:", "unknown model 'iaf_psc_ex'"),
    "own model": ("fading", "threshold", "V_m >= thta", "thta"),
    "no synapse": ("exc_inh", "stdp_dopa:", "stdp_dop:", "unknown synapse 'stdp_dop'"),
    "unknown source": ("inh_own", "from", "ihn", "unknown population 'ihn'"),
    "unknown target": ("exc_exc", "to", "nobody", "unknown population 'nobody'"),
    "unknown section": ("signals", "", "sginals:", "unknown word of a network 'sginals'"),
    "unknown word": ("u", "record: rate", "recrod: rate", "unknown word of a probe 'recrod'"),
    "unknown group": ("choice", "winner_take_all:", "winner_tak_all:", "unknown group 'winner_tak_all'"),
    "no end": ("drive_inh", "to: inh", "onto: inh", "unknown word of a projection 'onto'"),
    "division by zero": ("few", "", "$(20 / 0)", "a division by 0"),
    "parameter without value": ("g", "", "~", "parameter 'g' has no value"),
    "rate": ("noise", "rate", "-1.0", "poisson_generator.rate = -1"),
    "start off the grid": ("noise", "start", "10.05", "poisson_generator.start = 10.05 ms"),
    "stop": ("noise", "stop", "soon", "poisson_generator.stop = 'soon'"),
    "size of noise": ("noise", "shape", "0", "shape = 0"),
    "std of noise": ("drive", "std", "-2.0", "noise_generator.std = -2"),
    "dt off the grid": ("drive", "dt", "1.05", "noise_generator.dt = 1.05 ms"),
    "tau_m": ("exc", "tau_m", "-10.0", "iaf_psc_exp.tau_m = -10"),
    "wrong unit": ("exc", "C_m", "250 mV", "iaf_psc_exp.C_m = 250 mV: expected a capacitance"),
    "threshold below reset": ("exc", "V_th", "-80.0", "iaf_psc_exp.V_reset = -70 mV: expected less than V_th"),
    "t_ref off the grid": ("exc", "t_ref", "2.05", "iaf_psc_exp.t_ref = 2.05 ms"),
    "initial": ("exc", "V_m", "low", "initial.V_m = 'low'"),
    "initial array": ("exc", "I_syn_ex", "[0.0, 1.0]", "initial.I_syn_ex: an array of shape [2]"),
    "no parameter": ("inh", "tau_syn_ex: 2.0", "tau_syn_exc: 2.0", "unknown parameter of iaf_psc_exp 'tau_syn_exc'"),
    "unknown name": ("inh", "I_e", "$current", "unknown parameter '$current'"),
    "no model": ("out", "model", "iaf_psc_dleta", "unknown model 'iaf_psc_dleta'"),
    "own parameter": ("own", "tau", "-5.0 ms", "fading.tau = -5"),
    "no recording": ("eyes", "scale: 1", "file: no.aedat4", "no file 'no.aedat4'"),
    "shape of a camera": ("eyes", "shape", "[4, 4, 4]", "shape [4, 4, 4]: expected [2, height, width]"),
    "weight of stdp": ("noise_exc", "weight", "2000.0", "weight = 2000: expected 0 to 1000"),
    "delay off the grid": ("noise_exc", "delay", "1.03", "delay = 1.03 ms"),
    "rule constant": ("noise_exc", "lambda", "fast", "stdp.lambda = 'fast'"),
    "trace constant": ("noise_exc", "tau_plus", "0.0", "stdp.tau_plus = 0"),
    "onto a generator": ("drive_inh", "to", "noise", "its target 'noise' is a poisson_generator"),
    "no rule": ("drive_inh", "rule", "all2all", "unknown rule 'all2all'"),
    "distance without model": ("exc_exc", "p", "{gauss: {std: 1.0}}", "unknown profile 'gauss'"),
    "autapses": ("exc_exc", "autapses", "never", "distance_dependent.autapses = 'never'"),
    "weight of a word": ("exc_exc", "weight", "strong", "weight = 'strong'"),
    "unit of a weight": ("exc_exc", "weight", "20 mV", "weight = 20 mV: expected a current"),
    "delay below a step": ("exc_exc", "delay", "0.04", "delay = 0.04 ms"),
    "distribution": ("exc_inh", "std", "-1.0", "normal.std = -1"),
    "delay of learning": ("exc_inh", "delay", "1 pA", "delay = 1 pA: expected a time"),
    "no signal": ("exc_inh", "signal", "rewrd", "unknown signal 'rewrd'"),
    "tau_c": ("exc_inh", "tau_c", "-1.0", "stdp_dopa.tau_c = -1"),
    "view too long": ("inh_out", "from", '{inh: "0:9:x"}', "inh: found '0:9:x'"),
    "view beyond": ("inh_out", "from", '{inh: "0:9"}', "inh[0:9]: found 9: expected -8 to 8"),
    "multapses": ("inh_out", "multapses", "1", "fixed_indegree.multapses = 1"),
    "n": ("inh_out", "n", "-3", "fixed_indegree.n = -3"),
    "unknown in a formula": ("inh_out", "weight", "$(-h * 5)", "unknown parameter 'h'"),
    "delay of inh_out": ("inh_out", "delay", "late", "delay = 'late'"),
    "pair beyond": ("inh_own", "pre", "[0, 8]", "pairs.pre[1] = 8"),
    "weights": ("inh_own", "weight", "[1.0, x]", "weight[1] = 'x'"),
    "delay of inh_own": ("inh_own", "delay", "2.02", "delay = 2.02 ms"),
    "no population to choose in": ("choice", "of", "uot", "unknown population 'uot'"),
    "first": ("choice", "first_to_fire", "yes", "winner_take_all.first_to_fire = 'yes'"),
    "signal to nobody": ("reward", "to", "ihn", "unknown population 'ihn'"),
    "no state": ("v", "record", "[V_m, I_sin_ex]", "has no state 'I_sin_ex'"),
    "every off the grid": ("v", "every", "1.02", "every = 1.02 ms"),
    "probe of nobody": ("u", "of", "ini", "unknown population 'ini'"),
    "probe beyond": ("u", "of", "{inh: 9}", "inh[9]: found 9"),
    "no such record": ("u", "record", "rte", "has no state 'rte'"),
    "every of a rate": ("u", "every", "-1.0", "every = -1"),
    "no state of a synapse": ("weights", "record", "wieght", "have no state 'wieght'"),
    "no such synapse": ("weights", "synapses", "[0, 160]", "synapses: found 160"),
    "every of weights": ("weights", "every", "1 mV", "every = 1 mV: expected a time"),
    "pre beyond": ("some", "pre", "{inh: 9}", "inh[9]: found 9"),
    "pre of another": ("some", "pre", '{exc: "1, 3"}', "expected neurons of 'inh'"),
    "no state of static synapses": ("some", "record", "K_plus", "have no state 'K_plus'"),
    "every of some off the grid": ("some", "every", "1.05", "every = 1.05 ms"),
    "no state of dopamine": ("traces", "record", "[weight, nn]", "have no state 'nn'"),
    "every of traces off the grid": ("traces", "every", "1.05", "every = 1.05 ms"),
}
IN_TRIALS: Planted = {
    "input size": ("input", "shape", "[2, 6, x]", "shape[2] = 'x'"),
    "no input": ("trials", "input: input", "inptu: input", "unknown parameter of trials 'inptu'"),
    "unknown group": ("decide", "winner_take_all:", "winner_takes_all:", "unknown group 'winner_takes_all'"),
    "a model of s1": ("s1", "iaf_psc_delta:", "iaf_delta:", "unknown model 'iaf_delta'"),
    "no rule": ("input_s1", "grid:", "gird:", "unknown rule 'gird'"),
    "a target": ("s1_s2", "to", "s3", "unknown population 's3'"),
    "V_th": ("s1", "V_th", "high", "iaf_psc_delta.V_th = 'high'"),
    "t_ref": ("s1", "t_ref", "2.5", "iaf_psc_delta.t_ref = 2.5 ms"),
    "model of s2": ("s2", "model", "iaf_delta", "unknown model 'iaf_delta'"),
    "kernel": ("input_s1", "kernel", "[0, 3]", "grid.kernel[0] = 0"),
    "stride": ("input_s1", "stride", "0", "grid.stride = 0"),
    "low": ("input_s1", "weight", "{uniform: {low: 2.0, high: 0.9}}", "uniform"),
    "delay of a grid": ("input_s1", "delay", "1.5", "delay = 1.5 ms"),
    "weight of r_stdp": ("s1_s2", "weight", "5.0", "weight = 5: expected 0 to 1"),
    "delay": ("s1_s2", "delay", "0.5", "delay = 0.5 ms"),
    "rate of learning": ("s1_s2", "Ar_plus", "much", "r_stdp.Ar_plus = 'much'"),
    "duration": ("trials", "duration", "20.5", "duration = 20.5 ms"),
    "stop": ("trials", "stop", "late", "trials.stop = 'late'"),
    "labels": ("trials", "maps_per_label", "0", "labels.maps_per_label = 0"),
    "silence": ("trials", "silent", "1.0", "reward.silent = 1"),
    "correct": ("trials", "correct", "good", "reward.correct = 'good'"),
    "reset": ("trials", "reset", "[V]", "reset: 's2' has no state 'V'"),
    "probe": ("v", "record", "V", "has no state 'V'"),
}
DECIDES = {
    "size of noise": ["no such synapse"],
    "no model of inh": ["no parameter", "no such record"],
    "own model": ["own parameter"],
    "no synapse": ["tau_c", "no signal", "no state of dopamine"],
    "no signal": ["no state of dopamine"],
    "no recording": ["shape of a camera"],
    "unknown target": ["unit of a weight"],
    "probe of nobody": ["no such record"],
    "unknown group": ["reset"],
    "unknown source": ["pair beyond"],
    "unknown word": ["every of a rate"],
    "a model of s1": ["V_th", "t_ref", "probe"],
    "no rule": ["kernel", "stride"],
    "a target": ["weight of r_stdp"],
}
"""What cannot be judged beside a mistake: how many there are, of which class, of what."""


def planted(text: str, part: str, word: str, instead: str) -> tuple[str, int]:
    """The text with one line changed, and that line's number."""
    lines = text.splitlines()
    begin = next(k for k, line in enumerate(lines) if re.match(rf" *{re.escape(part)}(:|$)", line) or line == part)
    at = begin
    if word:
        at = next(k for k in range(begin + 1, len(lines)) if re.match(rf" *{re.escape(word)}(:|$)", lines[k]))
    before = lines[at]
    if ":" in word or instead.endswith(":"):
        lines[at] = before.replace(word or f"{part}:", instead)
    else:
        lines[at] = re.sub(r": .*", lambda _: f": {instead}", before)
    assert lines[at] != before
    return "\n".join(lines) + "\n", at + 1


def told(text: str) -> list[str]:
    Path("net.yaml").write_text(text)
    return [str(error) for error in mistakes("net.yaml", None, 0).mistakes]


def alone(text: str, entry: tuple[str, str, str, str]) -> str:
    """What is told of one mistake, which says what it should and stands in its line or at its part."""
    part, word, instead, message = entry
    changed, line = planted(text, part, word, instead)
    found = told(changed)
    assert len(found) == 1, found
    assert message in found[0], found
    place = re.match(r"net\.yaml:(\d+):(\d+): ", found[0])
    assert place, found
    at = changed.splitlines()[int(place[1]) - 1]
    assert int(place[1]) == line or at.strip().startswith(f"{part}:"), found
    assert int(place[2]) >= len(at) - len(at.lstrip()) + 1
    return found[0]


@pytest.fixture(scope="module")
def singles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("singles"))
        assert told(PAIRS) == told(TRIALS) == []
        return {name: alone(PAIRS, entry) for name, entry in IN_PAIRS.items()} | {
            f"trials: {name}": alone(TRIALS, entry) for name, entry in IN_TRIALS.items()
        }


def together(text: str, catalogue: Planted, names: set[str]) -> list[str]:
    for name in names:
        part, word, instead, _ = catalogue[name]
        text, _ = planted(text, part, word, instead)
    return told(text)


ANY = settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def independent(catalogue: Planted) -> st.SearchStrategy[set[str]]:
    """Names of mistakes, at most one a line, none of which keeps another from being judged."""
    some = st.lists(st.sampled_from(sorted(catalogue)), min_size=2, max_size=12)
    return some.map(lambda names: chosen(catalogue, names))


def chosen(catalogue: Planted, names: list[str]) -> set[str]:
    lines = {(catalogue[name][0], catalogue[name][1].partition(":")[0]): name for name in names}
    kept = set(lines.values())
    hidden = {other for name in kept for other in DECIDES.get(name, [])}
    hidden |= {name for name in kept if "resolution" in kept and ("off the grid" in name or "below a step" in name)}
    hidden |= {name for name in kept if "resolution" in kept and name == "delay of inh_own"}
    return kept - hidden


@given(names=independent(IN_PAIRS))
@ANY
def test_all_of_a_network_with_stdp(folder, singles, names):
    assert sorted(together(PAIRS, IN_PAIRS, names)) == sorted(singles[name] for name in names)


@given(names=independent(IN_TRIALS))
@ANY
def test_all_of_a_network_with_trials(folder, singles, names):
    assert sorted(together(TRIALS, IN_TRIALS, names)) == sorted(singles[f"trials: {name}"] for name in names)


@pytest.mark.parametrize(("text", "catalogue"), [(PAIRS, IN_PAIRS), (TRIALS, IN_TRIALS)])
@given(data=st.data())
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_program_reads_the_messages(folder, data, text, catalogue):
    for name in data.draw(independent(catalogue)):
        part, word, instead, _ = catalogue[name]
        text, _ = planted(text, part, word, instead)
    same_if_reworded(text)
