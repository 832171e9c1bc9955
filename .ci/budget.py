"""Holds the project to `.ci/budget.toml`.

    python .ci/budget.py check          code lines by room, words of the docs, counts of plain.py
    python .ci/budget.py run COMMAND    run a command and compare its processor time, of all its processes
    python .ci/budget.py show           the present figures, in the form of the file

A figure above its line fails. A line is raised in the commit that needs it, with the reason in the message.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SLACK = 1.15
"""Of the processor time of one command between runs on one machine."""
ROUNDS = 2_000_000


def main() -> int:
    """Exit status 0 within the budget, 1 above it; else the status of the command that was run."""
    match sys.argv[1:]:
        case ["check"]:
            return _report(_above(_budget(), figures()))
        case ["run", *command] if command:
            return run(command)
        case ["show"]:
            for table, lines in figures().items():
                print(f"[{table}]", *(f'"{name}" = {value}' for name, value in sorted(lines.items())), "", sep="\n")
            return 0
    print(__doc__, file=sys.stderr)
    return 2


def figures() -> dict[str, dict[str, int]]:
    """The present figures by table and line of the budget."""
    from code_lines import ROOMS, code_lines
    from plain import KINDS, counts

    lines: Counter[str] = Counter()
    for name in _tracked(".py"):
        parts = name.split("/")
        room = "/".join(parts[:2]) if parts[0] in ROOMS and len(parts) > 2 else parts[0]
        lines[room] += code_lines((ROOT / name).read_text("utf-8"))
    words = sum(len((ROOT / name).read_text("utf-8").split()) for name in _tracked(".md"))
    plain = counts()
    return {"code_lines": dict(lines), "docs": {"words": words}, "plain": {kind: plain[kind] for kind in KINDS}}


def run(command: list[str]) -> int:
    """Run a command; compare the processor time of all its processes, in seconds of the budget's machine."""
    budget = _budget()["make_test"]
    round_s = _round_s()
    began = time.monotonic()
    status = subprocess.run(command).returncode
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = usage.ru_utime + usage.ru_stime
    # A slower machine, or one whose cores are shared, needs longer for each instruction; a faster one gets no less.
    scale = max(1.0, (round_s + _round_s()) / 2 / budget["round_s"])
    limit_s = budget["processor_s"] * scale * SLACK
    print(
        f"{spent_s:.0f} s of the processor in {time.monotonic() - began:.0f} s on the clock; budget "
        f"{budget['processor_s']} s, here at most {limit_s:.0f} s ({scale:.2f} times slower than the budget's machine)"
    )
    if status == 0 and spent_s > limit_s:
        print("above .ci/budget.toml: make_test.processor_s", file=sys.stderr)
        return 1
    return status


def _budget() -> dict[str, dict[str, float]]:
    return tomllib.loads((ROOT / ".ci" / "budget.toml").read_text("utf-8"))


def _above(budget: dict[str, dict[str, float]], present: dict[str, dict[str, int]]) -> list[str]:
    return [
        f"{table}.{name}: {value:,}, budget {budget[table].get(name, 0):,}"
        for table, lines in present.items()
        for name, value in sorted(lines.items())
        if value > budget[table].get(name, 0)
    ]


def _report(above: list[str]) -> int:
    for line in above:
        print(f"above .ci/budget.toml: {line}", file=sys.stderr)
    return int(bool(above))


def _tracked(suffix: str) -> list[str]:
    """The files of git with an ending, or those of the tree where there is no history."""
    listed = subprocess.run(["git", "ls-files", f"*{suffix}"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode == 0:
        return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]
    inside = (path.relative_to(ROOT) for path in ROOT.rglob(f"*{suffix}"))
    return [str(path) for path in inside if not path.parts[0].startswith(".venv")]


def _round_s() -> float:
    """The processor time of a fixed loop, the best of three, in s."""
    best = float("inf")
    for _ in range(3):
        began = time.process_time()
        total = 0
        for number in range(ROUNDS):
            total += number & 7
        best = min(best, time.process_time() - began)
    return best


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main())
