"""Other systems than Linux: what they lack is refused by one message, and the rest does not ask for it."""

import subprocess
import sys

from neuro.core.system import only_on_linux, usable_cores
from refused import refused


def test_other_systems_use_all_cores(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delattr("os.sched_getaffinity")
    monkeypatch.setattr("os.cpu_count", lambda: 7)
    assert usable_cores() == 7


def test_parts_that_need_linux_say_so(monkeypatch):
    only_on_linux("a sweep")
    monkeypatch.setattr(sys, "platform", "darwin")
    assert "a sweep needs Linux: found the system 'darwin'" in refused(only_on_linux, "a sweep")


def test_windows_is_refused_with_the_way_out():
    code = "import sys; sys.platform = 'win32'; import neuro"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(
        "ImportError: neuro runs on Linux and macOS: on Windows install it in WSL 2"
    )
