"""Fixtures for all tests."""

import signal
from importlib.util import find_spec
from pathlib import Path

import pytest

# Started in the background, all programs that the tests start would not hear Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def nest() -> None:
    """NEST, where there is one: its wheels are for Linux only."""
    if find_spec("nest") is None:
        pytest.skip("NEST is not installed: pip install nest-simulator")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Data and reference traces beside the repository."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    return SHARED
