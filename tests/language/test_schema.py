"""The JSON Schema accepts what the loader accepts, and refuses mistakes in words, kinds and bounds."""

import json
from pathlib import Path

import jsonschema
import pytest

from neuro.model.language import schema
from neuro.model.language.reader import plain, read

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(path for folder in ("models", "examples") for path in (ROOT / folder).rglob("*.yaml"))
NETWORK = """\
neuro: 1
name: all
resolution: 0.1
parameters: {w: 2.0, n: 4, more: [1, 2]}
populations:
  a: {model: poisson_generator, shape: 4}
  b: {model: {iaf_psc_exp: {tau_m: [1.0, $w, 10 ms], V_th: {uniform: {low: -55.0, high: -50.0}}}}, shape: [$n, auto]}
  c: {model: {spike_generator: {spike_times: [[1.0], []]}}, shape: $n}
  d: {model: {iaf_psc_delta: {tau_m: .inf, refractory_input: true}}, shape: 2, initial: {V_m: normal}}
  e: {model: {encode: {file: x.h5, key: x, code: {rank: {ties: dense}}}}, shape: 4}
  f: {model: {encode: {values: [1.0, $w], code: [{rate: {r_min: 0, r_max: $w, max_rate: 9}}, rank]}}, shape: 2}
  g: {model: {event_camera: {file: walk.dat, polarity: on, crop: {x: [1, 9]}, scale: $n}}, shape: auto}
projections:
  a_b: {from: a, to: b, rule: all_to_all, weight: 3 nA, delay: 1.5 ms, synapse: {stdp: {lambda: $(w / 20), Wmax: $w}}}
  b_b: {from: b, to: b, rule: {pairs: {pre: [0], post: {file: p.npy}}}, weight: {file: w.h5, key: w}, synapse: r_stdp}
  a_d: {from: a, to: d, rule: {grid: {kernel: [3, $n]}}, weight: [[1.0]], synapse: {stdp_dopa: {dopamine: a}}}
signals: {reward: {to: b}}
groups: {choice: {winner_take_all: {of: b}}}
trials: {input: c, duration: 5.0, stop: full, labels: {of: b}, reward: {}, dropout: {of: b, p: 0.5}, reset: [V_m]}
probes: {v: {of: b, record: V_m, every: 0.5}}
"""


@pytest.fixture(scope="module")
def validator():
    made = schema()
    jsonschema.Draft202012Validator.check_schema(made)
    return jsonschema.Draft202012Validator(made)


def valid(validator, path, text):
    path.write_text(text)
    return validator.is_valid(plain(read(path)))


def test_it_is_json_and_always_the_same():
    assert json.dumps(schema(), allow_nan=False) == json.dumps(schema())


def test_a_network_with_everything(validator, tmp_path):
    assert valid(validator, tmp_path / "net.yaml", NETWORK)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_networks_of_this_repository(validator, path):
    validator.validate(plain(read(path)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("neuro: 1\n", "neuro: 2\n"),
        ("name: all", "name: [all]"),
        ("name: all", "nmae: all"),
        ("resolution: 0.1", "resolution: 0"),
        ("shape: 4}", "shape: 0}"),
        ("shape: 4}", "size: 4}"),
        (", shape: 4}", "}"),
        ("shape: 4}", "shape: 4, tau_m: 10.0}"),
        ("model: poisson_generator", "model: poison_generator"),
        ("[1.0, $w,", "[1.0, w,"),
        ("ties: dense", "ties: shared"),
        ("{rank: {ties: dense}}", "rnak"),
        ("file: x.h5, key", "key"),
        ("values: [1.0, $w], ", ""),
        ("values: [1.0, $w]", "values: [1.0], file: x.npy"),
        (", max_rate: 9", ""),
        ("V_th", "v_th"),
        ("{low: -55.0", "{lower: -55.0"),
        ("refractory_input: true", "refractory_input: yes"),
        ("V_m: normal", "V_m: norm"),
        ("tau_m: .inf", "tau_m: 0"),
        ("rule: all_to_all", "rule: fixed_indegree"),
        ("rule: all_to_all, ", ""),
        ("from: a, to: b", "source: a, target: b"),
        ("delay: 1.5 ms", "delay: 0"),
        ("delay: 1.5 ms", "delay: 1.5 mV"),
        ("lambda: $(w", "lambda_: $(w"),
        ("{file: p.npy}", "{flie: p.npy}"),
        ("synapse: r_stdp", "synapse: {static: {w: 1}}"),
        ("reward: {to: b}", "reward: b"),
        ("winner_take_all: {of: b}", "winner_take_all: {}"),
        ("winner_take_all: {of: b}", "local_winners: {of: b, radius: -1}"),
        ("duration: 5.0, ", ""),
        ("stop: full", "stop: never"),
        ("p: 0.5", "p: 1.0"),
        ("every: 0.5", "every: 0"),
    ],
)
def test_mistakes(validator, tmp_path, old, new):
    assert old in NETWORK
    assert not valid(validator, tmp_path / "net.yaml", NETWORK.replace(old, new, 1))


def test_words_carry_their_meaning():
    tau_m = schema()["$defs"]["model.iaf_psc_exp"]["properties"]["tau_m"]
    assert tau_m["description"] == "membrane time constant (ms)"
    assert tau_m["default"] == 10.0
    assert {"type": "number", "exclusiveMinimum": 0} in tau_m["anyOf"]
