"""The shell: lines, mistakes, completion."""

import io
import sys

import pytest
import typer

from event_commands import root
from neuro.cli.events import app
from neuro.core.extras import install


def test_the_shell_runs_lines_and_stays_open_after_mistakes(run, recording, monkeypatch):
    lines = "info in.bin  # look\n\nnope\ninfo 'in.bin\nhelp gif\nconvert in.bin out.csv\nexit\ninfo none.bin\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
    status, out, err = run("shell")
    assert status == 0
    assert "events        100" in out
    assert "Draw a recording as a GIF" in out
    assert out.endswith("out.csv: 100 events\n")
    assert err.startswith(
        "error: No such command 'nope'\n  hint: see 'neuro events --help'\nerror: no closing quotation\n"
    )
    assert "none.bin" not in err


def test_the_shell_of_all_commands_takes_those_of_events_as_they_are(run, data, monkeypatch):
    lines = "help tohdf5\ntohdf5 -f set -e bin -o all.h5 --jobs 1\nevents info set\nshow\ninfo\nnope\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
    status, out, err = run("shell", group=())
    assert status == 0
    assert "Usage: neuro events tohdf5" in out
    assert "all.h5: 6 recordings of 2 classes\ndata set    set\n" in out
    assert err.startswith(
        "error: Missing argument 'FILE'\n  hint: see 'neuro events info --help'\nerror: unknown command 'nope'"
    )


def test_neuro_has_a_shell(monkeypatch, capsys):
    from neuro.cli.commands import app as whole

    monkeypatch.setattr(sys, "stdin", io.StringIO("formats\nquit\n"))
    whole(["shell"], standalone_mode=False)
    assert "N-MNIST .bin" in capsys.readouterr().out


@pytest.fixture
def typed(run, monkeypatch, tmp_path):
    """Type keys into the shell."""
    prompt_toolkit = pytest.importorskip("prompt_toolkit")
    from prompt_toolkit.input import create_pipe_input
    from prompt_toolkit.output import DummyOutput

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "stdin", type("Terminal", (io.StringIO,), {"isatty": lambda self: True})())

    def keys(text):
        with create_pipe_input() as pipe:
            session = prompt_toolkit.PromptSession
            monkeypatch.setattr(
                prompt_toolkit, "PromptSession", lambda **more: session(input=pipe, output=DummyOutput(), **more)
            )
            pipe.send_text(text)
            return run("shell")

    return keys


def test_a_person_types_into_the_shell(typed, recording, tmp_path):
    status, out, err = typed("info in.bin\r\x04")
    assert (status, err) == (0, "")
    assert out.startswith("Tab completes, 'help' lists the commands, 'help COMMAND' tells more, 'exit' leaves.\nfile ")
    assert "+info in.bin" in (tmp_path / "state" / "neuro" / "shell-history").read_text()


def test_without_the_package_the_shell_says_how_to_get_it(run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", type("Terminal", (io.StringIO,), {"isatty": lambda self: True})())
    monkeypatch.setitem(sys.modules, "prompt_toolkit", None)
    expected = "error: the shell needs the package prompt_toolkit\n"
    assert run("shell") == (2, "", f"{expected}  hint: {install('events')}; pipes work without it\n")


def test_completion():
    from neuro.cli.events.shell import choices

    group = typer.main.get_command(root())
    context = group.make_context("neuro", [], resilient_parsing=True)
    inside = group.get_command(context, "events")
    there = inside.make_context("events", [], parent=context, resilient_parsing=True)

    def words(where, before, last):
        return [word for word, _ in choices(where, before, last)]

    assert words(there, [], "t") == ["tohdf5"]
    assert {"info", "gif", "help", "exit"} <= {*words(there, [], "")}
    assert words(there, ["help"], "vi") == ["view"]
    assert words(there, ["tohdf5"], "--st") == ["--strict"]
    assert words(there, ["tohdf5", "-f"], "in") == []
    assert words(there, ["nope"], "--x") == []
    assert words(context, [], "ev") == ["events"]
    assert words(context, [], "sh") == ["shell", "show"]
    assert words(context, [], "to") == ["tohdf5"]
    assert words(context, ["tohdf5"], "--st") == ["--strict"]
    assert words(context, ["events"], "co") == ["convert"]
    assert words(context, ["events", "gif", "a.bin"], "--fp") == ["--fps"]
    assert dict(choices(there, [], "view"))["view"].startswith("Write a page")


def test_files_are_completed_where_a_command_takes_them(recording, tmp_path, monkeypatch):
    document = pytest.importorskip("prompt_toolkit.document")
    from neuro.cli.events.shell import _completer

    monkeypatch.chdir(tmp_path)
    command = typer.main.get_command(app)
    completer = _completer(command.make_context("events", [], resilient_parsing=True))

    def found(line):
        return [one.text for one in completer.get_completions(document.Document(line), None)]

    assert found("info i") == ["n.bin"]
    assert found("inf") == ["info"]
    assert found("gif in.bin --fp") == ["--fps"]
    assert found("gi") == ["gif"]
