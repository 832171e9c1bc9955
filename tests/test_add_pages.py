"""Pages in which a stranger adds a part: followed in an empty folder, from the command line and from Python."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMES = (*("add-a-neuron-model", "add-a-synapse-rule", "add-a-trial-rule", "add-a-generator", "add-a-connection-rule"),)
PAGES = [ROOT / "docs" / "how-to" / f"{name}.md" for name in NAMES]
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
_FILE = re.compile(r"# ([\w.-]+\.(?:py|yaml))\n")
_COMMAND = "import sys; from neuro.cli import main; sys.exit(main())"


def run(folder, *command):
    done = subprocess.run(
        [sys.executable, "-W", "error", *command], cwd=folder, env=os.environ, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def follow(page, folder):
    """Write the files that a page shows; return its scripts and its command lines."""
    scripts, commands = [], []
    for kind, text in _BLOCK.findall(page.read_text("utf-8")):
        if named := _FILE.match(text):
            (folder / named[1]).write_text(text)
        elif kind == "python":
            scripts.append(text)
        elif kind == "console":
            commands += [line.removeprefix("$ neuro ").split() for line in text.splitlines() if line.startswith("$ ")]
    return scripts, commands


EDITS = {
    "add-a-neuron-model": ("lif_cond.py", "- x[1, i]", "- 3.0 * x[1, i]"),
    "add-a-synapse-rule": ("triplets.py", "c[A2_PLUS] + c", "7.0 * c[A2_PLUS] + c"),
    "add-a-trial-rule": ("early.py", "quantity(20.0", "quantity(25.0"),
    "add-a-generator": ("sine_generator.py", "out[i] = 1.0", "out[i] = 2.0"),
    "add-a-connection-rule": ("near.py", "self.p * np.exp", "0.5 * self.p * np.exp"),
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_stranger_follows_the_page(page, tmp_path):
    scripts, commands = follow(page, tmp_path)
    assert scripts
    assert commands
    (tmp_path / "check.py").write_text("\n".join(scripts))
    run(tmp_path, "check.py")
    printed = [run(tmp_path, "-c", _COMMAND, *command) for command in commands]
    assert all(printed)

    name, old, new = EDITS[page.stem]
    before = (tmp_path / name).read_text()
    assert old in before
    (tmp_path / name).write_text(before.replace(old, new))
    assert run(tmp_path, "-c", _COMMAND, *commands[0]) != printed[0]
    run(tmp_path, "check.py")
