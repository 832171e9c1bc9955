"""Each mistake in a description is reported where it is, with a way out: `mistakes.yaml` has texts and messages."""

from pathlib import Path

import pytest
import yaml

TABLE = yaml.safe_load((Path(__file__).parent / "mistakes.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("part", TABLE)
def test_messages(message, part):
    before, after = TABLE[part]["frame"]
    cases = TABLE[part]["cases"]
    assert {text: message(f"{before}{text}{after}") for text in cases} == {
        text: f"net.yaml:{expected}" for text, expected in cases.items()
    }
