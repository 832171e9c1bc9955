"""`--with FILE.py`: parts of the user's own on the command line."""

import subprocess
import sys
from pathlib import Path

import pytest
import typer

from neuro.cli.commands import app, apps, load, with_extensions

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
    answer = neuro("events", "filter", "a.csv", "-", "late: {after_us: 3}", "--to", "csv", "--with", "my_filter.py")
    assert (answer.status, answer.err) == (0, f"{SAID}-: 1 of 3 events\n")
    assert answer.out.splitlines()[1:] == ["t,x,y,p", "3,3,3,1"]


@pytest.mark.parametrize("words", [("--list", "--with", "my_filter.py"), ("--with", "my_filter.py", "--list")])
def test_it_is_listed(neuro, words):
    rows = [line.split() for line in neuro("events", "filter", *words).out.splitlines()]
    assert ["late", "after_us=2", "Let", "events", "pass", "that", "come", "late."] in rows


def test_near_names_are_told(neuro):
    answer = neuro("events", "filter", "a.csv", "b.csv", "lat", "--with", "my_filter.py")
    assert answer.err == f"{SAID}error: unknown filter 'lat'\n  hint: did you mean 'late'?\n"
    Path("b.csv").unlink(missing_ok=True)
    answer = neuro("events", "filter", "a.csv", "b.csv", "late: {after: 3}", "--with", "my_filter.py")
    assert answer.err == "error: unknown parameter of filter 'late' 'after'\n  hint: did you mean 'after_us'?\n"


def test_without_it_nothing_is_known(neuro):
    answer = neuro("events", "filter", "a.csv", "b.csv", "late")
    assert answer.err.startswith("error: unknown filter 'late'\n")


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("my_none.py", None, "my_none.py: no such file: expected a Python file"),
        ("my_folder", None, "my_folder: is a folder: expected a Python file"),
        ("my_net.yaml", "x", "my_net.yaml: expected a Python file with a plain name, such as my_filter.py"),
        ("my-file.py", "x", "my-file.py: expected a Python file with a plain name, such as my_filter.py"),
        ("random.py", "x", "random.py: 'random' is the name of another module: expected a name of its own"),
        ("neuro.py", "x", "neuro.py: 'neuro' is the name of another module: expected a name of its own"),
        ("numba.py", "x", "numba.py: 'numba' is the name of another module: expected a name of its own"),
        ("my_a.py", "\nx = (1,\n", "my_a.py:2:5: '(' was never closed"),
        ("my_b.py", "def f():\n    return {}['a']\n\n\nf()\n", "my_b.py:2: KeyError: 'a'"),
        ("my_c.py", "import my_missing\n", "my_c.py:1: ModuleNotFoundError: No module named 'my_missing'"),
        ("my_d.py", "import sys\nsys.exit(3)\n", "my_d.py:2: SystemExit: 3"),
        ("my_e.py", "import runpy\n\nrunpy.run_path('none')\n", "my_e.py:3: FileNotFoundError: [Errno 2] No such file"),
        ("my_f.py", "x = b'\xff'\n", None),
        ("my_g.py", "assert False\n", "my_g.py:1: AssertionError"),
        (
            "my_h.py",
            f"{FILTER}\n\nneuro.register(late)\n",
            "my_h.py:18: filter 'late' is registered twice\n  hint: give it another name",
        ),
        (
            "my_i.py",
            "import neuro\n\n\n@neuro.register\ndef f(t): ...\n",
            "hint: write neuro.register(kind=...) above a function",
        ),
    ],
)  # fmt: skip
def test_mistakes_are_told_with_their_line(neuro, name, text, expected):
    if name == "my_folder":
        Path(name).mkdir()
    elif text is not None:
        Path(name).write_bytes(text.encode("latin-1"))
    answer = neuro("events", "info", "a.csv", "--with", name)
    assert (answer.status, answer.out) == (2, "")
    assert "Traceback" not in answer.err
    if expected is None:
        assert answer.err.startswith(f"neuro: running {name} (--with)\nerror: {name}:1")
    elif expected.startswith("hint"):
        assert answer.err.startswith(
            f"neuro: running {name} (--with)\nerror: {name}:4: neuro.register: found <function f"
        )
        assert answer.err.endswith(f"{expected}\n")
    else:
        assert answer.err.startswith(f"neuro: running {name} (--with)\nerror: {expected}")


@pytest.mark.filterwarnings("default")
def test_a_file_that_registers_nothing_is_told(neuro):
    Path("my_nothing.py").write_text("import neuro\n\nclass late: ...\n")
    answer = neuro("events", "info", "a.csv", "--with", "my_nothing.py")
    assert (answer.status, answer.err) == (
        0,
        "neuro: running my_nothing.py (--with)\n"
        "warning: my_nothing.py: registers nothing\n"
        "  hint: write @neuro.register above a class, or neuro.register(part)\n",
    )


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
        "import numpy as np\n"
        "import neuro\n"
        "from neuro.events.formats import Format, Found, Piece\n"
        "def opened(source):\n"
        "    one = source.all()[-1:]\n"
        "    t, x = one.astype(np.int64), one.astype(np.uint16)\n"
        "    return Found((99, 99), {}, (Piece(t, x, x, one * 0),))\n"
        "neuro.register(Format('mine', 'Mine', ('.mine',), lambda head: head[:4] == b'MINE', opened))\n"
    )
    for name in ("a", "b"):
        for k in range(9):
            Path("set", name).mkdir(parents=True, exist_ok=True)
            Path("set", name, f"{k}.mine").write_bytes(b"MINE" + bytes([k]))
    answer = neuro("events", "tohdf5", "-f", "set", "-o", "set.h5", "--workers", "2", "--with", "my_format.py")
    assert (answer.status, answer.out) == (0, "set.h5: 18 recordings of 2 classes\n")
