"""How `benchmarks/peers.py` compares: the processor's time with the processor's, the clock's with the clock's."""

import json
import sys

import pytest

from benchmark_scripts import script

OURS = {"cpu_s_per_bio_s": 1.0, "sim_s_per_bio_s": 1.5}
THEIRS = {
    "bench_nest.py": {"cpu_s_per_bio_s": 2.0, "sim_s_per_bio_s": 30.0},
    "bench_brian2.py": {"sim_s_per_bio_s": 6.0},
}


@pytest.fixture
def peers():
    return script("peers")


def test_like_is_compared_with_like(peers, tmp_path, monkeypatch):
    for name, figures in {"run.py": OURS, **THEIRS}.items():
        (tmp_path / name).write_text(f"print({json.dumps(figures)!r})")
    monkeypatch.setattr(peers, "OURS", tmp_path / "run.py")
    assert peers.compared("cuba", tmp_path, sys.executable) == [
        ("cuba", "neuro", 1.0, ""),
        ("cuba", "NEST", 2.0, "2.0"),
        ("cuba", "Brian2", 6.0, "4.0"),
    ]


def test_a_peer_that_fails_is_told_and_left_out(peers, tmp_path, monkeypatch, capsys):
    (tmp_path / "run.py").write_text(f"print({json.dumps(OURS)!r})")
    (tmp_path / "bench_nest.py").write_text("raise SystemExit('no such kernel')")
    (tmp_path / "bench_brian2.py").write_text("")
    monkeypatch.setattr(peers, "OURS", tmp_path / "run.py")
    assert peers.compared("cuba", tmp_path, sys.executable) == [("cuba", "neuro", 1.0, "")]
    told = capsys.readouterr().out
    assert "bench_nest.py cuba: no such kernel" in told
    assert "bench_brian2.py cuba --target cpp: no output" in told
