"""Tables and texts of a test that stand in the YAML file of its name beside it."""

from pathlib import Path
from typing import Any

import yaml


def beside(test: str, *names: str) -> list[Any]:
    """Some of the entries of that file; `test` is the `__file__` of the test."""
    entries = yaml.safe_load(Path(test).with_suffix(".yaml").read_text("utf-8"))
    return [entries[name] for name in names]
