"""One root of errors: whatever this project raises for a mistake of its user is a `neuro.ModelError`."""

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path

from beside import beside

ROOT = Path(__file__).parent.parent
(WHERE,) = beside(__file__, "INSIDE")
INSIDE = {(name, path): who for path, names in WHERE.items() for name, who in names.items()}
"""What may be raised beside `ModelError`, where, and who hears it."""


@cache
def nodes() -> dict[str, list[ast.AST]]:
    """What each file defines and raises."""
    paths = [path for folder in ("neuro", "apps") for path in sorted((ROOT / folder).rglob("*.py"))]
    kinds = ast.ClassDef | ast.FunctionDef | ast.Raise
    walked = {str(path.relative_to(ROOT)): ast.walk(ast.parse(path.read_text())) for path in paths}
    return {file: [node for node in found if isinstance(node, kinds)] for file, found in walked.items()}


def last(node: ast.expr | None) -> str:
    """The last word of `a.b.C`, of `C(...)` and of an annotation."""
    if isinstance(node, ast.Call):
        return last(node.func)
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


@cache
def helpers() -> dict[str, str]:
    """Functions, and the class of what they return; of two of one name the one that returns an error."""
    functions = [node for node in chain(*nodes().values()) if isinstance(node, ast.FunctionDef)]
    returned = [(node.name, last(node.returns)) for node in functions if last(node.returns)[:1].isupper()]
    return dict(sorted(returned, key=lambda function: function[1].endswith("Error")))


@cache
def ours() -> set[str]:
    """`ModelError`, its subclasses, and the functions that return one of them."""
    classes = [node for node in chain(*nodes().values()) if isinstance(node, ast.ClassDef)]
    known, before = {"ModelError"}, 0
    while len(known) > before:
        before = len(known)
        known |= {one.name for one in classes if any(last(base) in known for base in one.bases)}
    return known | {name for name, returns in helpers().items() if returns in known}


def raised(walked: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """Line and name of what is raised anew; an error that was caught, or kept, is raised by its variable."""
    for node in walked:
        if isinstance(node, ast.Raise) and node.exc is not None:
            name = last(node.exc)
            if isinstance(node.exc, ast.Call) or name[:1].isupper():
                yield node.lineno, name if name in ours() else helpers().get(name, name)


def place(name: str, file: str) -> tuple[str, str] | None:
    """The line of `INSIDE` that allows it."""
    return next((entry for entry in INSIDE if entry[0] == name and file.startswith(entry[1])), None)


def test_mistakes_of_users_are_model_errors():
    """Where another class is raised, a line in `INSIDE` says who hears it, and each of these lines is needed."""
    others = [(file, *each) for file, found in nodes().items() for each in raised(found) if each[1] not in ours()]
    assert [f"{file}:{line}: {name}" for file, line, name in others if place(name, file) is None] == []
    assert {place(name, file) for file, _, name in others} == set(INSIDE)


def test_the_rule_finds_what_it_should():
    """The walk sees calls, classes and helpers, and does not take a variable for a class."""
    lines = ["raise ValueError('a')", "raise KeyError", "raise e", "raise unknown('x')", "raise a.Missing()", "raise"]
    text = "\n ".join(("def f(e):", *lines))
    found = list(raised(ast.walk(ast.parse(text))))
    assert found == [(2, "ValueError"), (3, "KeyError"), (5, "unknown"), (6, "Missing")]
    assert {"EventFileError", "FilterError", "Unwritable", "unknown", "mistake", "wrong"} <= ours()
    assert not ours() & {"ValueError", "Damage", "Malformed"}
