"""The list of commands, and those that apps add."""

import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from neuro import __version__
from neuro.cli import commands

OURS = ("run", "plot", "check", "show", "schema", "verify", "models", "backends")


@pytest.fixture
def app(tmp_path, monkeypatch):
    """Install an app of one module under the name `extra`."""

    def install(source):
        (tmp_path / "extra_app.py").write_text(source)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "extra_app", raising=False)
        entry = EntryPoint("extra", "extra_app:app", commands.GROUP)
        monkeypatch.setattr(commands, "entry_points", lambda group: (entry,))

    return install


def test_help_lists_all(neuro):
    answer = neuro("--help")
    assert (answer.status, answer.err) == (0, "")
    assert [name for name in OURS if f" {name} " not in answer.out] == []
    assert neuro().out == answer.out


def test_version(neuro):
    assert neuro("--version").out == f"neuro {__version__}\n"


CALCULATING = {"numpy", "numba", "h5py", "matplotlib", "scipy"}
START = {
    "--help": CALCULATING | {"yaml", "pydantic", "neuro.model", "neuro.core.values"},
    "run missing.yaml": CALCULATING | {"yaml", "rich", "neuro.core.values", "neuro.program"},
    "run bad.yaml": CALCULATING - {"numpy"} | {"rich", "neuro.compiler", "neuro.program", "neuro.run"},
    "check bad.yaml": CALCULATING - {"numpy"} | {"rich", "neuro.run"},
    "report missing.h5": CALCULATING | {"yaml"},
    "plot missing.h5": CALCULATING | {"yaml"},
    "rerun missing.h5": CALCULATING | {"yaml"},
    "sweep run missing.yaml": CALCULATING | {"yaml"},
}
"""Modules that a command must not import, as they take longer than its answer."""


@pytest.mark.parametrize(("line", "heavy"), START.items(), ids=START)
def test_a_command_imports_nothing_that_its_answer_does_not_need(line, heavy, tmp_path):
    (tmp_path / "bad.yaml").write_text("neuro: 1\npopulations: {a: {shape: 10, model: iaf_psc_expo}}\n")
    code = (
        f"import sys; sys.argv = ['neuro', *{line.split()}]\n"
        "from neuro.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        f"print(sorted({heavy} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == "[]"


GOOD = '''"""Count to a number. More of it."""
import typer
app = typer.Typer(help="Longer help.")

@app.command()
def count(to: int) -> None:
    """Count."""
    typer.echo("counted to " + str(to))

@app.command()
def model() -> None:
    """Fail."""
    from neuro import ModelError
    raise ModelError("tau is wrong", hint="mend it")
'''


def test_an_app_is_listed_without_being_imported(neuro, app):
    app(GOOD)
    assert "extra     Count to a number. More of it." in neuro("--help").out
    assert "extra_app" not in sys.modules


def test_an_app_runs(neuro, app):
    app(GOOD)
    assert neuro("extra", "count", "3").out == "counted to 3\n"
    assert "Longer help." in neuro("extra", "--help").out
    answer = neuro("extra", "model")
    assert (answer.status, answer.err) == (2, "error: tau is wrong\n  hint: mend it\n")
    answer = neuro("extra", "count", "x")
    assert answer.status == 2
    assert answer.err.endswith("hint: see 'neuro extra count --help'\n")


@pytest.mark.parametrize("source", ["import no_such_module", "x = (", "1 / 0", "app = 3"])
def test_a_broken_app_troubles_only_its_callers(neuro, app, source):
    app(source)
    assert " extra " in neuro("--help").out
    assert neuro("--version").status == 0
    answer = neuro("extra")
    assert (answer.status, answer.out) == (2, "")
    assert answer.err.startswith("error: command 'extra' cannot be loaded from extra_app:app: ")
    assert answer.err.endswith("\n  hint: reinstall the package of this command\n")


def test_an_app_cannot_take_our_names(neuro, app, monkeypatch):
    app(GOOD)
    entry = EntryPoint("schema", "extra_app:app", commands.GROUP)
    monkeypatch.setattr(commands, "entry_points", lambda group: (entry,))
    assert neuro("schema").out.startswith("{")


def test_a_near_name_of_an_app_is_told(neuro, app):
    app(GOOD)
    assert neuro("extr").err == "error: unknown command 'extr'\n  hint: did you mean 'extra'?\n"


def test_a_reader_that_leaves_early_is_no_error():
    code = "from neuro.cli import main; import sys; sys.argv = ['neuro', 'models']; main()"
    command = f'{sys.executable} -c "{code}" | head -n 1'
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_a_package_is_not_run_for_its_summary(tmp_path, monkeypatch):
    (tmp_path / "slow_app" / "inner").mkdir(parents=True)
    (tmp_path / "slow_app" / "__init__.py").write_text('"""Whole."""\nraise SystemExit("run")\n')
    (tmp_path / "slow_app" / "cli.py").write_text('"""What it does."""\n')
    (tmp_path / "slow_app" / "inner" / "__init__.py").write_text('"""Inside."""\n')
    monkeypatch.syspath_prepend(tmp_path)
    from neuro.cli.commands import summary

    modules = ("slow_app", "slow_app.cli", "slow_app.inner", "slow_app.none", "no_app.cli")
    assert [summary(module) for module in modules] == ["Whole.", "What it does.", "Inside.", "", ""]
