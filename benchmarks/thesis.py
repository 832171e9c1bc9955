"""Compare this project with the thesis, row by row: `python benchmarks/thesis.py [--full] [ROW...]`.

The rows are in docs/reference/thesis.yaml. The field `run` of a row is a command or a list of commands, whose last
printed number (or last match of `find`) must lie in `range`. The field `test` is a test that must pass. `$TMP` is a
folder for the row, and `$ROOT` is the folder of the project. Without `--full` only rows marked `quick` are checked. A
row is skipped if its file of ../shared/data is missing. The exit status is 1 if a number is out of its range. `--page`
writes docs/reference/thesis.md and the page of each chapter.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
LEDGER = ROOT / "docs" / "reference" / "thesis.yaml"
PAGE = LEDGER.with_suffix(".md")
DATA = ROOT.parent / "shared" / "data"
VERDICTS = ("as printed", "corrected", "better", "deviates", "not built", "background")
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
PYTEST = "python -m pytest -q -rs -p no:benchmark -p no:xdist -p no:cacheprovider -m 'slow or not slow'"
HEADS = ("row", "thesis", "ours", "range", "verdict")
WIDTHS = (28, 26, 14, 20)

Row = dict[str, Any]


def rows() -> list[Row]:
    """Return the rows of the ledger."""
    return [row for chapter in yaml.safe_load(LEDGER.read_text("utf-8"))["rows"].values() for row in chapter]


def commands(row: Row) -> list[str]:
    """Return the commands that check a row."""
    run = [f"{PYTEST} {row['test']}"] if "test" in row else row.get("run", [])
    return [run] if isinstance(run, str) else list(run)


def outcome(row: Row, printed: str) -> tuple[str, bool]:
    """Return the figure of a row from the output of its last command, and True if it is in its range."""
    if "test" in row:
        return ("passes", True) if re.search(r"\d passed", printed) else ("no test passed", False)
    matches = re.findall(row.get("find", NUMBER), printed)
    low, high = row["range"]
    return (matches[-1], low <= float(matches[-1]) <= high) if matches else ("no number", False)


def check(row: Row) -> tuple[str, bool]:
    """Return the measured figure of a row, and True if it is in its range."""
    if absent := [name for name in row.get("needs", []) if not (DATA / name).exists()]:
        return f"skipped: ../shared/data/{absent[0]} is missing", True
    done = ran(*commands(row))
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip() or "nothing printed").splitlines()[-1]
        return f"fails: {last[:100]}", False
    return outcome(row, done.stdout)


@cache
def ran(*lines: str) -> subprocess.CompletedProcess[str]:
    """Run commands in turn until one fails, and return the last one that ran. Rows may share commands."""
    env = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as folder:
        for command in lines:
            words = [word.replace("$TMP", folder).replace("$ROOT", str(ROOT)) for word in shlex.split(command)]
            done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True)
            if done.returncode:
                break
    return done


def compare(chosen: Sequence[Row]) -> int:
    """Check rows and print the table. Return the number of rows out of their range."""
    left, skipped = [], 0
    print(f"{'':>9}", *line(HEADS))
    for k, row in enumerate(chosen, 1):
        measured, right = check(row)
        span = "passes" if "test" in row else "{} to {}".format(*row["range"])
        cells = (row["name"], row.get("thesis", ""), measured, span, row["verdict"])
        print(f"{k:>3}/{len(chosen)}", " " if right else "!", *line(cells), flush=True)
        left += [] if right else [row["name"]]
        skipped += int(measured.startswith("skipped"))
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{len(chosen)} rows, {skipped} skipped, {spent.ru_utime + spent.ru_stime:.0f} s of the processor")
    print(
        f"{len(left)} left their range: {', '.join(left)}"
        if left
        else "all others are in their range"
        if skipped
        else "all are in their range"
    )
    return len(left)


def line(cells: Iterable[str]) -> list[str]:
    """Return the cells of a line of the table, padded to their widths, except the last cell."""
    *fixed, last = map(str, cells)
    return [*(f"{cell[: width - 1]:<{width}}" for cell, width in zip(fixed, WIDTHS, strict=True)), last]


def pages() -> dict[Path, str]:
    """Return the page of the whole ledger and the page of each chapter, by file."""
    ledger = yaml.safe_load(LEDGER.read_text("utf-8"))
    quick, texts, lines = sum(bool(row.get("quick")) for row in rows()), {}, [ledger["head"]]
    lines += [f"The ledger has {len(rows())} rows: {verdicts_of(rows())}. {quick} are quick.\n"]
    lines += ["| chapter | rows | verdicts |", "| --- | ---: | --- |"]
    for chapter, content in ledger["rows"].items():
        file = PAGE.with_suffix("") / ("-".join(re.findall(r"\w+", chapter.lower())) + ".md")
        lines.append(f"| [{chapter}](thesis/{file.name}) | {len(content)} | {verdicts_of(content)} |")
        heads = [
            "| lines | the thesis | its figure | ours | verdict | checked by |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        texts[file] = "\n".join([f"# The thesis: {chapter}\n", *heads, *map(cells_of, content)]) + "\n"
    toctree = ["\n```{toctree}", ":hidden:", "", *(f"thesis/{file.stem}" for file in texts), "```\n"]
    return {PAGE: "\n".join([*lines, *toctree]), **texts}


def verdicts_of(content: Sequence[Row]) -> str:
    """Return the numbers of rows by verdict as text."""
    counted = Counter(row["verdict"] for row in content)
    return ", ".join(f"{counted[verdict]} {verdict}" for verdict in VERDICTS if counted[verdict])


def cells_of(row: Row) -> str:
    """Return a row as a line of the page."""
    verdict = f"**{row['verdict']}**" + (f": {row['why']}" if "why" in row else "")
    checked = [row["test"]] if "test" in row else commands(row)
    checks = "; ".join("code" if one.startswith("python -c") else f"`{' '.join(one.split())}`" for one in checked)
    spans = f" in {row['range'][0]} to {row['range'][1]}" if "range" in row else ""
    needs = f" (needs {', '.join(row['needs'])})" if "needs" in row else ""
    cells = (row["lines"], f"{row['name']}: {row['says']}", row.get("thesis", ""), row.get("ours", ""), verdict)
    cells += (("quick: " if row.get("quick") else "") + checks + spans + needs,)
    return f"| {' | '.join(' '.join(str(cell).split()).replace('|', '/') for cell in cells)} |"


def main() -> int:
    """Check the rows or write the pages."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("names", nargs="*", metavar="ROW", help="only these, quick or not")
    options.add_argument("--full", action="store_true", help="all rows that have a check")
    options.add_argument("--page", action="store_true", help="write the pages and check nothing")
    asked = options.parse_args()
    if asked.page:
        for file, text in pages().items():
            file.write_text(text, "utf-8")
        return 0
    every = {row["name"]: row for row in rows()}
    if unknown := [name for name in asked.names if name not in every]:
        options.error(f"there is no row {unknown[0]}")
    chosen = [every[name] for name in asked.names] or [row for row in every.values() if asked.full or row.get("quick")]
    return int(compare([row for row in chosen if commands(row)]) > 0)


if __name__ == "__main__":
    sys.exit(main())
