"""What is kept of the long comparisons of recognisers is what their page says, so its pictures are, too."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmark_scripts import script

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "reference" / "recognisers.md").read_text()
TABLE = re.findall(r"^\| `([\w:]+)` \| ([^|]+) \| (\d) \|([^|]*)\|[^|]*\|$", PAGE, re.M)


@pytest.fixture(scope="module")
def figures():
    pytest.importorskip("matplotlib")
    return script("recognise_figures")


def told(each):
    shares = [100 * one.accuracy for one in each]
    return f"{np.mean(shares):.1f} ± {np.std(shares, ddof=1):.1f}"


def test_n_mnist(figures):
    kept, seen = figures.kept("N-MNIST"), set()
    for name, accuracy, seeds, _ in TABLE:
        if seeds == "3":
            assert told(kept[name.replace(":", "-")]) == accuracy
            seen.add(name.replace(":", "-"))
    assert f"`conv` [{told(kept['conv'])} %]" in PAGE
    assert f"`dense` {told(kept['dense'])} (three seeds)" in PAGE
    for name in ("learnt_delays", "recurrent"):
        assert re.search(rf"`{name}` {100 * kept[name][0].accuracy:.1f}\b", PAGE)
    assert kept.keys() == seen | {"conv", "dense", "learnt_delays", "recurrent"}


def test_poker(figures):
    kept = figures.kept("POKER-DVS")
    rows = {name: poker.partition(" / ")[0].strip() for name, _, _, poker in TABLE if poker.strip()}
    assert {name: told(each) for name, each in kept.items()} == rows


def test_what_folders_have_is_kept_if_it_is_all(figures, tmp_path, monkeypatch):
    from neuro.apps import Evaluation

    monkeypatch.setattr(figures, "KEPT", tmp_path / "kept.json")
    (tmp_path / "kept.json").write_text('{"POKER-DVS": {"recordings": 4, "right": {"hats": [4], "boe": [1]}}}')
    whole, some = (Evaluation(("a",), np.array([[2, wrong]])) for wrong in (2, 1))
    figures.keep({"POKER-DVS": {"hats": [whole, whole], "boe": [whole, some], "remus": [whole]}})
    assert figures.kept("POKER-DVS") == {"hats": [(2, 4), (2, 4)], "boe": [(1, 4)], "remus": [(2, 4)]}
