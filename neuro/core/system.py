"""What differs between systems: the cores that a process may use, and parts that exist on Linux alone."""

from __future__ import annotations

import os
import sys

from neuro.core.errors import ModelError


def usable_cores() -> int:
    """How many cores this process may use; where the system does not say, all that there are."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def only_on_linux(what: str) -> None:
    """Refuse a part that needs interfaces of Linux.

    Args:
        what: the part, the subject of the message.

    Raises:
        ModelError: this is another system.
    """
    if sys.platform != "linux":
        raise ModelError(f"{what} needs Linux: found the system '{sys.platform}'")
