"""Mistakes in the text and in the sections of a description."""

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


CASES = [
    (
        "",
        "net.yaml:1:1: the file is empty: expected a network\n  hint: begin: neuro: 1",
    ),
    (
        "# nothing\n",
        "net.yaml:1:1: the file is empty: expected a network\n  hint: begin: neuro: 1",
    ),
    (
        "- a\n- b\n",
        "net.yaml:1:1: found [a, b]: expected the words of a network: neuro, name, include, resolution, parameters, models, populations, projections, signals, groups, trials, probes",
    ),
    (
        "hello\n",
        "net.yaml:1:1: found 'hello': expected the words of a network: neuro, name, include, resolution, parameters, models, populations, projections, signals, groups, trials, probes",
    ),
    (
        "~\n",
        "net.yaml:1:1: found nothing: expected the words of a network: neuro, name, include, resolution, parameters, models, populations, projections, signals, groups, trials, probes",
    ),
    (
        "neuro: 2\npopulations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: [2, 2]}\n",
        "net.yaml:1:8: neuro = 2: expected 1, the version of the language",
    ),
    (
        "neuro: '1'\npopulations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: [2, 2]}\n",
        "net.yaml:1:8: neuro = '1': expected 1, the version of the language",
    ),
    (
        "neuro: 1\npopullations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: [2, 2]}\n",
        "net.yaml:2:1: unknown word of a network 'popullations'\n  hint: did you mean 'populations'?",
    ),
    (
        "neuro: 1\nneurons: {}\n",
        "net.yaml:2:1: unknown word of a network 'neurons'\n  hint: did you mean 'populations'?",
    ),
    (
        "neuro: 1\ndt: 0.1\n",
        "net.yaml:2:1: unknown word of a network 'dt'\n  hint: did you mean 'resolution'?",
    ),
    (
        "neuro: 1\npopulations:\n",
        "net.yaml:2:1: populations has no value\n  hint: write it after the ':'",
    ),
    (
        "neuro: 1\npopulations:\n  - a\n",
        "net.yaml:3:3: populations: found [a]: expected a mapping from names to parts\n"
        "  hint: write 'name: {...}' for each, without '-'",
    ),
    (
        "neuro: 1\npopulations: 3\n",
        "net.yaml:2:14: populations: found 3: expected a mapping from names to parts",
    ),
    (
        "neuro: 1\nname: my net\n",
        "net.yaml:2:7: network name 'my net': expected letters, digits, '_', '-' or '.'",
    ),
    (
        "neuro: 1\nname: 3\n",
        "net.yaml:2:7: network name 3: expected letters, digits, '_', '-' or '.'",
    ),
    (
        "neuro: 1\nresolution: 0\n",
        "net.yaml:2:13: resolution = 0: expected a number > 0 ms",
    ),
    (
        "neuro: 1\nresolution: 0.1 mV\n",
        "net.yaml:2:13: resolution = 0.1 mV: expected a time in ms",
    ),
    (
        "neuro: 1\nresolution: 100 uS\n",
        "net.yaml:2:13: resolution = 100 uS: expected a time in ms",
    ),
    (
        "neuro: 1\npopulations:\n\ta: 1\n",
        "net.yaml:3:1: found a tab: expected spaces\n  hint: YAML is indented by spaces only",
    ),
    (
        "neuro: 1\npopulations\n  a: {model: x, shape: 1}\n",
        "net.yaml:3:4: expected ':' after the word on the line above",
    ),
    (
        "neuro: 1\npopulations:\n  a:\n    model iaf_psc_exp\n    shape: 1\n",
        "net.yaml:5:10: found ':' where no word can stand before it\n"
        "  hint: is a ':' missing on the line above, or the indentation different?",
    ),
    (
        "neuro: 1\nname\n",
        "net.yaml:3:1: expected ':' after the word on the line above",
    ),
    (
        "neuro: 1\npopulations:\n  a: {model:iaf_psc_exp, shape: 1}\n",
        "net.yaml:3:7: population 'a': unknown word of a population 'model:iaf_psc_exp'\n"
        "  hint: write 'model: iaf_psc_exp', with a space after ':'",
    ),
    (
        "neuro: 1\npopulations: {a: {model: b, shape: 1}\n",
        "net.yaml:3:1: expected ',' or '}' in what begins at net.yaml:2:14",
    ),
    (
        "neuro: 1\npopulations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: [2, 2}\n",
        "net.yaml:4:39: expected ',' or ']' in what begins at net.yaml:4:34",
    ),
    (
        "neuro: 1\npopulations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: [2, 2]}}\n",
        "net.yaml:4:41: found '}' where a word or the end of the part should be\n"
        "  hint: do the words of a part begin in the same column, and do brackets match?",
    ),
    (
        "neuro: 1\npopulations:\n  a:\n    model: parrot_neuron\n   shape: 1\n",
        "net.yaml:5:4: found 'shape' where a word or the end of the part should be\n"
        "  hint: do the words of a part begin in the same column, and do brackets match?",
    ),
    (
        "neuro: 1\nname: 'x\n",
        "net.yaml:2:7: found the end of the file inside quotes",
    ),
    (
        "neuro: 1\nname: @x\n",
        "net.yaml:2:7: found '@': expected a value\n  hint: text with it needs quotes",
    ),
    (
        TWO + "---\nneuro: 1\n",
        "net.yaml:5:1: found a second document: expected one",
    ),
    (
        model("parrot_neuron, shape: 1"),
        "net.yaml:3:41: 'shape' is said twice\n  hint: first at net.yaml:3:31",
    ),
    (
        TWO + "  a: {model: parrot_neuron, shape: 1}\n",
        "net.yaml:5:3: 'a' is said twice\n  hint: first at net.yaml:3:3",
    ),
    (
        "neuro: 1\npopulations:\n  a: {<<: {shape: 1}}\n",
        "net.yaml:3:7: '<<' merges mappings, which the language has not: write the words out",
    ),
    (
        "neuro: 1\nname: &x y\n",
        "net.yaml:2:7: found the anchor '&x': expected a value\n  hint: use parameters and $names",
    ),
    (
        "neuro: 1\nname: *x\n",
        "net.yaml:2:7: found the alias '*x': expected a value\n  hint: use parameters and $names",
    ),
    (
        "neuro: 1\nname: !!python/object/apply:os.system [ls]\n",
        "net.yaml:2:7: found the tag '!!python/object/apply:os.system': expected a value without one",
    ),
    (
        "neuro: 1\nresolution: !!float 1\n",
        "net.yaml:2:13: found the tag '!!float': expected a value without one",
    ),
    (
        "neuro: 1\n? [a, b]\n: 1\n",
        "net.yaml:2:3: expected a word before ':'",
    ),
    (
        "neuro: 1\n'': 1\n",
        "net.yaml:2:1: expected a word before ':'",
    ),
    (
        "neuro: 1\nname: [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]\n",
        "net.yaml:2:39: found more than 32 levels: expected fewer",
    ),
    (
        model("{iaf_psc_exp: {tau_m: 1e400}}"),
        "net.yaml:3:38: found 1e400: expected a number below 1.8e308\n  hint: infinity is .inf",
    ),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_message(message, text, expected):
    assert message(text) == expected
