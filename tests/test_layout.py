"""The house shows itself: rooms in an order, no import that runs upward, no circle, and apps that use public names."""

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = (
    "core",
    "kernels",
    "coding",
    "events",
    "model",
    "program",
    "compiler",
    "chips",
    "files",
    "plots",
    "pages",
    "run",
    "verify",
    "compare",
    "report",
    "sweeps",
    "rerun",
    "testing",
    "cli",
)
"""From the ground up: a module imports from its own room and those before it."""
PUBLIC = {
    "neuro",
    *(f"neuro.{name}" for name in ("chips", "coding", "compare", "events", "plots", "extend", "apps", "results")),
}
"""Modules whose names are promised; `neuro.events` has public modules of its own, without a `_`."""
PUBLIC_OF_BACKENDS = {"neuro_torch", "neuro_torch.losses", "neuro_torch.surrogates"}
"""What apps may take of backends: networks as modules. The others they name only, to `neuro.compile`."""
APPS = ("neuro_drone", "neuro_recognise", "neuro_remus", "neuro_train")
FOLDERS = {"neuro": ROOT, **{name: ROOT / name for name in ("apps", "backends", "models")}}
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


def room(module: str) -> str:
    return module.split(".")[1]


def test_few_modules_stand_directly_in_the_package():
    direct = {path.name for path in (ROOT / "neuro").glob("*.py")}
    assert direct <= {"__init__.py", "__main__.py", "apps.py", "extend.py", "results.py"}


def test_every_room_has_its_place_in_the_order():
    assert {room(name) for name in MODULES if name.startswith("neuro.")} <= {
        *LAYERS,
        "apps",
        "extend",
        "results",
        "__main__",
    }


@pytest.mark.parametrize("module", [name for name in MODULES if name.startswith("neuro.") and room(name) in LAYERS])
def test_nothing_runs_upward(module):
    for other, _ in imports(module):
        assert other.startswith("neuro."), f"{module} imports {other}"
        assert LAYERS.index(room(other)) <= LAYERS.index(room(module)), f"{module} imports {other}"


EVENT_ROOMS = ("loop", "building", "host")
"""Of the event backend, from the ground up."""


@pytest.mark.parametrize("module", [name for name in MODULES if name.startswith("neuro_event.")])
def test_rooms_of_the_event_backend_stand_in_one_order(module):
    for other, _ in imports(module):
        if other.startswith("neuro_event."):
            assert EVENT_ROOMS.index(room(other)) <= EVENT_ROOMS.index(room(module)), f"{module} imports {other}"


def test_no_circle():
    lazy = {"neuro", "neuro.chips", "neuro.extend", "neuro.apps"}
    graph = {name: {other for other, _ in imports(name)} - {name} for name in MODULES if name not in lazy}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("module", [name for name in MODULES if name.startswith(APPS)])
def test_apps_use_public_names(module):
    for other, name in imports(module):
        if other.split(".")[0] == "neuro":
            hidden = any(word.startswith("_") for word in [*other.split("."), name])
            assert not hidden, f"{module} imports {name} of {other}"
            assert other in PUBLIC or other.startswith("neuro.events"), f"{module} imports {name} of {other}"
        elif "backends" in MODULES[other].parts:
            assert other in PUBLIC_OF_BACKENDS, f"{module} imports {name} of {other}"


@pytest.mark.parametrize(
    "module", [name for name in MODULES if name.startswith("neuro_") and "backends" in MODULES[name].parts]
)
def test_backends_know_no_other(module):
    own = module.split(".")[0]
    for other, _ in imports(module):
        assert other.split(".")[0] in ("neuro", own), f"{module} imports {other}"
        if other.startswith("neuro."):
            assert room(other) not in ("run", "verify", "events", "compare", "testing", "cli"), (
                f"{module} imports {other}"
            )


@pytest.mark.parametrize("module", sorted({*PUBLIC, "neuro.testing"}))
def test_public_names_stand_on_a_page(module):
    words = {word for page in (ROOT / "docs").rglob("*.md") for word in re.findall(r"\w+", page.read_text("utf-8"))}
    assert {name for name in import_module(module).__all__ if not name.startswith("_")} <= words
