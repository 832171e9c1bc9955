"""Parts of long benchmarks: paths of recordings, results in files, and figures as text for tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
NMNIST = SHARED / "nmnist" / "nmnist_train1000_bin.zip"
POKER = SHARED / "poker_dvs" / "poker_dvs_shared_aedat2.zip"


def kept(file: Path, found: Callable[[], Any]) -> Any:
    """Return the content of a JSON file. If there is no file, call `found` and write its result to the file."""
    if not file.exists():
        unfinished = file.with_suffix(".part")
        unfinished.write_text(json.dumps(found()))
        unfinished.replace(file)
    return json.loads(file.read_text())


def spread(values: Any) -> str:
    """Return mean and standard deviation as text."""
    return f"{np.mean(values):.2f}" + (f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else "")


def markdown(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table."""
    return "".join(f"| {' | '.join(map(str, row))} |\n" for row in (heads, ["---"] * len(heads), *rows))
