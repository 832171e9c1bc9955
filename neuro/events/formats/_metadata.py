"""What a recording says of itself, as text in a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

OWN = ("format", "t0")
"""Of the file itself, not of the recording; found anew when it is read."""


def as_json(metadata: Mapping[str, Any]) -> str:
    """Metadata as JSON; what JSON cannot say is written as its text."""
    return json.dumps({str(key): value for key, value in metadata.items() if key not in OWN}, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)


def from_json(text: str) -> dict[str, Any]:
    """The metadata that `as_json` wrote.

    Raises:
        ValueError: the text is none.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise ValueError("its metadata are no JSON object")
    return {key: value for key, value in found.items() if key not in OWN}
