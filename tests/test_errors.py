"""One root of errors: whatever this project raises for a mistake of its user is a `neuro.ModelError`."""

import ast
from collections.abc import Iterator
from pathlib import Path

from beside import beside

ROOT = Path(__file__).parent.parent
FILES = {
    str(path.relative_to(ROOT)): ast.parse(path.read_text())
    for folder in ("neuro", "apps")
    for path in sorted((ROOT / folder).rglob("*.py"))
}
(WHERE,) = beside(__file__, "INSIDE")
INSIDE = {(name, path): who for path, names in WHERE.items() for name, who in names.items()}
"""What may be raised beside `ModelError`, where, and who hears it."""


def last(node: ast.expr | None) -> str:
    """The last word of `a.b.C`, of `C(...)` and of an annotation."""
    if isinstance(node, ast.Call):
        return last(node.func)
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def roots() -> set[str]:
    """`ModelError`, its subclasses, and the functions that return one of them."""
    classes = [node for tree in FILES.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    known, before = {"ModelError"}, 0
    while len(known) > before:
        before = len(known)
        known |= {one.name for one in classes if any(last(base) in known for base in one.bases)}
    return known | {name for name, returns in HELPERS.items() if returns in known}


HELPERS = dict(
    sorted(
        (
            (node.name, last(node.returns))
            for tree in FILES.values()
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and last(node.returns)[:1].isupper()
        ),
        key=lambda function: function[1].endswith("Error"),
    )
)
"""Functions, and the class of what they return; of two of one name the one that returns an error."""
OURS = roots()


def raised(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of what is raised anew; an error that was caught, or kept, is raised by its variable."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None:
            name = last(node.exc)
            if isinstance(node.exc, ast.Call) or name[:1].isupper():
                yield node.lineno, name if name in OURS else HELPERS.get(name, name)


def place(name: str, file: str) -> tuple[str, str] | None:
    """The line of `INSIDE` that allows it."""
    return next((entry for entry in INSIDE if entry[0] == name and file.startswith(entry[1])), None)


def test_mistakes_of_users_are_model_errors():
    """Where another class is raised, a line in `INSIDE` says who hears it, and each of these lines is needed."""
    others = [(file, *each) for file, tree in FILES.items() for each in raised(tree) if each[1] not in OURS]
    assert [f"{file}:{line}: {name}" for file, line, name in others if place(name, file) is None] == []
    assert {place(name, file) for file, _, name in others} == set(INSIDE)


def test_the_rule_finds_what_it_should():
    """The walk sees calls, classes and helpers, and does not take a variable for a class."""
    lines = ["raise ValueError('a')", "raise KeyError", "raise e", "raise unknown('x')", "raise a.Missing()", "raise"]
    text = "\n ".join(("def f(e):", *lines))
    found = list(raised(ast.parse(text)))
    assert found == [(2, "ValueError"), (3, "KeyError"), (5, "unknown"), (6, "Missing")]
    assert {"EventFileError", "FilterError", "Unwritable", "unknown", "mistake", "wrong"} <= OURS
    assert not OURS & {"ValueError", "Damage", "Malformed"}
