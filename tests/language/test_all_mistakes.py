"""`neuro check` tells every mistake of a file, each in the words that it has alone, and nothing that only follows."""

import itertools
import re
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro.compiler.mistakes import mistakes

RIGHT = """\
neuro: 1
name: two
resolution: 0.1
parameters: {w: 300.0, rate: 100.0}
populations:
  noise: {model: {poisson_generator: {rate: $rate}}, shape: 20}
  exc:
    model:
      iaf_psc_exp:
        tau_m: 10.0
        C_m: 250.0
    shape: [2, 4]
  inh: {model: {iaf_psc_exp: {V_th: -50.0}}, shape: 8}
  out: {model: iaf_psc_delta, shape: 4}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0, synapse: {stdp: {Wmax: 1000.0}}}
  exc_inh: {from: exc, to: inh, rule: one_to_one, weight: {normal: {mean: 10.0, std: 1.0}}, delay: 1.5}
  inh_out: {from: inh, to: out, rule: {fixed_indegree: {n: 3}}, weight: -20.0, delay: 2.0}
groups:
  choice: {winner_take_all: {of: out}}
signals:
  reward: {to: exc}
probes:
  v: {of: exc, record: V_m, every: 1.0}
  u: {of: inh, record: V_m}
"""

PLANTED = {
    "resolved names": ("rate: $rate", "rate: $rte"),
    "a value within a block": ("tau_m: 10.0", "tau_m: -10.0"),
    "a word within a block": ("C_m: 250.0", "C_n: 250.0"),
    "compiled": ("V_th: -50.0", "V_th: -80.0"),
    "a name": ("iaf_psc_delta", "iaf_psc_dleta"),
    "a bound": ("Wmax: 1000.0", "Wmax: much"),
    "a distribution": ("std: 1.0", "std: -1.0"),
    "off the grid": ("delay: 2.0", "delay: 2.05"),
    "a rule": ("fixed_indegree", "fixed_indgree"),
    "a signal to nobody": ("reward: {to: exc}", "reward: {to: ecx}"),
    "an interval": ("every: 1.0", "every: soon"),
    "a word": ("u: {of: inh, record: V_m}", "u: {of: inh, recrod: V_m}"),
    "a missing word": ("choice: {winner_take_all: {of: out}}", "choice: {winner_take_all: {}}"),
    "an unknown section": ("signals:\n  reward", "sginals:\n  reward"),
    "a word that is no section": ("name: two", "colour: red"),
    "a formula": ("rate: 100.0", "rate: $(100.0 / (1 - 1))"),
}


def told(folder: Path, names: tuple[str, ...]) -> list[str]:
    text = RIGHT
    for name in names:
        before, after = PLANTED[name]
        assert text.count(before) == 1, name
        text = text.replace(before, after)
    (folder / "net.yaml").write_text(text)
    return [str(error) for error in mistakes("net.yaml", None, 0).mistakes]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        found = {name: told(folder, (name,)) for name in PLANTED}
    assert {name: len(texts) for name, texts in found.items()} == dict.fromkeys(PLANTED, 1)
    return {name: texts[0] for name, texts in found.items()}


def test_nothing_is_wrong_with_what_is_right(folder):
    assert told(folder, ()) == []


@given(st.sets(st.sampled_from(sorted(PLANTED)), min_size=2))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_all_that_are_planted_are_told_as_if_alone(folder, alone, names):
    assert sorted(told(folder, tuple(names))) == sorted(alone[name] for name in names)


def test_they_are_told_by_place(folder, alone):
    found = told(folder, ("an interval", "resolved names", "off the grid", "a bound"))
    assert found == [alone[name] for name in ("resolved names", "a bound", "off the grid", "an interval")]


@pytest.mark.parametrize("name", PLANTED)
def test_loading_and_compiling_raise_the_first(folder, alone, name):
    told(folder, (name,))
    with pytest.raises(neuro.ModelError) as caught:
        neuro.compile(neuro.load("net.yaml"), backend="reference")
    assert str(caught.value) == alone[name]


PIECES = re.findall(r"[\w.$]+|[^\w.$]", RIGHT)


INSTEAD = ("", "x", "-1", "exc", "auto", "{}", "[]")


def first(path: str) -> list[str]:
    """What loading and compiling raise."""
    try:
        neuro.compile(neuro.load(path), backend="reference")
    except neuro.ModelError as error:
        return [str(error)]
    return []


@given(st.lists(st.tuples(st.integers(0, len(PIECES) - 1), st.sampled_from(INSTEAD)), max_size=4))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_of_any_text_the_first_is_among_them(folder, changes):
    """Where loading and compiling succeed nothing is told; else what they raise is; each mistake once."""
    pieces = list(PIECES)
    for at, piece in changes:
        pieces[at] = piece
    (folder / "net.yaml").write_text("".join(pieces))
    found = [str(error) for error in mistakes("net.yaml", None, 0).mistakes]
    expected = first("net.yaml")
    assert set(expected) <= set(found)
    assert bool(expected) == bool(found)
    assert len(set(found)) == len(found)


