"""Each fault can be planted: the text that it replaces stands once in the file it names, and its tests are there."""

from pathlib import Path

import pytest
import yaml

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.mark.parametrize("file", sorted(HERE.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_fault_of_a_set_applies(file):
    faults = yaml.safe_load(file.read_text("utf-8"))
    assert faults
    for fault in faults:
        assert (ROOT / fault["file"]).read_text("utf-8").count(fault["old"]) == 1, fault["name"]
        assert fault["new"] != fault["old"], fault["name"]
        assert [test for test in fault["tests"] if not (ROOT / test).exists()] == [], fault["name"]
