"""How far long work is: told on stderr, and never a change of what is computed."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import neuro
from beside import beside
from neuro.core import progress
from neuro.core.progress import advance
from refused import refused

(NET,) = beside(__file__, "NET")


@pytest.fixture
def sim(tmp_path):
    (tmp_path / "net.yaml").write_text(NET)
    return lambda: neuro.compile(neuro.load(tmp_path / "net.yaml"), seed=3)


def test_progress_changes_no_bit(sim, monkeypatch, capsys):
    monkeypatch.setattr("neuro.core.progress.STRETCH_S", 1e-5)
    once, told = sim(), sim()
    once.run(300.0)
    told.run(300.0, progress=True)
    assert told.time == once.time == 300.0
    for mine, theirs in zip(told.spikes("exc"), once.spikes("exc"), strict=True):
        assert np.array_equal(mine, theirs)
    for mine, theirs in zip(told.trace("v"), once.trace("v"), strict=True):
        assert np.array_equal(mine, theirs)
    assert np.array_equal(told.weights("noise_exc")[2], once.weights("noise_exc")[2])
    assert capsys.readouterr().out == ""


def test_lines_where_there_is_no_terminal(sim, monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVERY_S", 0.0)
    sim().run(50.0, progress=True)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()
    for line in err.splitlines():
        assert re.fullmatch(r"\d+ of 50 ms, [\d,]+ ms/s(, \d+ s left)?", line), line
    assert err.splitlines()[-1].startswith("50 of 50 ms")


def test_the_clock_starts_when_kernels_are_compiled(monkeypatch, capsys):
    """The first step takes 20 s, any other 0.01 s: no rate and no rest follow from the first."""
    now = [0.0]

    class Slow:
        program = SimpleNamespace(resolution=0.1)

        def check_room(self, steps):
            pass

        def run(self, ms):
            now[0] += 20.0 if not now[0] else 0.1 * ms

    monkeypatch.setattr(progress, "EVERY_S", 0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now[0], perf_counter=lambda: now[0]))
    with progress.Bar() as bar:
        assert advance(Slow(), 2000, bar) == 20.0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "0 of 200 ms, 10 ms/s, 20 s left"
    assert lines[-1] == "200 of 200 ms, 10 ms/s"
    with progress.Bar() as bar:
        assert advance(Slow(), 1, bar) == 0.0


def test_a_line_every_ten_seconds(monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVERY_S", 10.0)
    now = iter([0.0, 4.0, 9.0, 11.0, 11.0, 20.0, 20.0, 22.0, 22.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    with progress.Bar() as bar:
        bar.say("preparing")
        bar.say("preparing more")
        for done in (10, 20, 30):
            bar.show(done, 100, f"{done} of 100")
    assert capsys.readouterr().err == "10 of 100, 99 s left\n30 of 100, 51 s left\n"


def test_a_bar_on_a_terminal(sim, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(progress, "_is_terminal", lambda: True)
    sim().run(50.0, progress=True)
    assert "50 of 50 ms" in capsys.readouterr().err


def test_progress_is_true_or_false(sim):
    assert re.search(re.escape("run: progress = 3: expected true or false"), refused(sim().run, 1.0, progress=3))
