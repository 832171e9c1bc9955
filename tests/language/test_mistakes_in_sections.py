"""Mistakes in signals, groups, trials, probes, parameters, includes and files."""

# ruff: noqa: E501
import pytest

TWO = """\
neuro: 1
populations:
  a: {model: poisson_generator, shape: 3}
  b: {model: iaf_psc_exp, shape: [2, 2]}
"""


def model(text: str) -> str:
    return population(f"{{model: {text}, shape: 2}}")


def population(text: str) -> str:
    return f"neuro: 1\npopulations:\n  exc: {text}\n"


def projection(text: str) -> str:
    return rule(f"all_to_all, {text}")


def rule(text: str) -> str:
    return f"{TWO}projections:\n  a_b: {{from: a, to: b, rule: {text}}}\n"


def parameters(text: str, weight: str) -> str:
    projections = f"projections:\n  a_b: {{from: a, to: b, rule: all_to_all, weight: {weight}}}\n"
    return TWO.replace("populations:", f"parameters: {text}\npopulations:") + projections


CASES = [
    (
        TWO + "signals:\n  reward: {to: c}\n",
        "net.yaml:6:16: signal 'reward': unknown population 'c'\n  hint: known: a, b",
    ),
    (
        TWO + "signals:\n  reward: b\n",
        "net.yaml:6:11: signal 'reward': found 'b': expected the words of a signal: to",
    ),
    (
        TWO + "signals:\n  reward: {target: b}\n",
        "net.yaml:6:12: signal 'reward': unknown word of a signal 'target'\n  hint: did you mean 'to'?",
    ),
    (
        TWO + "groups:\n  g: {wta: {of: b}}\n",
        "net.yaml:6:7: group 'g': unknown group 'wta'\n  hint: did you mean 'winner_take_all'?",
    ),
    (
        TWO + "groups:\n  g: {winner_take_all: {of: c}}\n",
        "net.yaml:6:29: group 'g': unknown population 'c'\n  hint: known: a, b",
    ),
    (
        TWO + "groups:\n  g: winner_take_all\n",
        "net.yaml:6:6: group 'g': winner_take_all needs 'of': expected a name",
    ),
    (
        TWO + "groups:\n  g: {winner_take_all: {of: b, first_to_fire: 'yes'}}\n",
        "net.yaml:6:47: group 'g': winner_take_all.first_to_fire = 'yes': expected true or false\n  hint: write true",
    ),
    (
        TWO + "groups:\n  g: {winner_take_all: b}\n",
        "net.yaml:6:24: group 'g': winner_take_all: found 'b': expected its parameters, {word: value}\n"
        "  hint: write {winner_take_all: {of: b}}",
    ),
    (
        TWO + "trials: {input: c, duration: 5.0}\n",
        "net.yaml:5:17: trials: unknown population 'c'\n  hint: known: a, b",
    ),
    (
        TWO + "trials: {input: a}\n",
        "net.yaml:5:9: trials needs 'duration': expected a number > 0 ms",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, stop: at_decison}\n",
        "net.yaml:5:41: trials.stop = 'at_decison': expected one of at_decision, full\n"
        "  hint: did you mean 'at_decision'?",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, labels: {of: c}}\n",
        "net.yaml:5:48: trials: labels: unknown population 'c'\n  hint: known: a, b",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, labels: b}\n",
        "net.yaml:5:43: trials: labels: found 'b': expected its parameters, {word: value}\n"
        "  hint: write {labels: {of: b}}",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, dropout: {of: b, p: 1.0}}\n",
        "net.yaml:5:55: trials: dropout.p = 1: expected a number >= 0 and < 1",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, lables: {of: b}}\n",
        "net.yaml:5:35: trials: unknown parameter of trials 'lables'\n  hint: did you mean 'labels'?",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, reset: [1]}\n",
        "net.yaml:5:43: trials.reset[0] = 1: expected names",
    ),
    (
        TWO + "trials: [a]\n",
        "net.yaml:5:9: trials: found [a]: expected its parameters, {word: value}",
    ),
    (
        TWO + "trials: {input: a, duration: 5.0, reward: 1.0}\n",
        "net.yaml:5:43: trials: reward: found 1: expected its parameters, {word: value}",
    ),
    (
        TWO + "probes:\n  v: {of: bb, record: V_m}\n",
        "net.yaml:6:11: probe 'v': unknown population 'bb'\n  hint: did you mean 'b'?",
    ),
    (
        TWO + "probes:\n  v: {of: b, variable: V_m}\n",
        "net.yaml:6:14: probe 'v': unknown word of a probe 'variable'\n  hint: did you mean 'record'?",
    ),
    (
        TWO + "probes:\n  v: {of: b, record: V_m, every: 0}\n",
        "net.yaml:6:34: probe 'v': every = 0: expected a number > 0 ms",
    ),
    (
        TWO + "probes:\n  v: {of: b, record: [V_m, 3]}\n",
        "net.yaml:6:28: probe 'v': record[1] = 3: expected names",
    ),
    (
        TWO + "probes:\n  v: {record: V_m}\n",
        "net.yaml:6:3: probe 'v': a probe needs 'of'",
    ),
    (
        parameters("{w_max: 1.0}", "$w_mx"),
        "net.yaml:7:51: unknown parameter '$w_mx'\n  hint: did you mean '$w_max'?",
    ),
    (
        projection("weight: $w"),
        "net.yaml:6:51: unknown parameter '$w'\n  hint: add parameters: {w: ...}",
    ),
    (
        parameters("{w: 1.0}", "-$w"),
        "net.yaml:7:51: found '-$w': expected a $name that stands alone, or $(...)\n  hint: write $(-w)",
    ),
    (
        parameters("{w: 1.0}", "2 * $w"),
        "net.yaml:7:51: found '2 * $w': expected a $name that stands alone, or $(...)\n  hint: write $(2 * w)",
    ),
    (
        parameters("{w: 1.0}", "$"),
        "net.yaml:7:51: found '$': expected a $name that stands alone, or $(...)",
    ),
    (
        parameters("{$w: 1.0}", "$w"),
        "net.yaml:2:14: parameter name '$w': expected letters, digits and '_', not a digit first\n"
        "  hint: write w; the $ stands where it is used",
    ),
    (
        parameters("{w: $v, v: 1.0}", "$w"),
        "net.yaml:2:17: $v is used before it is set\n  hint: set it above, see net.yaml:2:21",
    ),
    (
        parameters("{w: }", "$w"),
        "net.yaml:2:14: parameter 'w' has no value",
    ),
    (
        parameters("{w: high}", "$w"),
        "net.yaml:7:51: projection 'a_b': weight = 'high': expected a number\n  hint: $w is set at net.yaml:2:14",
    ),
    (
        parameters("[1.0]", "$w"),
        "net.yaml:2:13: parameters: found [1]: expected a mapping from names to parts\n"
        "  hint: write 'name: {...}' for each, without '-'",
    ),
    (
        parameters("{w-1: 1.0}", "$w"),
        "net.yaml:2:14: parameter name 'w-1': expected letters, digits and '_', not a digit first",
    ),
    (
        parameters("{w: x}", "[1.0, $w]"),
        "net.yaml:7:57: projection 'a_b': weight[1] = 'x': expected a number\n  hint: $w is set at net.yaml:2:14",
    ),
    (
        TWO + "include: other.yaml\n",
        "net.yaml:5:10: include = 'other.yaml': expected a list of files\n  hint: write [other.yaml]",
    ),
    (
        TWO + "include: [other.yaml]\n",
        "net.yaml:5:11: include: no file 'other.yaml' beside the description",
    ),
    (
        TWO + "include: [../other.yaml]\n",
        "net.yaml:5:11: include: file '../other.yaml': expected a path inside the folder of the description, without '..'",
    ),
    (
        TWO + "include: [/etc/passwd]\n",
        "net.yaml:5:11: include: file '/etc/passwd': expected a path inside the folder of the description, without '..'",
    ),
    (
        TWO + "include: [1]\n",
        "net.yaml:5:11: include: found 1: expected the name of a file",
    ),
    (
        projection("weight: {file: w.h5, key: w}"),
        "net.yaml:6:58: projection 'a_b': no file 'w.h5' beside the description",
    ),
    (
        projection("weight: {file: ../w.h5, key: w}"),
        "net.yaml:6:58: projection 'a_b': file '../w.h5': expected a path inside the folder of the description, without '..'",
    ),
    (
        projection("weight: {file: w.csv}"),
        "net.yaml:6:58: projection 'a_b': file 'w.csv': expected a name ending in .h5, .hdf5, .npy",
    ),
    (
        projection("weight: {file: w.h5}"),
        "net.yaml:6:51: projection 'a_b': file 'w.h5' needs 'key', the data set in it",
    ),
    (
        projection("weight: {file: w.h5, kye: w}"),
        "net.yaml:6:64: projection 'a_b': unknown word of a file 'kye'\n  hint: did you mean 'key'?",
    ),
    (
        projection("weight: {file: 3, key: w}"),
        "net.yaml:6:58: projection 'a_b': file = 3: expected a name",
    ),
    (
        model("{poisson_generator: {start: {file: w.h5, key: w}}}"),
        "net.yaml:3:44: population 'exc': poisson_generator.start = {file: w.h5, key: w}: expected a number >= 0 ms",
    ),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_message(message, text, expected):
    assert message(text) == expected
