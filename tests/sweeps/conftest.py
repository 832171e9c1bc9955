"""Modules of functions that sweeps run, and file systems that are full or read-only."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent


@pytest.fixture
def modules(monkeypatch):
    """What gives a module of this folder, which other processes find; all are forgotten afterwards."""
    monkeypatch.syspath_prepend(FOLDER)
    yield __import__
    for name in ("my_runs", "my_searches"):
        sys.modules.pop(name, None)


@pytest.fixture
def runs(modules):
    return modules("my_runs")


@pytest.fixture
def searches(modules):
    return modules("my_searches")


@pytest.fixture
def mounted(tmp_path):
    """Mount a file system of its own at the folder of the test, or mount it again with other options."""

    def mount(options):
        if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", tmp_path]).returncode:
            pytest.skip("no file system can be mounted here")
        return tmp_path

    yield mount
    subprocess.run(["umount", "-l", tmp_path], capture_output=True, check=False)


@pytest.fixture
def notes(tmp_path):
    """A folder in which runs note that they were begun; gives how often each was."""
    folder = tmp_path / "notes"
    folder.mkdir()

    def begun():
        return {path.name: len(path.read_text().split()) for path in folder.iterdir()}

    begun.path = str(folder)
    return begun
