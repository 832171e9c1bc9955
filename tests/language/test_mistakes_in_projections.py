"""Mistakes in projections, their rules, weights, delays and synapses."""

# ruff: noqa: E501
import pytest

TWO = """\
neuro: 1
populations:
  a: {model: poisson_generator, shape: 3}
  b: {model: iaf_psc_exp, shape: [2, 2]}
"""


def projection(text: str) -> str:
    return rule(f"all_to_all, {text}")


def rule(text: str) -> str:
    return f"{TWO}projections:\n  a_b: {{from: a, to: b, rule: {text}}}\n"


CASES = [
    (
        TWO + "projections:\n  a_b: {source: a, target: b, rule: all_to_all}\n",
        "net.yaml:6:9: projection 'a_b': unknown word of a projection 'source'\n  hint: did you mean 'from'?",
    ),
    (
        TWO + "projections:\n  a_b: {from: aa, to: b, rule: all_to_all}\n",
        "net.yaml:6:15: projection 'a_b': unknown population 'aa'\n  hint: did you mean 'a'?",
    ),
    (
        TWO + "projections:\n  a_b: {from: a, to: motors, rule: all_to_all}\n",
        "net.yaml:6:22: projection 'a_b': unknown population 'motors'\n  hint: known: a, b",
    ),
    (
        TWO + "projections:\n  a_b: {from: a, to: b}\n",
        "net.yaml:6:3: projection 'a_b': a projection needs 'rule'",
    ),
    (
        TWO + "projections:\n  a_b: {to: b, rule: all_to_all}\n",
        "net.yaml:6:3: projection 'a_b': a projection needs 'from'",
    ),
    (
        TWO + "projections:\n  - {from: a, to: b, rule: all_to_all}\n",
        "net.yaml:6:3: projections: found [{from: a, to: b, rule: all_to_all}]: expected a mapping from names to parts\n"
        "  hint: write 'name: {...}' for each, without '-'",
    ),
    (
        TWO + "projections:\n  a_b: {from: 1, to: b, rule: all_to_all}\n",
        "net.yaml:6:15: projection 'a_b': from = 1: expected a name",
    ),
    (
        rule("all_to_al"),
        "net.yaml:6:31: projection 'a_b': unknown rule 'all_to_al'\n  hint: did you mean 'all_to_all'?",
    ),
    (
        rule("fully_connected"),
        "net.yaml:6:31: projection 'a_b': unknown rule 'fully_connected'\n  hint: did you mean 'all_to_all'?",
    ),
    (
        rule("fixed_indegree"),
        "net.yaml:6:31: projection 'a_b': fixed_indegree needs 'n': expected a whole number >= 1",
    ),
    (
        rule("{fixed_indegree: 10}"),
        "net.yaml:6:48: projection 'a_b': fixed_indegree: found 10: expected its parameters, {word: value}\n"
        "  hint: write {fixed_indegree: {n: 10}}",
    ),
    (
        rule("{fixed_indegree: {n: 1.5}}"),
        "net.yaml:6:52: projection 'a_b': fixed_indegree.n = 1.5: expected a whole number >= 1",
    ),
    (
        rule("{pairwise_bernoulli: {p: 1.5}}"),
        "net.yaml:6:56: projection 'a_b': pairwise_bernoulli.p = 1.5: expected a number >= 0 and <= 1",
    ),
    (
        rule("{pairwise_bernoulli: {p: 10%}}"),
        "net.yaml:6:56: projection 'a_b': pairwise_bernoulli.p = '10%': expected a number >= 0 and <= 1\n"
        "  hint: write 0.1",
    ),
    (
        rule("{pairs: {pre: [0, 1], post: [0]}}"),
        "net.yaml:6:59: projection 'a_b': pairs: 2 sources and 1 targets: expected as many of each",
    ),
    (
        rule("{pairs: {pre: [0, -1], post: [0, 1]}}"),
        "net.yaml:6:49: projection 'a_b': pairs.pre[1] = -1: expected whole numbers >= 0",
    ),
    (
        rule("{grid: {kernel: [3, 3, 3]}}"),
        "net.yaml:6:47: projection 'a_b': grid.kernel = [3, 3, 3]: expected two numbers, height and width",
    ),
    (
        rule("{grid: {kernel: 3}}"),
        "net.yaml:6:47: projection 'a_b': grid.kernel = [3]: expected two numbers, height and width",
    ),
    (
        rule("{grid: {kernel: [3, 3], stride: 0}}"),
        "net.yaml:6:63: projection 'a_b': grid.stride = 0: expected a whole number >= 1",
    ),
    (
        rule("{one_to_one: {n: 1}}"),
        "net.yaml:6:44: projection 'a_b': one_to_one has no parameters\n  hint: write 'one_to_one' alone",
    ),
    (
        rule("{fixed_indegree: {indegree: 3}}"),
        "net.yaml:6:49: projection 'a_b': unknown parameter of fixed_indegree 'indegree'\n  hint: did you mean 'n'?",
    ),
    (
        projection("weight: strong"),
        "net.yaml:6:51: projection 'a_b': weight = 'strong': expected a number",
    ),
    (
        projection("weight: 1.5 mV"),
        "net.yaml:6:51: projection 'a_b': weight = 1.5 mV: expected a current in pA",
    ),
    (
        projection("weight: .nan"),
        "net.yaml:6:51: projection 'a_b': weight = .nan: expected a finite number",
    ),
    (
        projection("weight: .inf"),
        "net.yaml:6:51: projection 'a_b': weight = .inf: expected a finite number",
    ),
    (
        projection("weight: [1.0, [2.0, x]]"),
        "net.yaml:6:63: projection 'a_b': weight[1, 1] = 'x': expected a number",
    ),
    (
        projection("weights: 2.0"),
        "net.yaml:6:43: projection 'a_b': unknown word of a projection 'weights'\n  hint: did you mean 'weight'?",
    ),
    (
        projection("delay: 0"),
        "net.yaml:6:50: projection 'a_b': delay = 0: expected a number > 0 ms",
    ),
    (
        projection("delay: [1.0, -1.0]"),
        "net.yaml:6:56: projection 'a_b': delay[1] = -1: expected a number > 0 ms",
    ),
    (
        projection("delay: 1.5mV"),
        "net.yaml:6:50: projection 'a_b': delay = 1.5mV: expected a time in ms",
    ),
    (
        projection("synapse: sdtp"),
        "net.yaml:6:52: projection 'a_b': unknown synapse 'sdtp'\n  hint: did you mean 'stdp'?",
    ),
    (
        projection("synapse: stdp_dopamine_synapse"),
        "net.yaml:6:52: projection 'a_b': unknown synapse 'stdp_dopamine_synapse'\n  hint: did you mean 'stdp_dopa'?",
    ),
    (
        projection("synapse: {stdp_dopa: {Wmin: 5.0, Wmax: 1.0}}"),
        "net.yaml:6:71: projection 'a_b': stdp_dopa.Wmin = 5: expected at most Wmax = 1",
    ),
    (
        projection("synapse: {stdp: {lambda_: 0.1}}"),
        "net.yaml:6:60: projection 'a_b': unknown parameter of stdp 'lambda_'\n  hint: did you mean 'lambda'?",
    ),
    (
        projection("synapse: {stdp: {w_max: 0.1}}"),
        "net.yaml:6:60: projection 'a_b': unknown parameter of stdp 'w_max'\n  hint: did you mean 'Wmax'?",
    ),
    (
        projection("synapse: {stdp_dopa: {signal: reward}}"),
        "net.yaml:6:73: projection 'a_b': unknown signal 'reward'\n  hint: add it to the section 'signals'",
    ),
    (
        projection("synapse: {stdp_dopa: {signal: x, dopamine: a}}"),
        "net.yaml:6:86: projection 'a_b': stdp_dopa has both 'signal' and 'dopamine': expected one source of dopamine",
    ),
    (
        projection("synapse: {stdp_dopa: {dopamine: aa}}"),
        "net.yaml:6:75: projection 'a_b': unknown population 'aa'\n  hint: did you mean 'a'?",
    ),
    (
        projection("synapse: {stdp_dopa: {dopamine: a, dopamine_rule: one_to_many}}"),
        "net.yaml:6:93: projection 'a_b': stdp_dopa.dopamine_rule = 'one_to_many': expected one of all_to_all, one_to_one\n"
        "  hint: did you mean 'one_to_one'?",
    ),
    (
        projection("synapse: {stdp_dopa: {dopamine: a, dopamine_delay: 0}}"),
        "net.yaml:6:94: projection 'a_b': stdp_dopa.dopamine_delay = 0: expected a time > 0 ms",
    ),
    (
        projection("synapse: {static: {w: 1}}"),
        "net.yaml:6:62: projection 'a_b': unknown parameter of static 'w'\n  hint: known: receptor",
    ),
    (
        projection("weight: 'uniform(low=0.0, high=2.0)'"),
        "net.yaml:6:51: projection 'a_b': unknown distribution 'uniform(low=0.0, high=2.0)'\n"
        "  hint: write {uniform: {low: 0.0, high: 2.0}}",
    ),
    (
        rule("{grid: {kernel: 3x3}}"),
        "net.yaml:6:47: projection 'a_b': grid.kernel = '3x3': expected whole numbers >= 1\n  hint: write [3, 3]",
    ),
    (
        projection("weight: {file: w.npy, key: w}"),
        "net.yaml:6:70: projection 'a_b': a key for 'w.npy': expected none, an NPY file holds one array",
    ),
    (
        projection("synapse: stdp, Wmax: 3.0"),
        "net.yaml:6:58: projection 'a_b': unknown word of a projection 'Wmax'\n"
        "  hint: write synapse: {stdp: {Wmax: 3}}",
    ),
    (
        rule("fixed_indegree, n: 10"),
        "net.yaml:6:47: projection 'a_b': unknown word of a projection 'n'\n"
        "  hint: write rule: {fixed_indegree: {n: 10}}",
    ),
    (
        projection("weight: [1.0, ~]"),
        "net.yaml:6:57: projection 'a_b': weight[1] has no value: expected a number",
    ),
    (
        projection("weight: {low: 0.0, high: 1.0}"),
        "net.yaml:6:51: projection 'a_b': weight = {low: 0, high: 1}: expected the name of a distribution\n"
        "  hint: write {uniform: {low: 0, high: 1}}",
    ),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_message(message, text, expected):
    assert message(text) == expected
