"""Fixtures for all tests."""

import signal
from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes depends on what else the machine does: a deadline fails tests of right code.
settings.register_profile("suite", deadline=None)
settings.load_profile("suite")

# Started in the background, all programs that the tests start would not hear Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Data and reference traces beside the repository."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    return SHARED
