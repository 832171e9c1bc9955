"""`neuro check` tells every mistake of a file, each in the words that it has alone, and nothing that only follows."""

import re
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from beside import beside
from neuro.compiler.mistakes import mistakes

RIGHT, PLANTED = beside(__file__, "RIGHT", "PLANTED")


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


def test_thirteen_mistakes_are_told_in_one_run(folder, alone):
    names = tuple(sorted(PLANTED)[:13])
    assert sorted(told(folder, names)) == sorted(alone[name] for name in names)


BROKEN, LATE = ("inh: {model: {iaf_psc_exp:", "inh: {model: {iaf_psc_ex:"), ("delay: 2.0", "delay: 2.05")
TAU_M, C_M = ("tau_m: 10.0", "tau_m: -10.0"), ("C_m: 250.0", "C_m: 3 mV")


@pytest.mark.parametrize(("first", "second"), [(TAU_M, C_M), (BROKEN, LATE)])
def test_two_of_a_population_and_of_its_projection_are_told_as_if_alone(all_mistakes, first, second):
    alone = [all_mistakes(RIGHT.replace(*each)) for each in (first, second)]
    assert [each.count("net.yaml:") for each in alone] == [1, 1]
    assert all_mistakes(RIGHT.replace(*first).replace(*second)) == "\n".join(alone)


def test_a_mistake_in_a_parameter_of_three_parts_is_told_once(all_mistakes):
    text = re.sub(r"weight: (-20.0|{normal: .*?}})", "weight: $w", RIGHT)
    assert text.count("weight: $w") == 3
    assert (
        all_mistakes(text.replace("w: 300.0", "w: $(300.0 / 0)"))
        == "net.yaml:4:25: '$(300.0 / 0)': division by 0: expected another divisor"
    )


@pytest.mark.parametrize("included", ["{a: {model: iaf_psc_exp, shape: -1}}", "{a: [}"])
def test_a_mistake_in_an_included_file_hides_none_beside_it(folder, all_mistakes, included):
    """What a file that cannot be read may define is not reported as unknown."""
    text = "neuro: 1\ninclude: [part.yaml]\npopulations: {b: {model: iaf_psc_delta, shape: 3}}\n"
    text += "probes: {p: {of: a}, q: {of: b, record: V_m, every: 1.0}}\n"
    (folder / "part.yaml").write_text(f"populations: {included}\n")
    of_part = all_mistakes(text)
    assert of_part.count(".yaml:") == 1
    (folder / "part.yaml").write_text("populations: {a: {model: iaf_psc_exp, shape: 1}}\n")
    wrong = text.replace("every: 1.0", "every: soon").replace("shape: 3", "shape: 0")
    beside = all_mistakes(wrong)
    assert beside.count(".yaml:") == 2
    (folder / "part.yaml").write_text(f"populations: {included}\n")
    assert all_mistakes(wrong) == f"{beside}\n{of_part}"


def test_a_value_may_replace_that_of_a_file_that_cannot_be_read(folder):
    (folder / "net.yaml").write_text("neuro: 1\ninclude: [part.yaml]\n")
    (folder / "part.yaml").write_text("parameters: {w: [}\n")
    [error] = mistakes("net.yaml", {"w": 1.0}, 0).mistakes
    assert str(error).startswith("part.yaml:1:18: not YAML")


def test_they_are_told_by_place(folder, alone):
    found = told(folder, ("an interval", "resolved names", "off the grid", "a bound"))
    assert found == [alone[name] for name in ("resolved names", "a bound", "off the grid", "an interval")]


def test_loading_and_compiling_raise_the_first(folder, alone):
    for name in PLANTED:
        told(folder, (name,))
        assert first("net.yaml") == [alone[name]]


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


def test_what_only_follows_is_not_told(all_mistakes, messages):
    messages.of(lambda text: all_mistakes(eval(text, globals())))


def test_a_section_or_a_part_of_another_kind(all_mistakes, messages):
    messages.of(lambda text: all_mistakes(eval(text)))


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
