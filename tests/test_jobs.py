"""Jobs side by side: results in order, reports, errors, and what becomes of it when a process is killed."""

import os
import signal
import subprocess
import sys
import time

import pytest

from neuro import ModelError
from neuro.apps import side_by_side
from neuro.core.processes import Lost, Processes
from refused import refused

FOREVER = """
import os, sys, time
from neuro.apps import side_by_side

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


class Own(Exception):
    """An error that cannot be sent: it needs two words to be made."""

    def __init__(self, what, number):
        super().__init__(f"{what} {number}")


def fail(job, report):
    report(job)
    if job == 3:
        return job
    raise {1: ModelError("job 1: expected another", hint="say 2"), 2: Own("of job", 2), 4: SystemExit("enough")}[job]


def test_errors_are_raised_once_all_have_ended():
    heard = []
    with pytest.raises(SystemExit, match="enough"):
        side_by_side(fail, [4, 3], 2, heard.append)
    assert sorted(heard) == [3, 4]
    assert refused(side_by_side, fail, [1, 3], 2) == "job 1: expected another\n  hint: say 2"
    with pytest.raises(RuntimeError, match="Own: of job 2") as error:
        side_by_side(fail, [2, 3], 2)
    assert "raise {1: ModelError" in str(error.value.__cause__)


def die(job, report):
    """End the process of job 2 where its note is not there yet, or always where it has none."""
    number, note = job
    report(number)
    if number == 2 and not (note and os.path.exists(note)):
        if note:
            open(note, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_process_that_is_killed_is_started_anew(tmp_path):
    heard = []
    assert side_by_side(die, [(n, str(tmp_path / "note")) for n in range(5)], 2, heard.append) == [0, 1, 2, 3, 4]
    assert sorted(heard) == [0, 1, 2, 2, 3, 4]


def test_a_job_whose_process_is_killed_twice_is_an_error_once_the_others_are_done():
    heard = []
    assert refused(side_by_side, die, [(n, "") for n in range(5)], 2, heard.append) == (
        "a process was ended by SIGKILL, 2 times: it was killed or ran out of memory\n"
        "  hint: run the same command again to resume"
    )
    assert sorted(heard) == [0, 1, 2, 2, 3, 4]


def hear_all(pool):
    heard = []
    while pool.busy:
        heard += pool.hear()
    return heard


def sleeping():
    return lambda job, attempt, tell: time.sleep(job)


def test_a_job_that_takes_too_long_is_ended():
    with Processes(sleeping, 2, seconds=1.0) as pool:
        for job in (0.0, 1000.0, 0.0):
            pool.put(job)
        heard = hear_all(pool)
        processes = [each.process for each in pool._processes]
    ends = {task.job: task.exception() for task in heard}
    assert ends[0.0] is None
    assert isinstance(ends[1000.0], Lost)
    assert (ends[1000.0].timed_out, ends[1000.0].attempts) == (True, 1)
    assert len(heard) == 3
    assert all(process.poll() is not None for process in processes)
    assert not pool.busy
    assert pool.hear() == []


def ending():
    os._exit(3)


def refusing():
    raise ModelError("not here", hint="elsewhere")


@pytest.mark.parametrize(
    ("begin", "told"),
    [
        (ending, "a worker process ended with 3 before its first job: see its output above"),
        (refusing, "not here\n  hint: elsewhere"),
    ],
)
def test_processes_that_cannot_begin(begin, told):
    with Processes(begin, 2) as pool:
        pool.put(1)
        assert refused(hear_all, pool) == told


SCRIPT = """
import os, sys
from dataclasses import dataclass
from neuro.apps import side_by_side

@dataclass
class Job:
    number: int

def run(job, report):
    report(sys.argv[1:])
    return Job(job.number + 1), __name__, os.environ.get("PYTHONPATH")
"""
GUARDED = """
if __name__ == "__main__":
    told = []
    found = side_by_side(run, [Job(1), Job(2)], 2, told.append)
    assert all(type(job) is Job for job, *_ in found)
    print(found, told)
"""
BARE = """
side_by_side(run, [Job(1), Job(2)], 2)
"""


def _script(tmp_path, text):
    (tmp_path / "script.py").write_text(SCRIPT + text)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    words = [sys.executable, "script.py", "word"]
    return env, subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=env, timeout=100)


def test_what_a_script_defines_is_found(tmp_path):
    env, told = _script(tmp_path, GUARDED)
    assert told.stderr == ""
    path = env["PYTHONPATH"]
    one, two = (f"(Job(number={number}), '__mp_main__', {path!r})" for number in (2, 3))
    assert told.stdout == f"[{one}, {two}] [['word'], ['word']]\n"


def test_a_script_that_starts_processes_wherever_it_is_read_is_told(tmp_path):
    _, told = _script(tmp_path, BARE)
    assert told.returncode == 1
    last = told.stderr.rstrip().splitlines()[-2:]
    why = "starts processes when it is imported: expected the call in the main block"
    assert last == [
        f"neuro.core.errors.ModelError: {tmp_path}/script.py: {why}",
        '  hint: put the call below: if __name__ == "__main__":',
    ]


def test_what_was_run_with_with_is_run_in_processes(tmp_path):
    (tmp_path / "mine_for_jobs.py").write_text(
        "import neuro\n@neuro.register(kind='code')\ndef of_mine(value):\n    return value\n"
    )
    script = (
        "from neuro.core.extension import run_extension\nfrom neuro.apps import side_by_side\n"
        "def run(job, report):\n    from neuro.coding import CODES\n    return 'of_mine' in CODES\n"
        "if __name__ == '__main__':\n    run_extension('mine_for_jobs.py')\n    print(side_by_side(run, [1, 2], 2))\n"
    )
    (tmp_path / "script.py").write_text(script)
    words = [sys.executable, "script.py"]
    told = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, timeout=100)
    assert (told.stdout, told.stderr) == ("[True, True]\n", "")


@pytest.mark.parametrize(
    ("text", "sent"), [(FOREVER, signal.SIGKILL), (IDLE, signal.SIGKILL), (FOREVER, signal.SIGINT)]
)
def test_when_the_parent_ends_all_end(tmp_path, sent, text):
    script = tmp_path / "forever.py"
    script.write_text(text)
    words = [sys.executable, script]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as parent:
        children = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(sent)
    assert parent.returncode == -sent
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
