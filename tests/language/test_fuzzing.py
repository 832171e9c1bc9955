"""Whatever stands in a description, the answer is a network or a `ModelError` with a place."""

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import neuro

TEXT = """\
neuro: 1
name: follower
resolution: 1.0
parameters: {w: 1500.0, n: [8, 8]}
populations:
  cells:  {model: poisson_generator, shape: $n}
  motors: {model: {iaf_psc_exp: {tau_m: 10.0, t_ref: .inf}}, shape: [2, auto], initial: {V_m: -60.0}}
projections:
  cells_motors:
    from: cells
    to: motors
    rule: {grid: {kernel: [3, 3], stride: 1}}
    weight: {normal: {mean: $w, std: 1e-3}}
    delay: [1.0, 2.0]
    synapse: {stdp_dopa: {tau_c: 1000.0, signal: reward}}
  loop: {from: motors, to: motors, rule: {pairs: {pre: [0], post: [1]}}, weight: {file: w.h5, key: w}}
signals:
  reward: {to: motors}
groups:
  choice: {winner_take_all: {of: motors, first_to_fire: true}}
trials:
  input: cells
  duration: 64.0
  dropout: {of: motors, p: 0.25}
  reset: [V_m]
probes:
  steering: {of: motors, record: 'spikes'}
"""
PIECES = [
    *"{}[]:,-#&*!|>'\"%@`$?~\\ \t\n\r\x00\ufeff\u2028é0",
    "null",
    "true",
    ".nan",
    "1e999",
    "-1",
    "{}",
    "[]",
    "<<",
    "---",
    "...",
    "auto",
    "$n",
    "!!int",
    "&a",
    "*a",
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


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=broken())
@example(b"")
@example(b"neuro: 1")
@example(b"\xef\xbb\xbf")
@example(b"neuro: 1\n? ")
@example(b"neuro: 1\nname: $")
def test_a_broken_text(path, data):
    answer(path, data)


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=60))
def test_any_bytes(path, data):
    answer(path, data)
