"""The JSON Schema accepts what the loader accepts, and refuses mistakes in words, kinds and bounds."""

import json
from pathlib import Path

import jsonschema
import pytest

from beside import beside
from neuro.model.language import schema
from neuro.model.language.reader import plain, read

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(path for folder in ("models", "examples") for path in (ROOT / folder).rglob("*.yaml"))
(NETWORK,) = beside(__file__, "NETWORK")


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


(REPLACED,) = beside(__file__, "REPLACED")


def test_mistakes(validator, tmp_path):
    for old, new in REPLACED:
        assert old in NETWORK
        assert not valid(validator, tmp_path / "net.yaml", NETWORK.replace(old, new, 1)), new


def test_words_carry_their_meaning():
    tau_m = schema()["$defs"]["model.iaf_psc_exp"]["properties"]["tau_m"]
    assert tau_m["description"] == "membrane time constant (ms)"
    assert tau_m["default"] == 10.0
    assert {"type": "number", "exclusiveMinimum": 0} in tau_m["anyOf"]
