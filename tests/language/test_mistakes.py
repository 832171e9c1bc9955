"""Each mistake in a description is reported where it is, with a way out: `mistakes.yaml` has texts and messages."""

from pathlib import Path

import yaml

TABLE = yaml.safe_load((Path(__file__).parent / "mistakes.yaml").read_text(encoding="utf-8"))


def test_messages(message):
    wrong = []
    for part in TABLE.values():
        before, after = part["frame"]
        told = {text: message(f"{before}{text}{after}").removeprefix("net.yaml:") for text in part["cases"]}
        wrong += [f"{text}: {told[text]}" for text, expected in part["cases"].items() if told[text] != expected]
    assert wrong == []
