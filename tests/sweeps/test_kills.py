"""Twenty processes killed at random moments: nothing is lost, half-written, or done twice without need."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from neuro.sweeps.folder import Folder
from neuro.sweeps.table import table_of

RUNS = 150
SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
import my_runs, neuro
if __name__ == "__main__":
    neuro.sweep(my_runs.noting, {{"a": list(range({runs}))}}, out={out!r}, set={{"notes": {notes!r}, "pause": 0.05}},
                workers=2, progress=False)
"""


def children(process):
    found = []
    for each in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = each.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(words[1]) == process and words[0] != "Z":
            found.append(int(each.parent.name))
    return found


def kept(out):
    runs = out / "runs"
    return {name for name in os.listdir(runs) if not name.startswith(".")} if runs.is_dir() else set()


def begun(notes):
    return {path.name: len(path.read_text().split()) for path in notes.iterdir()}


def hit(process, whom):
    """Kill a worker, the main process alone, or all at once, as a loss of power would."""
    if whom == "all":
        os.killpg(process.pid, signal.SIGKILL)
        return True
    targets = children(process.pid) if whom == "worker" else [process.pid]
    for target in targets[:1]:
        try:
            os.kill(target, signal.SIGKILL)
        except ProcessLookupError:
            return False
    return bool(targets)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_kills_at_random_moments(tmp_path, seed):
    out, notes = tmp_path / "out", tmp_path / "notes"
    notes.mkdir()
    text = SCRIPT.format(folder=str(Path(__file__).parent), out=str(out), notes=str(notes), runs=RUNS)
    draw, kills, hits = random.Random(seed), 0, 0
    process = None
    done_before: dict[str, int] = {}
    end = time.monotonic() + 300
    while time.monotonic() < end:
        if process is None or process.poll() is not None:
            if process is not None and process.returncode == 0:
                break
            process = subprocess.Popen([sys.executable, "-c", text], start_new_session=True)
            while process.poll() is None and not children(process.pid):  # python itself is no news
                time.sleep(0.02)
        if kills >= 20:
            process.wait(120)
            continue
        time.sleep(draw.uniform(0.0, 1.0))
        there = kept(out)
        counts = begun(notes)
        of_run = {row["run"]: f"{row['a']}-0" for row in table_of(out)} if (out / "sweep.json").exists() else {}
        for key in there:
            assert Folder(out).outcome(key) is not None, "half-written"
            name = of_run[key]
            assert counts[name] == done_before.setdefault(name, counts[name]), "done again though it was kept"
        if process.poll() is None:
            whom = ("worker", "main", "all")[kills % 3]
            kills += 1
            hits += hit(process, whom)
            if whom != "worker":
                process.wait(20)
    assert process.returncode == 0
    assert hits >= 15
    table = table_of(out)
    assert table.counts() == {"done": RUNS, "failed": 0, "under way": 0, "left": 0}
    assert table.column("value") == [2 * a for a in range(RUNS)]
    final = begun(notes)
    assert {name: final[name] for name in done_before} == done_before
    assert sum(final.values()) <= RUNS + 2 * hits
    assert sorted(os.listdir(out / "runs")) == sorted(table.keys)
