"""A folder of its own for each test, and the message of a mistake."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import neuro
from neuro.compiler.mistakes import mistakes


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, so that messages name files without their folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def message(folder: Path) -> Callable[..., str]:
    """Load a text and return what its mistake is told as."""

    def of(text: str | bytes, params: Mapping[str, Any] | None = None) -> str:
        (folder / "net.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
        with pytest.raises(neuro.ModelError) as caught:
            neuro.load("net.yaml", params)
        return str(caught.value)

    return of


@pytest.fixture
def all_mistakes(folder: Path) -> Callable[[str], str]:
    """All that `neuro check` tells of a text."""

    def of(text: str) -> str:
        (folder / "net.yaml").write_text(text)
        return "\n".join(str(error) for error in mistakes("net.yaml", None, 0).mistakes)

    return of
