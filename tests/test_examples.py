"""Every example runs, and so does what the pages show.

The ```python blocks of a page run one after the other in one namespace, in a folder of their own that holds a
`net.yaml` and its results `out.h5`. A ```yaml block with a line `neuro: 1` is loaded and compiled; if its first line is
a comment with a file's name, it is written there for the blocks that follow.
Pages of which a stranger's file is used on the command line are followed in a folder, with their ```console blocks;
those that add to networks by `test_add_pages`.
"""

import re
import runpy
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import neuro
from neuro.cli import main

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NEW_CODE = (
    "add-a-neuron-model.md",
    "add-a-synapse-rule.md",
    "add-a-trial-rule.md",
    "add-a-generator.md",
    "add-a-connection-rule.md",
)
WITH_COMMANDS = ("add-an-event-format.md", "add-a-filter.md")
NEEDS_DATA = ("remus.md", "detect-objects.md")
NEEDS_PACKAGE = {"drone_ppo": "stable_baselines3"}
PAGE_NEEDS = {"run-on-nest.md": "nest"}
ARGUMENTS = {
    "conditioning": ["--seconds", "30"],
    "drone_ppo": ["256"],
    "grid_world": ["--side", "2", "--episodes", "3"],
    "hedonists": ["--trials", "60"],
    "linear_track": ["--runs", "2"],
}
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
_FILE = re.compile(r"# ([\w./-]+\.(?:py|yaml))\n")
NET = """\
neuro: 1
name: pair
parameters: {w: 300.0}
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: 10}
  inh: {model: iaf_psc_exp, shape: 5}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0}
  exc_inh: {from: exc, to: inh, rule: all_to_all, weight: 300.0, delay: 1.0, synapse: {stdp: {Wmax: 600.0}}}
probes:
  v: {of: exc, record: V_m}
"""


def blocks(page: Path) -> list[tuple[str, str]]:
    return _BLOCK.findall(page.read_text(encoding="utf-8"))


def runnable(page: Path) -> bool:
    return any(kind == "python" or (kind == "yaml" and "neuro: 1" in text) for kind, text in blocks(page))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("net.yaml").write_text(NET)
    return tmp_path


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_example(path, folder, capsys, monkeypatch):
    if path.stem in NEEDS_PACKAGE:
        pytest.importorskip(NEEDS_PACKAGE[path.stem], reason=f"the example needs {NEEDS_PACKAGE[path.stem]}")
    monkeypatch.setattr(sys, "argv", [str(path), *ARGUMENTS.get(path.stem, ())])
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.yaml")), ids=lambda path: path.stem)
def test_example_network(path, folder):
    net = neuro.load(path)
    neuro.compile(net, backend="reference")
    net.save("copy.yaml")
    assert neuro.load("copy.yaml") == net


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if p.name not in (*NEW_CODE, *WITH_COMMANDS, *NEEDS_DATA) and runnable(p)],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_page(page, folder, monkeypatch, registries):
    if page.name in PAGE_NEEDS and find_spec(PAGE_NEEDS[page.name]) is None:
        pytest.skip(f"the page needs {PAGE_NEEDS[page.name]}")
    if "results.read(" in page.read_text(encoding="utf-8"):
        monkeypatch.setattr(sys, "argv", ["neuro", "run", "net.yaml", "--for", "20", "--out", "out.h5"])
        with pytest.raises(SystemExit) as done:
            main()
        assert not done.value.code
    space = {"__name__": "page"}
    for number, (kind, text) in enumerate(blocks(page)):
        if kind == "python":
            exec(compile(text, f"{page.name}, block {number}", "exec"), space)
        elif kind == "yaml" and "neuro: 1" in text:
            named = _FILE.match(text)
            Path(named[1] if named else "block.yaml").write_text(text)
            net = neuro.load(named[1] if named else "block.yaml")
            if net.populations:
                neuro.compile(net, backend="reference")


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_page_with_commands(page, tmp_path, monkeypatch):
    """In an empty folder the commands print what stands below them."""
    monkeypatch.chdir(tmp_path)
    space = {"__name__": "page"}
    for number, (kind, text) in enumerate(blocks(ROOT / "docs" / "how-to" / page)):
        named = _FILE.match(text)
        if kind == "console":
            for command in text.removeprefix("$ ").split("\n$ "):
                line, _, expected = command.partition("\n")
                assert printed(line).rstrip("\n") == expected.rstrip("\n"), line
        elif kind == "diff":
            change(tmp_path, text.splitlines())
        elif kind == "python" and named:
            Path(named[1]).write_text(text.partition("\n")[2])
        elif kind == "python":
            exec(compile(text, f"{page}, block {number}", "exec"), space)


def printed(line: str) -> str:
    """What a command line of a page prints, errors first; but for what is told once in the life of a cache."""
    program, *words = shlex.split(line)
    start = {"neuro": ["-c", "from neuro.cli import main; main()"], "python": ["-W", "error"]}[program]
    done = subprocess.run([sys.executable, *start, *words], capture_output=True, text=True, check=False)
    told = [line for line in done.stderr.splitlines(keepends=True) if not line.startswith("neuro: compiling kernels")]
    return "".join(told) + done.stdout


def change(tree: Path, lines: list[str]) -> None:
    """Put each `+` line after the last line named, and remove each `-` line."""
    path = tree / lines[0].removeprefix("--- ")
    text, place = path.read_text().splitlines(), -1
    for line in lines[1:]:
        if line[0] == "+":
            place += 1
            text.insert(place, line[1:])
        else:
            place = text.index(line[1:])
            if line[0] == "-":
                del text[place]
                place -= 1
    path.write_text("\n".join(text) + "\n")
