"""A worker that packs samples and is killed at number 3: once, or each time that it comes to it."""

import os
import signal
from pathlib import Path

from neuro.events.dataset._store import pack


def start(job):
    """As `neuro.events.dataset._store.start_worker`; the environment tells when, and a file that marks it."""
    when, mark = os.environ["DIES"].split(":", 1)

    def work(numbers, attempt, tell):
        if numbers[0] == 3 and (when == "always" or not Path(mark).exists()):
            Path(mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return pack(job, numbers)

    return work
