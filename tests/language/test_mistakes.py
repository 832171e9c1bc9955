"""Each mistake in a description is reported where it is, with a way out: `mistakes.yaml` has texts and messages."""

from pathlib import Path

import pytest
import yaml

TABLE = yaml.safe_load((Path(__file__).parent / "mistakes.yaml").read_text(encoding="utf-8"))
CASES = [
    (f"{part['frame'][0]}{text}{part['frame'][1]}", expected)
    for part in TABLE.values()
    for text, expected in part["cases"].items()
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_message(message, text, expected):
    assert message(text) == f"net.yaml:{expected}"
