"""Time NEST, Brian2 and neuro with the same networks, one after the other, and print the ratios.

`python benchmarks/peers/compare.py [--python PEERS_PYTHON]`: PEERS_PYTHON has nest-simulator and brian2 installed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
CASES = ("brunel", "cuba", "stdp", "loop")
PEERS = {"NEST": "on_nest.py", "Brian2": "on_brian2.py"}
OURS = HERE.parent / "run.py"


def main() -> int:
    """Print a table and one JSON line for each run."""
    python = peers_python(__doc__)
    rows = [row for case in CASES for row in compared(case, python)]
    print(f"\n{'case':<8}{'simulator':<10}{'core s / bio s':>18}{'neuro is faster by':>20}")
    for case, name, cost, ratio in rows:
        print(f"{case:<8}{name:<10}{cost:>18.4g}{ratio:>20}")
    return 0


def peers_python(doc: str | None) -> str:
    """The Python in whose environment the peers are."""
    options = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--python", default=sys.executable)
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; run alone for figures worth keeping", flush=True)
    return os.path.abspath(options.parse_args().python)


def compared(case: str, python: str) -> list[tuple[str, str, float, str]]:
    """One case on all: its name, the simulator, seconds of one core a biological second and the ratio to ours."""
    ours = timed([sys.executable, str(OURS), case])
    if ours is None:
        return []
    rows = [(case, "neuro", cost(ours, ours)[0], "")]
    for name, script in PEERS.items():
        theirs = timed([python, str(HERE / script), case])
        if theirs is not None:
            seconds, base = cost(theirs, ours)
            rows.append((case, name, seconds, f"{seconds / base:.1f}"))
    return rows


def cost(figures: dict[str, Any], beside: dict[str, Any]) -> tuple[float, float]:
    """Of both, seconds of the processor if both tell them, which other work disturbs less; else of the clock."""
    known = "cpu_s_per_bio_s" in figures and "cpu_s_per_bio_s" in beside
    name = "cpu_s_per_bio_s" if known else "sim_s_per_bio_s"
    return float(figures[name]), float(beside[name])


def timed(command: list[str]) -> dict[str, Any] | None:
    """The JSON line that a script prints last, which is echoed; None, and the reason told, if it fails."""
    with tempfile.TemporaryDirectory() as folder:  # Brian2 leaves its C++ where it runs
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        reason = (done.stderr.strip().splitlines() or ["no output"])[-1]
        print(f"failed: {' '.join(command)}: {reason}", flush=True)
        return None
    print(lines[-1], flush=True)
    figures: dict[str, Any] = json.loads(lines[-1])
    return figures


if __name__ == "__main__":
    sys.exit(main())
