"""Every planted fault is found with the right remedy; the networks they begin from have none."""

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

import neuro


def sound(base: str, change: dict[str, Any], folder: Path) -> None:
    """Assert that a network has no fault."""
    found = examined(network(base, change, folder))
    assert [each for each in found if each.severity != "note"] == [], str(found)


TABLE = yaml.safe_load((Path(__file__).parent / "faults.yaml").read_text("utf-8"))


def network(base: str, change: dict[str, Any], folder: Path) -> Path:
    """The file of a network with some words changed."""
    net = copy.deepcopy(TABLE["bases"][base])
    for path, value in change.items():
        *inner, last = path.split(".")
        at = net
        for word in inner:
            at = at[word]
        if value is None:
            del at[last]
        else:
            at[last] = value
    file = folder / "net.yaml"
    file.write_text(yaml.safe_dump(net, sort_keys=False), "utf-8")
    return file


def examined(file: Path, **options: Any) -> neuro.Diagnosis:
    """The diagnosis of a file, also of one that cannot be read."""
    from neuro_doctor.doctor import diagnose_errors, doctor

    try:
        net = neuro.load(file)
    except neuro.ModelError as error:
        return diagnose_errors(file.stem, [error])
    return doctor(net, seed=1, **options)


@pytest.mark.parametrize("name", TABLE["faults"])
def test_a_planted_fault_is_found(name, tmp_path):
    fault = TABLE["faults"][name]
    found = examined(network(fault["base"], fault.get("change", {}), tmp_path), **fault.get("with", {}))
    named = [each for each in found if each.name == fault["finds"]]
    assert named, str(found)
    assert any(fault["remedy"] in each.remedy for each in named), str(found)
    for word in fault.get("without", []):
        assert word not in str(found), str(found)


@pytest.mark.parametrize("base", TABLE["bases"])
def test_the_networks_without_fault_have_none(base, tmp_path):
    sound(base, {}, tmp_path)


@pytest.mark.parametrize("name", TABLE["sound"])
def test_what_is_no_fault_is_not_reported(name, tmp_path):
    sound(TABLE["sound"][name]["base"], TABLE["sound"][name]["change"], tmp_path)
