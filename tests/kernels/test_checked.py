"""With every index checked, a kernel that leaves its array is found, whichever way it leaves."""

import os
import subprocess
import sys

CHECKED = "from neuro.kernels.numba_internals import check_bounds; check_bounds()\n"
ARRAY = """
import numpy as np
from neuro.kernels.jit import kernel

@kernel
def item(values, i):
    return values[i]

memory = np.arange(4)
look(lambda i: item(memory[:3], i))
"""
VIEW = """
import numpy as np
from neuro.kernels.jit import kernel
from neuro_event.loop.tables import NET_FIELDS, net_of

@kernel
def item(view, i):
    return net_of(view).events[i]

memory, view = np.arange(4), np.zeros((len(NET_FIELDS), 4), dtype=np.int64)
view[NET_FIELDS.index("events"), :2] = memory.ctypes.data, 3
look(lambda i: item(view, i))
"""


LOOK = """
def look(item):
    for index in (2, 3, -1, np.uint64(2**63)):
        try:
            print(item(index))
        except IndexError as error:
            print(error)
"""
OUTSIDE = "index is out of bounds\n"


def test_an_index_outside_of_an_array_is_found(tmp_path):
    """Beyond the end, below 0, and below 0 as a signed number."""
    assert run(CHECKED + LOOK + ARRAY, tmp_path) == "2\n" + 3 * OUTSIDE


def test_what_is_checked_and_what_is_not_are_kept_apart(tmp_path):
    """The machine code of one does not serve the other."""
    look = "def look(item):\n    print(item(np.uint64(3)))\n"
    assert run(look + VIEW, tmp_path) == "3\n"
    assert run(CHECKED + LOOK + VIEW, tmp_path) == "2\n" + 3 * OUTSIDE
    assert run(look + VIEW, tmp_path) == "3\n"


def run(code, folder):
    (folder / "code.py").write_text(code)
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(folder / "code.py")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout
