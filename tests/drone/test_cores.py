"""Work side by side: results in order, reports, errors, and what becomes of it when the parent is killed."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from neuro import ModelError
from neuro_drone.cores import side_by_side

FOREVER = """
import os, sys, time
from neuro_drone.cores import side_by_side

def run(job, report):
    os.write(1, f"{os.getpid()}\\n".encode())
    while True:
        report(job)
        time.sleep(0.02)

if __name__ == "__main__":
    side_by_side(run, [1, 2], processes=2)
"""
IDLE = FOREVER.replace("while True:", "while job == 1:")  # the second ends, and waits for more


def double(job, report):
    report(("at", job))
    if job < 0:
        raise ModelError(f"job {job}: expected a number >= 0", hint="say -job")
    return 2 * job


@pytest.mark.parametrize("processes", [1, 2])
def test_results_are_in_order_and_reports_arrive(processes):
    heard = []
    assert side_by_side(double, [3, 1, 2], processes, heard.append) == [6, 2, 4]
    assert sorted(heard) == [("at", 1), ("at", 2), ("at", 3)]


def test_an_error_comes_back_whole():
    with pytest.raises(ModelError) as error:
        side_by_side(double, [1, -1], 2)
    assert str(error.value) == "job -1: expected a number >= 0\n  hint: say -job"


def die(job, report):
    if job == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(30)


def test_a_process_that_is_killed_is_an_error_and_ends_all():
    before = multiprocessing.active_children()
    with pytest.raises(ModelError, match="a process was killed or ran out of memory") as error:
        side_by_side(die, [1, 2], 2)
    assert "goes on where it was" in str(error.value)
    assert set(multiprocessing.active_children()) <= set(before)


@pytest.mark.parametrize("text", [FOREVER, IDLE])
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, -signal.SIGINT)])
def test_when_the_parent_ends_all_end(tmp_path, sent, code, text):
    script = tmp_path / "forever.py"
    script.write_text(text)
    words = [sys.executable, script]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as parent:
        children = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(sent)
    assert parent.returncode == code
    until = time.monotonic() + 10
    while any(alive(pid) for pid in children) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(alive(pid) for pid in children)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"
