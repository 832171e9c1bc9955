"""A word where NEST takes the whole process down: no handler of ours runs then, so another process waits for it."""

from __future__ import annotations

import atexit
import subprocess
from functools import cache

TOLD = "error: the process that ran NEST ended without a word: NEST crashed, or it was killed"
_WAIT = 'trap "" INT TERM HUP; read -r word || echo "$0" >&2'


@cache
def watch() -> None:
    """Begin to watch this process; once is enough. A process that ends as it should says so."""
    try:
        watcher = subprocess.Popen(["/bin/sh", "-c", _WAIT, TOLD], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    except OSError:
        return
    atexit.register(watcher.communicate, b"well\n")
