"""Golden traces are what the reference says: files of other simulators, where they are at hand."""

import json
from pathlib import Path

import numpy as np
import pytest

import golden_traces
import neuro
from golden_traces import DIGESTS, GOLDEN, NETWORKS, TRACES, digest, sources, thinned
from neuro.testing.verify import _read


@pytest.fixture
def reference(shared: Path, pytestconfig: pytest.Config, tmp_path: Path) -> Path:
    """The folder of the reference; `--renew-golden` writes the golden traces anew first."""
    if pytestconfig.getoption("--renew-golden"):
        golden_traces.renew_all(shared / "reference", tmp_path)
    return shared / "reference"


def test_golden_traces_are_those_of_the_reference(reference: Path):
    assert json.loads(DIGESTS.read_text()) == {name: digest(file) for name, file in sources(reference).items()}
    for folder in TRACES:
        names = {file.stem for file in (reference / folder).glob("*.json")}
        assert {file.stem for file in (GOLDEN / folder).glob("*.json")} == names
        for name in names:
            whole, own = _read(reference / folder / f"{name}.json"), _read(GOLDEN / folder / f"{name}.json")
            facts, arrays = {"reference": f"{folder}/{name}", **whole.facts}, thinned(whole)
            assert own.facts.items() <= facts.items(), name
            limit = 1e-3 if name.startswith("f") else 1e-9
            for word, values in own.arrays.items():
                np.testing.assert_allclose(values, arrays[word], rtol=0.0, atol=limit * (values.dtype.kind == "f"))


def test_golden_networks_are_those_of_the_reference(reference: Path, tmp_path: Path):
    """As `from_netx` reads them; what they answered was compared when it was written."""
    lava = reference / "loihi2"
    files = {"tinynet": ("tiny.net", {"reset": 17}), "pilotnet_sdnn": ("gts_pilotnet_sdnn_network.net", {})}
    files["pilotnet_lif"] = ("pilotnet_lif/network.net", {"reset": 17, "first": 1})
    for name, (file, words) in files.items():
        golden = golden_traces.stored(name)
        read = golden_traces.packed(neuro.from_netx(lava / file, **words), tmp_path)
        assert {key for key in golden if key.startswith("net.")} == {*read}
        for key in read:
            assert np.array_equal(read[key], golden[key]), (name, key)


def test_golden_traces_are_small():
    files = [file for file in GOLDEN.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) <= 3_000_000
    assert {file.stem for file in (GOLDEN / "networks").iterdir()} == {*NETWORKS}
