"""Fixtures for all tests."""

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Data and reference traces beside the repository."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    return SHARED
