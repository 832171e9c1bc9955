"""Counts what a reader has to decode: `python .ci/plain.py [--list] [FOLDER...]`.

- opening: a docstring that opens with a relative or indefinite word ("What ...", "Whether ...", "Those ...")
- pronoun: a sentence of a docstring or comment whose subject is "it", "they", "these", "those", "that", "such", or
  that has two or more of such words
- name: an identifier that is a bare participle or adverb ("kept", "given", "early"), where a noun would say more
- short: a private function of one statement that has one caller, in the same file

Names that are terms here are not counted in the files that `.ci/plain.toml` lists, with a reason for each.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

TERMS = Path(__file__).with_suffix(".toml")
"""The allow-list."""

FOLDERS = ("neuro", "backends", "models", "apps")
KINDS = ("opening", "pronoun", "name", "short")
OPENING = re.compile(
    r"(What|Who|Whom|Whose|Whether|How|Where|When|Which|As what|Of (?!the\b)|That |Those |These |Likewise|If |"
    r"In what|By what|From what|To what|For what)\b"
)
SUBJECT = re.compile(r"(It|They|These|Those|That|This one|Such|One)\b")
PRONOUN = re.compile(
    r"\b(it|its|they|them|their|these|those|that of|such|one another|the former|the latter|ones?)\b", re.IGNORECASE
)
PARTICIPLE = re.compile(
    r"_*(found|said|told|asked|given|kept|seen|held|heard|taken|wanted|begun|gone|shown|noted|left|meant|spent|fed|sent|"
    r"known|listed|drawn|named|called|placed|learnt|tried|done|due|ahead|apart|beside|together|late|early|alike|ready|"
    r"still|again|elsewhere|nobody|nothing|none_left)_*"
)
COMMENT = re.compile(r"(?:^|\s)# (?!mypy|type:|noqa|ruff)(.{12,})")
Hit = tuple[str, int, str]
"""Kind, line and text of a place."""


@dataclass(frozen=True)
class Term:
    """A name that is allowed in the files that one of the patterns matches."""

    name: str
    reason: str
    files: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (PARTICIPLE.fullmatch(self.name) and self.reason.strip() and self.files):
            raise ValueError(f"term '{self.name}': expected a name that is counted, a reason, and files")

    def allows(self, file: str, name: str) -> bool:
        """Return whether a name in a file, a path from the project's root, is this term."""
        return name.strip("_") == self.name and any(fnmatch(file, pattern) for pattern in self.files)


def terms(text: str) -> tuple[Term, ...]:
    """Return the terms of an allow-list.

    Raises:
        TypeError: an entry lacks a word, or has another one.
        ValueError: a name is not counted anyway, or has no reason or no files.
    """
    return tuple(Term(**entry | {"files": tuple(entry.get("files", ()))}) for entry in tomllib.loads(text)["term"])


def hits(source: str, file: str = "", allowed: tuple[Term, ...] = ()) -> Iterator[Hit]:
    """Yield the places of a source file. `file` is its path from the project's root, which the terms are matched to."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _of_docstring(ast.get_docstring(node) or "", getattr(node, "lineno", 1))
        for name, line in _names(node):
            if PARTICIPLE.fullmatch(name) and not any(term.allows(file, name) for term in allowed):
                yield "name", line, name
    calls = Counter(_called(node) for node in nodes if isinstance(node, ast.Call))
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _is_short(node) and calls[node.name] == 1:
            yield "short", node.lineno, f"def {node.name}"
    for line, text in enumerate(source.splitlines(), 1):
        if (comment := COMMENT.search(text)) and _needs_decoding(comment[1]):
            yield "pronoun", line, comment[1]


def counts(folders: tuple[str, ...] = FOLDERS) -> Counter[str]:
    """Return the number of places of each kind in all files of some folders, in the project's root."""
    return Counter(kind for _, (kind, _, _) in _places(folders, terms(TERMS.read_text("utf-8"))))


def _places(folders: tuple[str, ...], allowed: tuple[Term, ...] = ()) -> Iterator[tuple[Path, Hit]]:
    for folder in folders:
        for file in sorted(Path(folder).rglob("*.py")):
            yield from ((file, hit) for hit in hits(file.read_text("utf-8"), file.as_posix(), allowed))


def _of_docstring(text: str, line: int) -> Iterator[Hit]:
    lead = re.sub(r"\s+", " ", re.split(r"\n\n(?:Args|Attributes):", text)[0]).strip()
    sentences = [one for one in re.split(r"(?<=[.:;!?])\s+", lead) if one]
    if sentences and OPENING.match(sentences[0]):
        yield "opening", line, sentences[0]
    yield from (("pronoun", line, one) for one in sentences if _needs_decoding(one))


def _needs_decoding(sentence: str) -> bool:
    return bool(SUBJECT.match(sentence)) or len(PRONOUN.findall(sentence)) >= 2


def _names(node: ast.AST) -> Iterator[tuple[str, int]]:
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id, node.lineno
    elif isinstance(node, ast.arg):
        yield node.arg, node.lineno
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name, node.lineno


def _called(call: ast.Call) -> str:
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _is_short(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    if not function.name.startswith("_") or function.name.startswith("__") or function.decorator_list:
        return False
    body = [one for one in function.body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
    return len(body) == 1 and (body[0].end_lineno or 0) - body[0].lineno <= 1


def main() -> None:
    """Print the counts, each place with `--list`, and the terms that no name of all folders is."""
    folders = tuple(word for word in sys.argv[1:] if word != "--list") or FOLDERS
    allowed = terms(TERMS.read_text("utf-8"))
    places = list(_places(folders, allowed))
    if "--list" in sys.argv:
        for file, (kind, line, text) in places:
            print(f"{kind:8}{file}:{line} {text[:140]}")
    if folders == FOLDERS:
        names = {(file.as_posix(), name) for file, (kind, _, name) in _places(folders) if kind == "name"}
        for term in allowed:
            if not any(term.allows(*place) for place in names):
                print(f"unused: the term '{term.name}' ({term.reason})")
    total = Counter(kind for _, (kind, _, _) in places)
    print(", ".join(f"{kind} {total[kind]}" for kind in KINDS))


if __name__ == "__main__":
    main()
