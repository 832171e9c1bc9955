"""Tables and texts of a test that stand in the YAML file of its name beside it."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import neuro


def beside(test: str, *names: str) -> list[Any]:
    """Some of the entries of that file; `test` is the `__file__` of the test."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # that of C is ten times as fast
    entries = yaml.load(Path(test).with_suffix(".yaml").read_text("utf-8"), Loader=loader)
    return [entries[name] for name in names]


def evaluated(test: str, name: str, scope: Mapping[str, Any]) -> Any:
    """An entry whose values are expressions of Python, by names of a scope."""
    (entry,) = beside(test, name)
    known = {"neuro": neuro, "np": np, "math": math, "partial": partial, **scope}
    if isinstance(entry, dict):
        return {key: eval(value, known) for key, value in entry.items()}
    return [eval(value, known) for value in entry]
