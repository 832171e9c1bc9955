"""Whether `neuro check` reports the same mistakes where no message has any of its words."""

import zlib
from pathlib import Path

import pytest

from neuro.compiler.mistakes import mistakes
from neuro.core.errors import ModelError

PLAIN = ModelError.__init__


def same_if_reworded(text: str) -> None:
    """Report the mistakes of a description, then again with all sentences reworded."""
    found = places(text)
    assert found
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ModelError, "__init__", reworded)
        assert places(text) == found


def places(text: str) -> list[str]:
    Path("net.yaml").write_text(text)
    return [str(error.where) for error in mistakes("net.yaml", None, 0).mistakes]


def reworded(error: ModelError, message: str, *, hint: str = "", **more: object) -> None:
    PLAIN(error, digits(message), hint=digits(hint), **more)


def digits(text: str) -> str:
    return str(zlib.crc32(text.encode())) if text else ""
