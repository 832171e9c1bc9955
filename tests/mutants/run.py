"""Plants faults, one at a time, and reports which of them the tests find.

    python tests/mutants/run.py [--jobs 2] [--only NAME...] [--sets third] [--clean]

Each fault of a set (`SET.yaml`) names the text that it replaces and the test files that must fail with it. The text is
looked for in the named file, then in all sources, so that a fault outlives a move of its code. A fault is *found* if a
test fails, *missed* if all pass or if they do not end in time, *broken* if its text is not there or no test runs.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import yaml

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("neuro", "backends", "models", "apps")
SUFFIXES = (".py", ".html", ".js", ".css")
LIMIT_S = 600


@dataclass(frozen=True)
class Fault:
    """One planted fault; `fault` says what a user would suffer."""

    name: str
    room: str
    file: str
    fault: str
    old: str
    new: str
    tests: list[str]


@dataclass(frozen=True)
class Outcome:
    """What the tests made of a fault: "found", "missed" or "broken"."""

    fault: Fault
    verdict: str
    by: str
    seconds: float


class Copy:
    """A copy of the tracked files, in which faults are planted; its compiled kernels are kept between them."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "neuro"
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in listed.splitlines():
            if (ROOT / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, self.root / name)
        if (ROOT.parent / "shared").exists():
            (folder / "shared").symlink_to(ROOT.parent / "shared")
        paths = [str(self.root / name) for name in ("", *SOURCES[1:])]
        # A fault changes a file within a second, which the clock of bytecode cannot see.
        self.env = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
        self.env["XDG_CACHE_HOME"] = str(folder / "cache")

    def place(self, fault: Fault) -> Path | None:
        """The file that has the text of a fault, once; None if there is none."""
        named = self.root / fault.file
        if named.is_file() and named.read_text("utf-8").count(fault.old) == 1:
            return named
        found = [
            path
            for source in SOURCES
            for path in sorted((self.root / source).rglob("*"))
            if path.suffix in SUFFIXES and fault.old in path.read_text("utf-8")
        ]
        return found[0] if len(found) == 1 and found[0].read_text("utf-8").count(fault.old) == 1 else None

    def test(self, files: list[str]) -> tuple[int, str]:
        """The exit status of pytest, 0 also where it does not end in time, and what it printed."""
        words = [
            "-m",
            "slow or not slow",
            "-x",
            "-q",
            "-p",
            "no:xdist",
            "-p",
            "no:benchmark",
            "-p",
            "no:cacheprovider",
            "--hypothesis-seed=0",
        ]
        command = [sys.executable, "-m", "pytest", *words, *files]
        try:
            done = subprocess.run(command, cwd=self.root, env=self.env, capture_output=True, text=True, timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            return 0, f"no end in {LIMIT_S} s"
        return done.returncode, done.stdout

    def try_out(self, fault: Fault) -> Outcome:
        """Plant a fault, run its tests, and take it back."""
        began, path = time.monotonic(), self.place(fault)
        if path is None:
            return Outcome(fault, "broken", "its text is not in the sources, or more than once", 0.0)
        was = path.read_text("utf-8")
        path.write_text(was.replace(fault.old, fault.new), "utf-8")
        try:
            status, printed = self.test(fault.tests)
        finally:
            path.write_text(was, "utf-8")
        seconds = time.monotonic() - began
        if status == 1:
            by = re.search(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE)
            return Outcome(fault, "found", by[1] if by else "", seconds)
        if status == 0:
            return Outcome(fault, "missed", "", seconds)
        return Outcome(fault, "broken", printed.strip().splitlines()[-1] if printed.strip() else "", seconds)


def faults(sets: list[str], only: list[str]) -> list[Fault]:
    """The faults of some sets, all or those of some names."""
    found = [
        Fault(**words)
        for name in sets
        for words in yaml.safe_load((Path(__file__).parent / f"{name}.yaml").read_text("utf-8"))
    ]
    return [fault for fault in found if not only or fault.name in only]


def tried(chosen: list[Fault], jobs: int) -> Iterator[Outcome]:
    """The outcome of each fault, in their order."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        free: SimpleQueue[Copy] = SimpleQueue()
        for job in range(jobs):
            free.put(Copy(Path(folder) / str(job)))

        def one(fault: Fault) -> Outcome:
            copy = free.get()
            try:
                return copy.try_out(fault)
            finally:
                free.put(copy)

        yield from pool.map(one, chosen)


def main() -> int:
    """Try the faults, and print a line for each and a table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = sorted(path.stem for path in Path(__file__).parent.glob("*.yaml"))
    options.add_argument("--jobs", type=int, default=2, help="faults at once")
    options.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these faults")
    options.add_argument("--sets", nargs="+", default=known, choices=known, help="of these files")
    options.add_argument("--clean", action="store_true", help="run the tests without a fault: all must pass")
    asked = options.parse_args()
    chosen = faults(asked.sets, asked.only)
    if asked.clean:
        with tempfile.TemporaryDirectory() as folder:
            status, printed = Copy(Path(folder)).test(sorted({test for fault in chosen for test in fault.tests}))
        print(printed.strip().splitlines()[-1])
        return status
    counts: Counter[tuple[str, str]] = Counter()
    for outcome in tried(chosen, asked.jobs):
        counts[outcome.fault.room, outcome.verdict] += 1
        line = f"{outcome.verdict:7} {outcome.fault.room:9} {outcome.fault.name:45} {outcome.seconds:5.0f} s"
        print(f"{line}  {outcome.by}", flush=True)
    for room in sorted({room for room, _ in counts}):
        print(
            f"{room:10}", *(f"{counts[room, verdict]} {verdict}" for verdict in ("found", "missed", "broken")), sep="  "
        )
    return int(any(verdict != "found" for _, verdict in counts))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("ended")