TWO = "neuro: 1\npopulations:\n  a: {model: poisson_generator, shape: 3}\n  b: {model: iaf_psc_exp, shape: 2}\n"
FOLLOWING = {
    "a population that failed is not unknown": (
        "neuro: 1\npopulations: {a: {model: iaf, shape: 3}}\nprobes: {p: {of: a}}\n",
        ["net.yaml:2:26: population 'a': unknown model 'iaf'"],
    ),
    "nor has it the wrong size": (
        TWO.replace("shape: 3", "shape: -3") + "projections:\n  p: {from: a, to: b, rule: one_to_one, weight: x}\n",
        [
            "net.yaml:3:40: population 'a': shape = -3: expected",
            "net.yaml:6:49: projection 'p': weight = 'x': expected a number",
        ],
    ),
    "what 'auto' waits for": (
        "neuro: 1\npopulations:\n  a: {model: spike_generator, shape: [2, 5, 5]}\n"
        "  b: {model: iaf_psc_exp, shape: [2, auto, auto]}\n"
        "projections:\n  p: {from: a, to: b, rule: {grid: {kernel: [9, 9]}}}\n",
        ["net.yaml:6:3: projection 'p': grid.kernel = [9, 9]: expected at most [5, 5]"],
    ),
    "trials without their group": (
        TWO.replace("poisson", "spike") + "groups:\n  g: {winner_take_al: {of: b}}\n"
        "trials: {input: a, duration: 5.0, labels: {of: b, maps_per_label: 1}}\n",
        ["net.yaml:6:7: group 'g': unknown group 'winner_take_al'"],
    ),
    "who learns in trials that failed": (
        TWO.replace("poisson", "spike") + "projections:\n  p: {from: a, to: b, rule: all_to_all, synapse: r_stdp}\n"
        "trials: {input: a, duration: -5.0}\n",
        ["net.yaml:7:30: trials.duration = -5: expected a number > 0 ms"],
    ),
    "what a mistaken parameter leaves out": (
        TWO.replace("neuro: 1\n", "neuro: 1\nparameters: {n: }\n").replace("shape: 3", "shape: $n")
        + "projections:\n  p: {from: a, to: b, rule: one_to_one}\n",
        ["net.yaml:2:14: parameter 'n' has no value"],
    ),
    "but of two mistaken parameters both are": (
        TWO.replace("neuro: 1\n", "neuro: 1\nparameters: {n: , m: }\n"),
        ["net.yaml:2:14: parameter 'n' has no value", "net.yaml:2:19: parameter 'm' has no value"],
    ),
    "steps of a mistaken resolution": (
        "neuro: 1\nresolution: -1\npopulations:\n  a: {model: {iaf_psc_exp: {t_ref: 0.25}}, shape: 3}\n",
        ["net.yaml:2:13: resolution = -1: expected a number > 0 ms"],
    ),
    "all that a file would have included": (
        "neuro: 1\ninclude: [gone.yaml]\nprobes: {p: {of: a}}\n",
        ["net.yaml:2:11: include: no file 'gone.yaml' beside the description"],
    ),
    "a text that is no YAML": ("neuro: 1\npopulations: {a: [}\n", ["net.yaml:2:"]),
}


@pytest.mark.parametrize("name", FOLLOWING)
def test_what_only_follows_is_not_told(folder, name):
    text, expected = FOLLOWING[name]
    (folder / "net.yaml").write_text(text)
    found = [str(error) for error in mistakes("net.yaml", None, 0).mistakes]
    assert len(found) == len(expected), found
    for error, begin in itertools.zip_longest(found, expected):
        assert error.startswith(begin)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("populations: [1, 2]", "net.yaml:2:14: populations: found [1, 2]: expected a mapping from names to parts"),
        ("populations:", "net.yaml:2:1: populations has no value"),
        ("populations: auto", "net.yaml:2:14: populations: found 'auto': expected a mapping from names to parts"),
        ("parameters: 3", "net.yaml:2:13: parameters: found 3: expected a mapping from names to parts"),
        ("models: {a: 1}", "net.yaml:2:13: model 'a': found 1: expected the words of a model: "),
    ],
)
def test_a_section_or_a_part_of_another_kind(folder, text, expected):
    (folder / "net.yaml").write_text(f"neuro: 1\n{text}\nprobes: {{v: {{of: auto}}}}\n")
    assert str(mistakes("net.yaml", None, 0).mistakes[0]).startswith(expected)


def test_a_long_description_with_many_mistakes_is_checked_in_seconds(folder):
    """A part is looked at a few times, however many mistakes there are: it took minutes."""
    wrong = dict.fromkeys(range(0, 4000, 20), "-1")
    lines = [f"  p{k}: {{model: iaf_psc_exp, shape: {wrong.get(k, 1)}}}" for k in range(4000)]
    (folder / "net.yaml").write_text("\n".join(["neuro: 1", "populations:", *lines]))
    began = time.process_time()
    found = mistakes("net.yaml", None, 0).mistakes
    assert time.process_time() - began < 5.0
    assert [error.where.line for error in found] == [k + 3 for k in wrong]


@pytest.mark.parametrize("content", [None, b"no HDF5", b"\x89HDF\r\n\x1a\n" + bytes(64)])
def test_a_file_of_an_array_that_cannot_be_read_is_one_mistake(folder, content):
    """Neither of its words is read by itself then, wherever the array stands."""
    array = "{file: w.h5, key: w}"
    text = RIGHT.replace("weight: $w", f"weight: {array}").replace("C_m: 250.0", f"C_m: {array}")
    (folder / "net.yaml").write_text(text.replace("delay: 1.5", f"delay: {array}"))
    if content is not None:
        (folder / "w.h5").write_bytes(content)
    wanted = "no file 'w.h5' beside" if content is None else "file 'w.h5': expected an HDF5 file that can be read"
    told = [str(error) for error in mistakes("net.yaml", None, 0).mistakes]
    assert len(told) == 3
    assert all(wanted in each for each in told)
