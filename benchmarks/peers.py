"""Time NEST, Brian2 and neuro with the same networks, one after the other, and print the ratios.

`python benchmarks/peers.py --scripts FOLDER --python PEERS_PYTHON`: FOLDER holds bench_nest.py and bench_brian2.py,
PEERS_PYTHON has nest-simulator and brian2 installed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

CASES = ("brunel", "cuba", "stdp", "loop")
PEERS = {
    "NEST": ("bench_nest.py",),
    "Brian2": ("bench_brian2.py", "--target", "cpp"),
    "Brian2 loop": ("bench_brian2.py", "--target", "cython"),
}
OURS = Path(__file__).resolve().with_name("run.py")


def main() -> int:
    """Print a table and one JSON line for each run; 0 also where the scripts are missing, which is said."""
    found = asked(__doc__, PEERS.values())
    if found is None:
        return 0
    scripts, python = found
    rows = [row for case in CASES for row in compared(case, scripts, python)]
    print(f"\n{'case':<8}{'simulator':<10}{'core s / bio s':>18}{'neuro is faster by':>20}")
    for case, name, cost, ratio in rows:
        print(f"{case:<8}{name:<10}{cost:>18.4g}{ratio:>20}")
    return 0


def asked(doc: str | None, peers: Iterable[tuple[str, ...]]) -> tuple[Path, str] | None:
    """The folder of the peers' scripts and their Python; None, and the reason told, where a script is missing."""
    options = argparse.ArgumentParser(description=doc)
    options.add_argument("--scripts", type=Path, required=True)
    options.add_argument("--python", default=sys.executable)
    words = options.parse_args()
    missing = [script for script, *_ in peers if not (words.scripts / script).is_file()]
    if missing:
        print(f"skipped: {words.scripts / missing[0]} is not there; the peers' scripts come with the reference data")
        return None
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; run alone for figures worth keeping", flush=True)
    return words.scripts.resolve(), os.path.abspath(words.python)


def compared(case: str, scripts: Path, peers_python: str) -> list[tuple[str, str, float, str]]:
    """One case on all: its name, the simulator, seconds of one core a biological second and the ratio to ours."""
    ours = timed([sys.executable, str(OURS), case])
    if ours is None:
        return []
    rows = [(case, "neuro", cost(ours, ours)[0], "")]
    brian = "Brian2 loop" if case == "loop" else "Brian2"
    for name in ("NEST", brian):
        script, *more = PEERS[name]
        theirs = timed([peers_python, str(scripts / script), case, *more])
        if theirs is not None:
            spent, base = cost(theirs, ours)
            rows.append((case, name.split()[0], spent, f"{spent / base:.1f}"))
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
