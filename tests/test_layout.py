"""The house shows itself: rooms in an order, no import that runs upward, no circle, and apps that use public names."""

import ast
import re
from collections.abc import Callable, Iterator
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

from neuro.core.lazy import PACKAGES

ROOT = Path(__file__).parent.parent
LAYERS = (
    "core",
    "kernels",
    "coding",
    "model",
    "program",
    "compiler",
    "chips",
    "files",
    "plots",
    "pages",
    "run",
    "realtime",
    "compare",
    "testing",
    "cli",
)
"""From the ground up: a module imports from its own room and those before it."""
PUBLIC = {
    "neuro",
    *(f"neuro.{name}" for name in ("chips", "coding", "compare", "plots", "realtime")),
    *(f"neuro.{name}" for name in ("results", "extend", "apps")),
}
"""Modules whose names are promised, beside those of `PACKAGES`, which have modules of their own without a `_`."""
PUBLIC_OF_BACKENDS = {"neuro_torch", "neuro_torch.losses", "neuro_torch.surrogates"}
"""What apps may take of backends: networks as modules. The others they name only, to `neuro.compile`."""
APPS = (
    *("neuro_bench", "neuro_doctor", "neuro_drone", "neuro_events", "neuro_exchange", "neuro_live", "neuro_predict"),
    *("neuro_recognise", "neuro_remus", "neuro_sweeps", "neuro_train"),
)
TYPES_OF_APPS = {("neuro.run.simulation", "Diagnosis")}
"""Names of apps that modules of the core take for type checkers only."""
TEMPLATES = ROOT / "neuro" / "cli" / "templates"
"""Scripts that `neuro new` copies: files of users, no modules of ours."""


def module_name(path: Path) -> str:
    base = next((ROOT / name for name in ("apps", "backends", "models") if (ROOT / name) in path.parents), ROOT)
    parts = path.relative_to(base).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_name(path): path
    for folder in ("neuro", "apps", "backends", "models")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if TEMPLATES not in path.parents
}


def imports(module: str) -> Iterator[tuple[str, str]]:
    """The modules of this project that a module imports anywhere, and the name that it takes from each."""
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in (alias.name for alias in node.names):
                inside = f"{node.module}.{name}"
                if inside in MODULES:
                    yield inside, ""
                elif node.module in MODULES:
                    yield node.module, name
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name in MODULES)


IMPORTS = {module: list(imports(module)) for module in MODULES}


def room(module: str) -> str:
    return module.split(".")[1]


def refused(allowed: Callable[[str, str, str], bool], *begins: str) -> list[str]:
    """Imports by modules of some packages that are not allowed: of a module another one, and a name of it."""
    return [
        f"{module} imports {name} of {other}"
        for module, taken in IMPORTS.items()
        for other, name in taken
        if module.startswith(begins) and not allowed(module, other, name)
    ]


def test_few_modules_stand_directly_in_the_package():
    direct = {path.name for path in (ROOT / "neuro").glob("*.py")}
    assert direct <= {"__init__.py", "__main__.py", "apps.py", "extend.py", "results.py"}
    rooms = {room(name) for name in MODULES if name.startswith("neuro.")}
    assert rooms <= {*LAYERS, "apps", "extend", "results", "__main__"}


def test_nothing_runs_upward():
    def downward(module, other, name):
        if room(module) not in LAYERS or other.partition(".")[0] in PACKAGES.values():
            return True
        if (module, name) in TYPES_OF_APPS:
            return True
        return other.startswith("neuro.") and LAYERS.index(room(other)) <= LAYERS.index(room(module))

    assert refused(downward, "neuro.") == []


EVENT_ROOMS = ("loop", "building", "host")
"""Of the event backend, from the ground up."""


def test_rooms_of_the_event_backend_stand_in_one_order():
    def downward(module, other, name):
        inside = other.startswith("neuro_event.")
        return not inside or EVENT_ROOMS.index(room(other)) <= EVENT_ROOMS.index(room(module))

    assert refused(downward, "neuro_event.") == []


def test_no_circle():
    lazy = {"neuro", "neuro.chips", "neuro.extend", "neuro.apps", "neuro.testing"}
    graph = {name: {other for other, _ in taken} - {name} for name, taken in IMPORTS.items() if name not in lazy}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_apps_use_public_names():
    def public(module, other, name):
        if other.split(".")[0] == "neuro":
            hidden = any(word.startswith("_") for word in [*other.split("."), name])
            return not hidden and other in PUBLIC
        return "backends" not in MODULES[other].parts or other in PUBLIC_OF_BACKENDS

    assert refused(public, *APPS) == []


def test_backends_know_no_other():
    def known(module, other, name):
        if "backends" not in MODULES[module].parts:
            return True
        above = other.startswith("neuro.") and room(other) in ("run", "compare", "testing", "cli")
        return other.split(".")[0] in ("neuro", module.split(".")[0]) and not above

    assert refused(known, "neuro_") == []


def test_public_names_stand_on_a_page():
    """The API pages show every name of their modules, so other pages name only those of modules without one."""
    pages = {page: page.read_text("utf-8") for page in (ROOT / "docs").rglob("*.md")}
    words = {word for text in pages.values() for word in re.findall(r"\w+", text)}
    shown = {name for text in pages.values() for name in re.findall(r"automodule:: ([\w.]+)\n +:members:", text)}
    names = {
        name
        for module in sorted({*PUBLIC, *PACKAGES, "neuro.testing"} - shown)
        for name in getattr(import_module(module), "__all__", ())
    }
    assert PUBLIC - shown == set()
    assert {name for name in names if not name.startswith("_")} - words == set()
