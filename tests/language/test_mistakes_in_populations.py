"""Mistakes in populations, their models and their values."""

# ruff: noqa: E501
import pytest


def model(text: str) -> str:
    return population(f"{{model: {text}, shape: 2}}")


def population(text: str) -> str:
    return f"neuro: 1\npopulations:\n  exc: {text}\n"


CASES = [
    (
        population(""),
        "net.yaml:3:3: population 'exc': found nothing: expected the words of a population: model, shape, initial, "
        "positions, extent, periodic",
    ),
    (
        population("iaf_psc_exp"),
        "net.yaml:3:8: population 'exc': found 'iaf_psc_exp': expected the words of a population: model, shape, initial, "
        "positions, extent, periodic",
    ),
    (
        population("{shape: 2}"),
        "net.yaml:3:3: population 'exc': a population needs 'model'",
    ),
    (
        population("{model: iaf_psc_exp}"),
        "net.yaml:3:3: population 'exc': a population needs 'shape'",
    ),
    (
        population("{model: iaf_psc_exp, size: 2}"),
        "net.yaml:3:29: population 'exc': unknown word of a population 'size'\n  hint: did you mean 'shape'?",
    ),
    (
        population("{model: iaf_psc_exp, shpe: 2}"),
        "net.yaml:3:29: population 'exc': unknown word of a population 'shpe'\n  hint: did you mean 'shape'?",
    ),
    (
        "neuro: 1\npopulations:\n  my pop: {model: iaf_psc_exp, shape: 2}\n",
        "net.yaml:3:3: population name 'my pop': expected letters, digits, '_', '-' or '.'",
    ),
    (
        population("{neuron: iaf_psc_exp, shape: 2}"),
        "net.yaml:3:9: population 'exc': unknown word of a population 'neuron'\n  hint: did you mean 'model'?",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2, tau_m: 10.0}"),
        "net.yaml:3:39: population 'exc': unknown word of a population 'tau_m'\n"
        "  hint: write model: {iaf_psc_exp: {tau_m: 10}}",
    ),
    (
        population("{model: iaf_psc_exp, shape: [2, 0]}"),
        "net.yaml:3:40: population 'exc': shape[1] = 0: expected whole numbers >= 1 or auto",
    ),
    (
        population("{model: iaf_psc_exp, shape: -1}"),
        "net.yaml:3:36: population 'exc': shape = -1: expected whole numbers >= 1 or auto",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2.5}"),
        "net.yaml:3:36: population 'exc': shape = 2.5: expected whole numbers >= 1 or auto",
    ),
    (
        population("{model: iaf_psc_exp, shape: [2, atuo]}"),
        "net.yaml:3:40: population 'exc': shape[1] = 'atuo': expected whole numbers >= 1 or auto\n"
        "  hint: did you mean 'auto'?",
    ),
    (
        population("{model: iaf_psc_exp, shape: []}"),
        "net.yaml:3:36: population 'exc': shape = []: expected whole numbers >= 1 or auto",
    ),
    (
        population("{model: iaf_psc_exp, shape: 8x8}"),
        "net.yaml:3:36: population 'exc': shape = '8x8': expected whole numbers >= 1 or auto\n  hint: write [8, 8]",
    ),
    (
        population("{model: iaf_psc_exp, shape: [100000, 100000]}"),
        "net.yaml:3:36: population 'exc': shape = [100000, 100000]: expected at most 2147483647 elements",
    ),
    (
        population("{model: iaf_psc_exp, shape: {x: 2}}"),
        "net.yaml:3:36: population 'exc': shape = {x: 2}: expected whole numbers >= 1 or auto",
    ),
    (
        population("{model: iaf_psc_exp, shape: true}"),
        "net.yaml:3:36: population 'exc': shape = true: expected whole numbers >= 1 or auto",
    ),
    (
        model("iaf_psc_ex"),
        "net.yaml:3:16: population 'exc': unknown model 'iaf_psc_ex'\n  hint: did you mean 'iaf_psc_exp'?",
    ),
    (
        model("LIF"),
        "net.yaml:3:16: population 'exc': unknown model 'LIF'\n"
        "  hint: did you mean 'iaf_psc_delta' or 'iaf_psc_exp' or 'iaf_psc_alpha'?",
    ),
    (
        model("IAF_PSC_EXP"),
        "net.yaml:3:16: population 'exc': unknown model 'IAF_PSC_EXP'\n  hint: did you mean 'iaf_psc_exp'?",
    ),
    (
        model("iaf_psc_exp(tau_m=10)"),
        "net.yaml:3:16: population 'exc': unknown model 'iaf_psc_exp(tau_m=10)'\n"
        "  hint: write {iaf_psc_exp: {tau_m: 10}}",
    ),
    (
        model("izhikevich()"),
        "net.yaml:3:16: population 'exc': unknown model 'izhikevich()'\n  hint: write 'izhikevich' alone",
    ),
    (
        model("3"),
        "net.yaml:3:16: population 'exc': model: found 3: expected a name, or {name: {parameters}}",
    ),
    (
        model("[iaf_psc_exp, {tau_m: 10.0}]"),
        "net.yaml:3:16: population 'exc': model: found [iaf_psc_exp, {tau_m: 10}]: expected a name, or {name: {parameters}}",
    ),
    (
        model("{iaf_psc_exp: {}, tau_m: 10.0}"),
        "net.yaml:3:16: population 'exc': model: found {iaf_psc_exp: {}, tau_m: 10}: expected a name, or {name: {parameters}}\n"
        "  hint: write {iaf_psc_exp: {tau_m: 10}}",
    ),
    (
        model("{name: iaf_psc_exp, tau_m: 10.0}"),
        "net.yaml:3:16: population 'exc': model: found {name: iaf_psc_exp, tau_m: 10}: expected a name, or {name: {parameters}}\n"
        "  hint: write {iaf_psc_exp: {tau_m: 10}}",
    ),
    (
        model("{iaf_psc_exp: }"),
        "net.yaml:3:17: population 'exc': iaf_psc_exp has no parameters here\n  hint: write 'iaf_psc_exp' alone",
    ),
    (
        model("{iaf_psc_exp: 10.0}"),
        "net.yaml:3:30: population 'exc': iaf_psc_exp: found 10: expected its parameters, {word: value}",
    ),
    (
        "neuro: 1\npopulations:\n  exc:\n    model:\n    shape: 1\n",
        "net.yaml:4:5: population 'exc': model has no value\n  hint: write it after the ':'",
    ),
    (
        model("qwerty"),
        "net.yaml:3:16: population 'exc': unknown model 'qwerty'\n"
        "  hint: known: ac_generator, aeif_cond_exp, aeif_psc_exp, dc_generator, encode, event_camera, gamma_sup_generator, hh_psc_alpha, iaf_cond_alpha, iaf_cond_exp, iaf_linear_leak, iaf_psc_alpha, ...",
    ),
    (
        model("stdp"),
        "net.yaml:3:16: population 'exc': unknown model 'stdp'\n  hint: 'stdp' is a synapse, not a model",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 0}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = 0: expected a number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: -1}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = -1: expected a number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 10 Hz}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = 10 Hz: expected a time in ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 10 msec}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = 10 msec: unknown unit 'msec'\n  hint: did you mean 'mS' or 'ms'?",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 10 mV}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = 10 mV: expected a time in ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: '10'}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = '10': expected a number > 0 ms\n"
        "  hint: write 10 without quotes",
    ),
    (
        model("{iaf_psc_exp: {tau_syn_ex: .inf}}"),
        "net.yaml:3:43: population 'exc': iaf_psc_exp.tau_syn_ex = .inf: expected a finite number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: inf}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = 'inf': expected a number > 0 ms\n  hint: write .inf",
    ),
    (
        model("{iaf_psc_exp: {tau_m: .nan}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = .nan: expected a finite number > 0 ms",
    ),
    (
        "neuro: 1\npopulations:\n  exc:\n    model:\n      iaf_psc_exp:\n        tau_m: 10,5\n    shape: 1\n",
        "net.yaml:6:16: population 'exc': iaf_psc_exp.tau_m = '10,5': expected a number > 0 ms\n  hint: write 10.5",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 1_0}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = '1_0': expected a number > 0 ms\n  hint: write 10",
    ),
    (
        model("{iaf_psc_exp: {tau_m: true}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = true: expected a number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 2*5}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = '2*5': expected a number > 0 ms\n"
        "  hint: write $(2*5) in YAML, or the result",
    ),
    (
        model("{iaf_psc_exp: {tau_m: }}"),
        "net.yaml:3:31: population 'exc': tau_m has no value\n  hint: write it after the ':'",
    ),
    (
        model("{iaf_psc_exp: {tau_m: [1.0, -2.0]}}"),
        "net.yaml:3:44: population 'exc': iaf_psc_exp.tau_m[1] = -2: expected a number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: [1.0, x]}}"),
        "net.yaml:3:44: population 'exc': iaf_psc_exp.tau_m[1] = 'x': expected a number > 0 ms",
    ),
    (
        model("{iaf_psc_exp: {tau_m: [[1.0], [1.0, 2.0]]}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m has rows of different lengths: expected as many numbers in each",
    ),
    (
        model("{iaf_psc_exp: {tau_m: {mean: 3}}}"),
        "net.yaml:3:38: population 'exc': iaf_psc_exp.tau_m = {mean: 3}: expected the name of a distribution\n"
        "  hint: write {normal: {mean: 3}}",
    ),
    (
        model("{iaf_psc_exp: {tau_m: {nromal: {mean: 3}}}}"),
        "net.yaml:3:39: population 'exc': unknown distribution 'nromal'\n  hint: did you mean 'normal'?",
    ),
    (
        model("{iaf_psc_exp: {tau_m: {normal: {std: -1}}}}"),
        "net.yaml:3:53: population 'exc': normal.std = -1: expected a number >= 0",
    ),
    (
        model("{iaf_psc_exp: {tau_m: {normal: {sigma: 1}}}}"),
        "net.yaml:3:48: population 'exc': unknown parameter of normal 'sigma'\n  hint: did you mean 'std'?",
    ),
    (
        model("{iaf_psc_exp: {tau_m: {uniform: {low: 2, high: 1}}}}"),
        "net.yaml:3:54: population 'exc': uniform.low = 2: expected at most high = 1",
    ),
    (
        model("{iaf_psc_exp: {tau_syn: 2.0}}"),
        "net.yaml:3:31: population 'exc': unknown parameter of iaf_psc_exp 'tau_syn'\n"
        "  hint: did you mean 'tau_syn_ex' or 'tau_syn_in'?",
    ),
    (
        model("{iaf_psc_exp: {v_rest: -65.0}}"),
        "net.yaml:3:31: population 'exc': unknown parameter of iaf_psc_exp 'v_rest'\n  hint: did you mean 'E_L'?",
    ),
    (
        model("{iaf_psc_exp: {v_th: -50.0}}"),
        "net.yaml:3:31: population 'exc': unknown parameter of iaf_psc_exp 'v_th'\n  hint: did you mean 'V_th'?",
    ),
    (
        model("{iaf_psc_exp: {qwerty: 1.0}}"),
        "net.yaml:3:31: population 'exc': unknown parameter of iaf_psc_exp 'qwerty'\n"
        "  hint: known: C_m, E_L, I_e, V_reset, V_th, t_ref, tau_m, tau_minus, tau_syn_ex, tau_syn_in",
    ),
    (
        model("{iaf_psc_delta: {refractory_input: yes}}"),
        "net.yaml:3:51: population 'exc': iaf_psc_delta.refractory_input = 'yes': expected true or false\n"
        "  hint: write true",
    ),
    (
        model("{iaf_psc_delta: {refractory_input: 1}}"),
        "net.yaml:3:51: population 'exc': iaf_psc_delta.refractory_input = 1: expected true or false",
    ),
    (
        model("{poisson_generator: {rate: -5}}"),
        "net.yaml:3:43: population 'exc': poisson_generator.rate = -5: expected a number >= 0 Hz",
    ),
    (
        model("{poisson_generator: {rate: -1 kHz}}"),
        "net.yaml:3:43: population 'exc': poisson_generator.rate = -1000: expected a number >= 0 Hz",
    ),
    (
        model("{poisson_generator: {start: [1.0, 2.0]}}"),
        "net.yaml:3:44: population 'exc': poisson_generator.start = [1, 2]: expected a number >= 0 ms",
    ),
    (
        model("{spike_generator: {spike_times: [[2.0, 1.0], []]}}"),
        "net.yaml:3:55: population 'exc': spike_generator.spike_times[0, 1] = 1: expected spike times > 0 ms in ascending order",
    ),
    (
        model("{spike_generator: {spike_times: [[0.0, 1.0], []]}}"),
        "net.yaml:3:50: population 'exc': spike_generator.spike_times[0, 0] = 0: expected spike times > 0 ms in ascending order",
    ),
    (
        model("{spike_generator: {spike_times: [1.0, [2.0]]}}"),
        "net.yaml:3:49: population 'exc': spike_generator.spike_times[0] = 1: expected a list of spike times in ms for each neuron",
    ),
    (
        model("{spike_generator: {spike_times: 5}}"),
        "net.yaml:3:48: population 'exc': spike_generator.spike_times = 5: expected a list of spike times in ms for each neuron",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2, initial: {Vm: -60.0}}"),
        "net.yaml:3:49: population 'exc': unknown state of iaf_psc_exp 'Vm'\n  hint: did you mean 'V_m'?",
    ),
    (
        population("{model: poisson_generator, shape: 2, initial: {V_m: -60.0}}"),
        "net.yaml:3:55: population 'exc': unknown state of poisson_generator 'V_m'\n  hint: none is defined",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2, initial: {V_m: low}}"),
        "net.yaml:3:54: population 'exc': initial.V_m = 'low': expected a number mV",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2, initial: [V_m]}"),
        "net.yaml:3:48: population 'exc': found [V_m]: expected the words of initial: V_m, I_syn_ex, I_syn_in",
    ),
    (
        population("{model: iaf_psc_exp, shape: 2, initial: {V_m: .nan}}"),
        "net.yaml:3:54: population 'exc': initial.V_m = .nan: expected a finite number mV",
    ),
    (
        model("izhikevich(0.02, 0.2)"),
        "net.yaml:3:33: population 'exc': unknown word of a population '0.2)'\n  hint: known: extent, initial, "
        "model, periodic, positions, shape",
    ),
    (
        model("{iaf_psc_delta: {refractory_input: True}}"),
        "net.yaml:3:51: population 'exc': iaf_psc_delta.refractory_input = 'True': expected true or false\n"
        "  hint: write true",
    ),
    (
        model("{iaf_psc_exp: {V_th: -.inf}}"),
        "net.yaml:3:37: population 'exc': iaf_psc_exp.V_th = -.inf: expected a finite number mV",
    ),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_message(message, text, expected):
    assert message(text) == expected
