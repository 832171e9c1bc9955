"""What long benchmarks share: recordings, results that are kept, and figures as tables have them."""

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
    """What a JSON file has; if it is not there, it is found now and written whole."""
    if not file.exists():
        unfinished = file.with_suffix(".part")
        unfinished.write_text(json.dumps(found()))
        unfinished.replace(file)
    return json.loads(file.read_text())


def spread(values: Any) -> str:
    """Mean and standard deviation."""
    return f"{np.mean(values):.2f}" + (f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else "")


def markdown(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table."""
    return "".join(f"| {' | '.join(map(str, row))} |\n" for row in (heads, ["---"] * len(heads), *rows))
