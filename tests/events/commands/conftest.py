import sys

import numpy as np
import pytest

from event_commands import root
from neuro.cli.mistakes import telling
from neuro.events import Events, save


@pytest.fixture
def run(monkeypatch, capfd, tmp_path):
    """Run some words behind `neuro events`; return exit status, output and error."""
    monkeypatch.chdir(tmp_path)

    def words(*given, group=("events",)):
        monkeypatch.setattr(sys, "argv", ["neuro", *group, *map(str, given)])
        capfd.readouterr()
        try:
            with telling():
                status = root()(standalone_mode=False, prog_name="neuro") or 0
        except SystemExit as leaving:
            status = leaving.code
        return status, *capfd.readouterr()

    return words


@pytest.fixture
def recording(tmp_path):
    """100 events, one each ms, in `in.bin`."""
    k = np.arange(100)
    events = Events(1000 * k, k % 34, k % 30, k % 2, (34, 34))
    save(events, tmp_path / "in.bin")
    return events


@pytest.fixture
def data(tmp_path):
    for k, digit in enumerate((3, 3, 7, 3, 7, 3)):
        path = tmp_path / "set" / ("Test" if k > 4 else "Train") / str(digit) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes([1, 2, 128, 0, k]))
    return tmp_path / "set"
