"""One root of errors: whatever this project raises for a mistake of its user is a `neuro.ModelError`."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
FILES = {
    str(path.relative_to(ROOT)): ast.parse(path.read_text())
    for folder in ("neuro", "apps")
    for path in sorted((ROOT / folder).rglob("*.py"))
}
INSIDE = {
    (
        "ValueError",
        "neuro/core/hdf5.py",
    ): "of a file with parts elsewhere, beside those of h5py; readers tell it as damage",
    (
        "Ambiguous",
        "apps/neuro_events/formats/_columns.py",
    ): "of an order of columns; the reader of tables tells it as Damage",
    ("_Unclear", "apps/neuro_events/formats/table.py"): "of a line; the reader of tables tells it as Damage",
    (
        "RuntimeError",
        "apps/neuro_exchange/pynn/kernel.py",
    ): "in the process of a script; it ends before the script begins",
    (
        "OSError",
        "apps/neuro_exchange/pynn/kernel.py",
    ): "as of the system; the process of a script ends before it begins",
    ("Damaged", "apps/neuro_exchange/pynn/report.py"): "of what a script reports; read tells it as ModelError",
    ("_BaselineError", "apps/neuro_agent/compare.py"): "of a baseline; run tells it as ModelError, or leaves it out",
    ("Damage", "apps/neuro_events/"): "from a reader; neuro.events.opening tells it as EventFileError",
    ("Unsavable", "apps/neuro_events/"): "from a writer; save and convert tell it as EventFileError",
    ("Malformed", "apps/neuro_events/formats/"): "of a packet; its reader tells it as Damage",
    ("ValueError", "apps/neuro_events/formats/"): "of an array or a packet; its reader tells it as Damage",
    (
        "EOFError",
        "apps/neuro_events/formats/",
    ): "of a packet that ends early; its reader tells it as Damage",
    ("FileNotFoundError", "neuro/core/growing.py"): "as of the system; a recording tells it as Unwritable",
    ("AttributeError", "neuro/files/parts.py"): "says that a field has no default, to Python of a dataclass",
    ("ValueError", "neuro/files/results.py"): "of a damaged file, beside those of h5py; read tells it as ModelError",
    ("OverflowError", "apps/neuro_events/_kernels.py"): "a promise of a compiled kernel to its caller",
    (
        "ValueError",
        "apps/neuro_sweeps/folder.py",
    ): "of JSON that is nested too deep; readers count it as damage",
    ("PermissionError", "neuro/core/outputs.py"): "as of the system; _telling tells it as Unwritable",
    ("OSError", "neuro/core/outputs.py"): "as of the system; _telling tells it as Unwritable",
    ("AttributeError", "neuro/model/parts.py"): "of an attribute that a part does not have, to Python",
    ("AttributeError", "neuro/model/network.py"): "of an attribute that a network does not have, to Python",
    ("FrozenInstanceError", "neuro/model/parts.py"): "of a part that is frozen, as of any dataclass",
    ("ImportError", "neuro/__init__.py"): "of a system that has no interfaces of POSIX",
    ("ModuleNotFoundError", "neuro/core/lazy.py"): "as of Python, of a package that is not installed",
    ("AttributeError", "neuro/core/lazy.py"): "asked for by Python of a module",
    ("NotImplementedError", "neuro/"): "of a method that subclasses have",
    ("NotImplementedError", "apps/neuro_events/"): "of a method that subclasses have",
    ("NotImplementedError", "apps/neuro_bench/"): "of a method that subclasses have",
    ("NotImplementedError", "apps/neuro_exchange/"): "of a method that subclasses have",
    ("TypeError", "apps/neuro_bench/"): "of what is no task or method; a registry tells it as ModelError",
    ("TypeError", "neuro/model/"): "of a class that is no model; a registry tells it as ModelError",
    ("TypeError", "neuro/core/own_parts.py"): "likewise",
    ("TypeError", "neuro/coding/"): "of a function that is no code; a registry tells it as ModelError",
    ("TypeError", "apps/neuro_events/f"): "of what is no format or filter; a registry tells it as ModelError",
    ("TypeError", "neuro/kernels/kept.py"): "to the author of a kernel",
    ("AssertionError", "neuro/testing/"): "the judgement of the conformance suite",
    ("BadParameter", "neuro/cli/"): "of an option; the command line tells it with the option's name",
    ("BadParameter", "apps/"): "of an option; the command line tells it with the option's name",
    ("KeyboardInterrupt", "neuro/core/interrupts.py"): "of a second Ctrl-C, as Python raises it at the first",
    ("Pruned", "apps/neuro_sweeps/function.py"): "of a run that ends early; who does the run keeps it as pruned",
    (
        "ValueError",
        "apps/neuro_agent/spaces.py",
    ): "of an observation of another form; flat tells it as ModelError",
    ("Unsupported", "apps/neuro_exchange/nir/"): "of a node; it becomes a verdict, and with all others a ModelError",
    (
        "Incomplete",
        "apps/neuro_exchange/pynn/gathered.py",
    ): "of a part that cannot come; _each keeps it as a problem of its line",
    (
        "Refused",
        "apps/neuro_exchange/pynn/confined.py",
    ): "to a script of PyNN; its process tells it, and read as ModelError",
    ("AttributeError", "apps/neuro_exchange/pynn/"): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    ("ValueError", "apps/neuro_exchange/pynn/"): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    ("TypeError", "apps/neuro_exchange/pynn/"): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    ("IndexError", "apps/neuro_exchange/pynn/"): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    (
        "InvalidParameterValueError",
        "apps/neuro_exchange/pynn/",
    ): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    (
        "NonExistentParameterError",
        "apps/neuro_exchange/pynn/",
    ): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    ("ImportError", "apps/neuro_exchange/pynn/"): "to a script of PyNN, as of PyNN; read tells it as ModelError",
    ("Exit", "neuro/cli/"): "the status of a command",
    ("Exit", "apps/"): "the status of a command",
}
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
