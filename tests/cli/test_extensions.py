"""`--with FILE.py`: parts of the user's own on the command line."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
import yaml

from neuro.cli.commands import app, apps, load, with_extensions

BROKEN = yaml.safe_load(Path(__file__).with_name("extensions.yaml").read_text("utf-8"))

FILTER = '''\
from dataclasses import dataclass

import neuro
from neuro.events.filters import Sieve


@neuro.register
@dataclass(frozen=True, eq=False)
class late(Sieve):
    """Let events pass that come late."""

    after_us: int = 2

    def _keep(self, events, keep):
        keep[:] = events.t >= self.after_us
'''
SAID = "neuro: running my_filter.py (--with)\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, registries):
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("t,x,y,p\n1,2,3,1\n2,3,3,0\n3,3,3,1\n")
    Path("my_filter.py").write_text(FILTER)
    return tmp_path


def test_a_third_party_filter(neuro):
    words = ("events", "filter", "a.csv", "-", "late: {after_us: 3}", "--to", "csv", "--with", "my_filter.py")
    answer = neuro(*words)
    assert (answer.status, answer.err) == (0, f"{SAID}-: 1 of 3 events\n")
    assert answer.out.splitlines()[1:] == ["t,x,y,p", "3,3,3,1"]
    for words in (("--list", "--with", "my_filter.py"), ("--with", "my_filter.py", "--list")):
        rows = [" ".join(line.split()) for line in neuro("events", "filter", *words).out.splitlines()]
        assert "late after_us=2 Let events pass that come late." in rows


def test_near_names_are_told(neuro, messages):
    words = ("events", "filter", "a.csv", "b.csv")
    said = {"without": neuro(*words, "late").err}
    for name in ("lat", "late: {after: 3}"):
        said[name] = neuro(*words, name, "--with", "my_filter.py").err
    messages(said)


def test_mistakes_are_told_with_their_line(neuro, messages):
    Path("my_folder").mkdir()
    for name, text in BROKEN.items():
        Path(name).write_bytes(text.replace("FILTER", FILTER).encode("latin-1"))
    for name in ("my_none.py", "my_folder", *BROKEN):
        status, out, err = neuro("events", "info", "a.csv", "--with", name)
        assert (status, out, "Traceback" in err) == (2, "", False)
        # The kinds that an error lists are those of the packages that the process has imported.
        err = re.sub("expected one of these: .*", "expected one of these: ...", err)
        messages({name: re.sub("0x[0-9a-f]+", "0x", err).replace(str(Path.cwd()), "HERE")})


@pytest.mark.filterwarnings("default")
def test_a_file_that_registers_nothing_is_told(neuro, messages):
    Path("my_nothing.py").write_text("import neuro\n\nclass late: ...\n")
    answer = neuro("events", "info", "a.csv", "--with", "my_nothing.py")
    assert answer.status == 0
    messages({"warning": answer.err})


@pytest.mark.filterwarnings("default")
def test_it_is_a_module_of_its_own_name(neuro):
    Path("my_other.py").write_text("import my_filter\n\nassert my_filter.late.__module__ == __name__[:-5] + 'filter'\n")
    answer = neuro("events", "info", "a.csv", "--with", "my_filter.py", "--with", "my_other.py")
    assert answer.status == 0
    assert sys.modules["my_filter"].__file__ == str(Path("my_filter.py").resolve())


def test_a_file_is_run_once_and_not_in_two_ways(neuro):
    assert neuro("events", "info", "a.csv", "--with", "my_filter.py", "--with", "./my_filter.py").err == SAID
    assert neuro("events", "info", "a.csv", "--with", "my_filter.py").err == ""
    Path("my_filter.py").write_text(FILTER.replace(">=", ">"))
    answer = neuro("events", "info", "a.csv", "--with", "my_filter.py")
    assert answer.err == "error: my_filter.py: was edited since it was run: expected a new start\n"


def test_an_edit_is_seen_by_the_next_run():
    """Also one of the same length within the same second, which Python's own cache of modules would not see."""
    main = "from neuro.cli import main; main()"
    words = ["events", "filter", "a.csv", "-", "late", "--to", "csv", "--with", "my_filter.py"]
    found = []
    for text in (FILTER, FILTER.replace(">=", "<=")):
        Path("my_filter.py").write_text(text)
        done = subprocess.run([sys.executable, "-c", main, *words], capture_output=True, text=True, check=True)
        found.append([line.partition(",")[0] for line in done.stdout.splitlines()[2:]])
    assert found == [["2", "3"], ["1", "2"]]


def leaves(command):
    inner = getattr(command, "commands", None)
    if inner is None:
        return [command]
    return [leaf for one in inner.values() for leaf in leaves(one)]


def test_every_command_takes_it(neuro):
    commands = leaves(with_extensions(typer.main.get_command(app)))
    for entry in apps().values():
        commands += leaves(with_extensions(load(entry)))
    assert len(commands) > 25
    for command in commands:
        assert [one.opts for one in command.params].count(["--with"]) == 1, command.name
    for words in (["run"], ["events", "convert"], ["drone", "train"], ["remus", "demo"]):
        assert "--with" in neuro(*words, "--help").out


def test_other_processes_know_it(neuro, tmp_path):
    Path("my_format.py").write_text(
        "import numpy as np\nimport neuro\nfrom neuro.events.formats import Format, Found, Piece\n"
        "def opened(source):\n"
        "    one = source.all()[-1:]\n    t, x = one.astype(np.int64), one.astype(np.uint16)\n"
        "    return Found((99, 99), {}, (Piece(t, x, x, one * 0),))\n"
        "neuro.register(Format('mine', 'Mine', ('.mine',), lambda head: head[:4] == b'MINE', opened))\n"
    )
    for name in ("a", "b"):
        Path("set", name).mkdir(parents=True)
        for k in range(9):
            Path("set", name, f"{k}.mine").write_bytes(b"MINE" + bytes([k]))
    answer = neuro("events", "tohdf5", "-f", "set", "-o", "set.h5", "--workers", "2", "--with", "my_format.py")
    assert (answer.status, answer.out) == (0, "set.h5: 18 recordings of 2 classes\n")
