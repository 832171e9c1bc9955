"""Prints lines of code by room, and their change: `python .ci/code_lines.py [REVISION]`.

Lines of code are those with a token of Python that is no comment and no docstring. Without a revision the change is
that since the last commit that is a day older than the present one.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tarfile
import tokenize
from collections import Counter
from collections.abc import Iterator

ROOMS = ("neuro", "backends", "models", "apps")
"""Folders whose rooms are their subfolders; all others are rooms of their own."""
_EMPTY = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def _blocks(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all statements in it; `ast.walk` also yields the expressions, ten times as many nodes."""
    yield node
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        for statement in getattr(node, field, ()):
            yield from _blocks(statement)


def code_lines(source: str) -> int:
    """Lines without blanks, comments and docstrings."""
    docs: set[int] = set()
    for node in _blocks(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            for each in node.body:
                if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
                    docs.update(range(each.lineno, (each.end_lineno or each.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _EMPTY:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docs)


def counted(revision: str) -> tuple[Counter[str], Counter[str]]:
    """Lines of code and files by room in a revision."""
    lines: Counter[str] = Counter()
    files: Counter[str] = Counter()
    packed = subprocess.run(["git", "archive", revision], capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        for member in archive:
            parts = member.name.split("/")
            content = archive.extractfile(member) if member.name.endswith(".py") else None
            if content is not None:
                room = "/".join(parts[:2]) if parts[0] in ROOMS and len(parts) > 2 else parts[0]
                lines[room] += code_lines(content.read().decode())
                files[room] += 1
    return lines, files


def git(*words: str) -> str:
    """What git prints."""
    return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Print the table."""
    day_before = f"--before={int(git('log', '-1', '--format=%ct')) - 86_400}"
    base = sys.argv[1] if len(sys.argv) > 1 else git("rev-list", "-1", day_before, "HEAD")
    lines, files = counted("HEAD")
    was, had = counted(base) if base else (lines, files)
    source = [room for room in lines.keys() | was.keys() if room.split("/")[0] in ROOMS]
    for counter in (lines, files, was, had):
        counter["all of these"] = sum(counter[room] for room in source)
    print(f"{'lines of code':26}{'lines':>8}{'change':>8}{'files':>7}{'change':>8}   since {base[:8] or '-'}")
    rest = sorted((lines.keys() | was.keys()) - set(source) - {"all of these"})
    for room in [*sorted(source), "all of these", *rest]:
        changes = (lines[room] - was[room], files[room] - had[room])
        print(f"{room:26}{lines[room]:8,}{changes[0]:+8,}{files[room]:7,}{changes[1]:+8,}")


if __name__ == "__main__":
    main()
