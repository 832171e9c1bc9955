"""With every index checked, a kernel that leaves its array is found, whichever way it leaves."""

import os
import subprocess
import sys

import pytest

CHECKED = "from neuro.kernels.checked import check_bounds; check_bounds()\n"
ARRAY = """
import numpy as np
from neuro.kernels.jit import kernel

@kernel
def item(values, i):
    return values[i]

memory = np.arange(4)
print(item(memory[:3], {}))
"""
VIEW = """
import numpy as np
from neuro.kernels.jit import kernel
from neuro_event.views import NET_FIELDS, net_of

@kernel
def item(view, i):
    return net_of(view).events[i]

memory, view = np.arange(4), np.zeros((len(NET_FIELDS), 4), dtype=np.int64)
view[NET_FIELDS.index("events"), :2] = memory.ctypes.data, 3
print(item(view, {}))
"""


@pytest.mark.parametrize("code", [ARRAY, VIEW], ids=["array", "view by address"])
@pytest.mark.parametrize("index", ["3", "-1", "np.uint64(2**63)"])
def test_an_index_outside_is_found(code, index, tmp_path):
    assert run(CHECKED + code.format(index), tmp_path).stderr.endswith("IndexError: index is out of bounds\n")


def test_what_is_checked_and_what_is_not_are_kept_apart(tmp_path):
    """The machine code of one does not serve the other."""
    for _ in range(2):
        assert run(VIEW.format(3), tmp_path).stdout == "3\n"
        assert run(CHECKED + VIEW.format(3), tmp_path).returncode == 1
        assert run(CHECKED + VIEW.format(2), tmp_path).stdout == "2\n"


def run(code, folder):
    (folder / "code.py").write_text(code)
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, str(folder / "code.py")], env=environment, capture_output=True, text=True, check=False
    )
