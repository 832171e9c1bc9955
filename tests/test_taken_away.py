"""Packages of `apps`, and backends but event and reference, can be deleted: each is, from a copy of the sources."""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
KEPT = ("neuro_event", "neuro_reference")
PARTS = sorted(
    path.relative_to(ROOT)
    for folder in ("apps", "backends")
    for path in (ROOT / folder).glob("neuro_*/")
    if path.name not in KEPT
)
CORE = (
    "tests/language",
    *(f"tests/test_{name}.py" for name in ("check", "compile", "delays", "dopamine", "results", "simulation", "views")),
)
"""Tests of the language and of the event backend that run without each part."""

ALONE = """
import sys
sys.path[:] = [path for path in sys.path if not path.startswith({root!r}) or "site-packages" in path]
sys.path[:0] = {folders!r}
"""
"""What each Python of the copy runs first: modules come from the copy alone."""

NETWORK = """
neuro: 1
populations:
  noise: {model: {poisson_generator: {rate: 800.0}}, shape: 20}
  cells: {model: iaf_psc_exp, shape: 10}
projections:
  drive: {from: noise, to: cells, rule: all_to_all, weight: 100.0, delay: 1.0}
"""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def without(tmp_path: Path) -> Callable[[Path], Run]:
    """Copy the sources without one part; how to run a module of Python there."""

    def copy(part: Path) -> Run:
        place = tmp_path / "copy"
        wanted = ("neuro", "backends", "models", "apps", "tests", "pyproject.toml", "examples")
        for name in wanted:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, place / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, place / name)
        shutil.rmtree(place / part)
        shutil.rmtree(place / "tests" / part.name.removeprefix("neuro_"), ignore_errors=True)
        first = tmp_path / "first"
        first.mkdir()
        folders = [str(place / inside) for inside in ("", "backends", "models", "apps")]
        (first / "sitecustomize.py").write_text(ALONE.format(root=str(ROOT), folders=folders))
        (tmp_path / "net.yaml").write_text(NETWORK)

        def run(*words: str, folder: Path = tmp_path) -> "subprocess.CompletedProcess[str]":
            environment = os.environ | {"PYTHONPATH": str(first)}
            return subprocess.run(
                [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=1200
            )

        return run

    return copy


@pytest.mark.taken_away
@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_a_part_can_be_deleted(part, without, tmp_path):
    run = without(part)
    assert "False" in run("-c", f"import importlib.util as u; print(u.find_spec({part.name!r}) is not None)").stdout
    commands = [
        ("--help",),
        ("check", "net.yaml"),
        ("run", "net.yaml", "--for", "50", "--out", "run.h5"),
        ("energy", "net.yaml", "--for", "50"),
        ("models",),
        ("schema",),
    ]
    for words in commands:
        done = run("-m", "neuro", *words)
        assert done.returncode == 0, (words, done.stderr)
    for words in refused(part):
        done = run("-m", "neuro", *words)
        assert done.returncode == 2, (words, done.stdout)
        assert part.name in done.stderr
        assert "Traceback" not in done.stderr
    tests = run("-m", "pytest", "-q", "-p", "no:benchmark", "-p", "no:cacheprovider", *CORE, folder=tmp_path / "copy")
    assert tests.returncode == 0, tests.stdout[-4000:]


def refused(part: Path) -> list[tuple[str, ...]]:
    """Commands that need a part, of which the message must name it."""
    points = PROJECT["entry-points"]
    commands = [name for name, home in points["neuro.commands"].items() if home.startswith(f"{part.name}.")]
    backends = [name for name, home in points["neuro.backends"].items() if home.startswith(f"{part.name}:")]
    return [(name,) for name in commands] + [("run", "net.yaml", "--for", "5", "--backend", name) for name in backends]
