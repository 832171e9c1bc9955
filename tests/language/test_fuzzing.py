"""Whatever stands in a description, the answer is a network or a `ModelError` with a place."""

import copy
import shutil
from pathlib import Path

import pytest
import typer
import yaml
from hypothesis import HealthCheck, example, given, settings, strategies as st

import neuro
from beside import beside
from neuro.cli.chips import check

(TEXT,) = beside(__file__, "TEXT")
PIECES = [
    *"{}[]:,-#&*!|>'\"%@`$?~\\ \t\n\r\x00\ufeff\u2028é0",
    *("null", "true", ".nan", "1e999", "-1", "{}", "[]", "<<", "---", "...", "auto", "$n", "!!int", "&a", "*a"),
    "include: [net.yaml]\n",
]


@st.composite
def broken(draw):
    """The text after a few deletions, insertions, replacements, and lines that moved."""
    text = draw(st.sampled_from([TEXT, *TEXT.splitlines(keepends=True)]))
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, len(text)))
        end = min(len(text), begin + draw(st.integers(0, 12)))
        match draw(st.integers(0, 4)):
            case 0:
                text = text[:begin] + text[end:]
            case 1:
                text = text[:end] + text[begin:]
            case 2:
                text = text[:begin] + draw(st.sampled_from(PIECES)) + text[begin:]
            case 3:
                text = text[:begin] + draw(st.sampled_from(PIECES) | st.text(max_size=3)) + text[end:]
            case 4:
                lines = text.splitlines(keepends=True) or [""]
                line = lines.pop(draw(st.integers(0, len(lines) - 1)))
                lines.insert(draw(st.integers(0, len(lines))), line)
                text = "".join(lines)
    return text.encode("utf-8", "surrogatepass")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "net.yaml"


def answer(path, data):
    """Load, and check what came of it."""
    path.write_bytes(data)
    found = None
    try:
        assert isinstance(neuro.load(path), neuro.Network)
    except neuro.ModelError as error:
        found = error
    assert found is None or (found.message and found.where.file == str(path) and found.where.line > 0)


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=broken())
def test_a_broken_text(path, data):
    answer(path, data)


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=60) | st.sampled_from([b"", b"neuro: 1", b"\xef\xbb\xbf", b"neuro: 1\n? "]))
@example(b"neuro: 1\nname: $")
def test_any_bytes(path, data):
    answer(path, data)


ROOT = Path(__file__).parents[2]
FILES = (
    *("neuro/cli/templates/closed-loop/network.yaml", "models/neuro_models/conditioning.yaml"),
    *("models/neuro_models/mozafari.yaml", "tests/equations/models.yaml"),
)
RICH = {path: yaml.safe_load((ROOT / path).read_text()) for path in FILES}
KINDS = [
    *(None, True, -7, 0, 3, 0.5, -2.5e9, 10**30, float("inf"), float("nan")),
    *("", "word", "auto", "[1, 2]", "1 mV", "$x", "$(1/0)"),
    *([], [1, 2], [[1], [2, 3]], ["a", "b"], [{"a": 1}, {"b": 2}]),
    *({}, {"a": 1}, {"1": {"model": 1}}, {1: 2}, {None: 1}, {True: {}}, {1.5: "x"}, {"a b: c": {}, "": 1}),
    *({"iaf_psc_exp": {"tau_m": "x"}}, {"file": "w.h5", "key": "x"}),
]
"""A value of each kind that may stand in place of a node."""


def paths(value, before=()):
    yield before
    for word in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from paths(value[word], (*before, word))


def replaced(root, path, value):
    if not path:
        return value
    root = copy.deepcopy(root)
    within = root
    for word in path[:-1]:
        within = within[word]
    within[path[-1]] = value
    return root


PLACES = [(name, path) for name, root in RICH.items() for path in paths(root)]


@pytest.fixture(scope="module")
def beside(tmp_path_factory):
    """The rich files' folders without the files, so that what these name is there."""
    folder = tmp_path_factory.mktemp("rich")
    for name in RICH:
        for file in (ROOT / name).parent.glob("*.h5"):
            shutil.copy(file, folder)
    return folder / "net.yaml"


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(place=st.sampled_from(PLACES), kind=st.sampled_from(KINDS))
@example(place=(next(iter(RICH)), ("populations",)), kind=[1, 2])
@example(place=(next(iter(RICH)), ("populations",)), kind="auto")
@example(place=("tests/equations/models.yaml", ("models",)), kind={"a": 1})
@example(place=("tests/equations/models.yaml", ("models", "own_iaf_psc_exp", "refractory", "hold")), kind=[[1], [2, 3]])
def test_a_node_of_another_kind_is_a_message_and_status_2(beside, capsys, place, kind):
    name, path = place
    beside.write_text(yaml.safe_dump(replaced(RICH[name], path, kind), sort_keys=False))
    try:
        neuro.compile(neuro.load(beside), backend="reference")
        right = True
    except neuro.ModelError:
        right = False
    status = 0
    try:
        check(beside, backend="reference")
    except typer.Exit as end:
        status = end.exit_code
    told = capsys.readouterr().err
    assert (status, bool(told)) == ((0, False) if right else (2, True))
