"""`neuro shell` and `neuro events shell`: commands one after the other, with completion and help."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import typer

LEAVE = ("exit", "quit")
INNER = "events"
"""A group whose commands may be typed without its name where they are called like no other."""


def shell(context: typer.Context) -> None:
    """Type commands without their beginning; Tab completes, help lists them, exit leaves."""
    where = context.parent
    assert where is not None
    lines = _typed(where, f"{where.command_path}> ") if sys.stdin.isatty() else sys.stdin
    for line in lines:
        words = _words(line)
        if words and words[0] in LEAVE:
            return
        if words:
            _run(where.command, where.command_path, _in_full(where, words))


def _inner(context: Any) -> Any:
    """The group whose name may be left out, None where there is none."""
    return context.command.get_command(context, INNER) if INNER in context.command.list_commands(context) else None


def _in_full(context: Any, words: Sequence[str]) -> list[str]:
    """Words with what was left out; `help`, which becomes an option, does not count."""
    asked = ["help"] if words[:1] == ["help"] else []
    rest = list(words[len(asked) :])
    inner, outer = _inner(context), context.command.list_commands(context)
    if rest and inner is not None and rest[0] not in outer and rest[0] in inner.list_commands(context):
        rest = [INNER, *rest]
    return asked + rest


def _words(line: str) -> list[str]:
    """The words of a line; what follows # is left out."""
    try:
        return shlex.split(line, comments=True)
    except ValueError as error:
        typer.echo(f"error: {str(error).lower()}", err=True)
        return []


def _run(group: Any, path: str, words: list[str]) -> None:
    """Run one command; a mistake leaves the shell open."""
    from neuro.cli.mistakes import telling

    if words[0] == "help":
        words = [*words[1:], "--help"]
    try:
        with telling():
            group.main(words, prog_name=path, standalone_mode=False)
    except SystemExit:
        pass
    except KeyboardInterrupt:
        typer.echo("interrupted", err=True)


def _typed(context: Any, prompt: str) -> Iterator[str]:
    """The lines that a person types."""
    from neuro.core.errors import ModelError
    from neuro.core.extras import install

    try:
        from prompt_toolkit import PromptSession
        from prompt_toolkit.history import FileHistory
    except ImportError:
        raise ModelError(
            "the shell needs the package prompt_toolkit", hint=f"{install('events')}; pipes work without it"
        ) from None
    from platformdirs import user_state_path

    folder = user_state_path("neuro", ensure_exists=True)
    history = FileHistory(str(folder / "shell-history"))
    session: Any = PromptSession(history=history, completer=_completer(context), complete_while_typing=False)
    typer.echo("Tab completes, 'help' lists the commands, 'help COMMAND' tells more, 'exit' leaves.")
    while True:
        try:
            yield session.prompt(prompt)
        except KeyboardInterrupt:
            continue
        except EOFError:
            return


def _completer(context: Any) -> Any:
    from prompt_toolkit.completion import Completer, Completion, PathCompleter
    from prompt_toolkit.document import Document

    class Words(Completer):
        def get_completions(self, document: Any, event: Any) -> Iterable[Any]:
            before = document.text_before_cursor
            words = before.split()
            last = "" if before[-1:].isspace() or not before else words.pop()
            found = choices(context, words, last)
            for word, told in found:
                yield Completion(word, -len(last), display_meta=told)
            if not found and words:
                paths = PathCompleter(expanduser=True)
                yield from paths.get_completions(Document(last, len(last)), event)

    return Words()


def choices(context: Any, words: Sequence[str], last: str) -> list[tuple[str, str]]:
    """What may stand at the end of a line, each with what it means; none where a path is expected.

    Args:
        context: of the group in which the shell is.
        words: whole words before.
        last: the word that is begun, may be empty.
    """
    command = context.command
    inside = [word for word in _in_full(context, words) if not word.startswith("-")]
    inside = inside[1:] if inside[:1] == ["help"] else inside
    while inside and hasattr(command, "get_command"):
        command = command.get_command(context, inside.pop(0))
        if command is None:
            return []
    if hasattr(command, "list_commands"):
        known = _listed(context, command)
        if command is context.command:
            names = [name for name, _ in known]
            inner = _inner(context)
            known += [one for one in (_listed(context, inner) if inner else []) if one[0] not in names]
            known += [] if words else [("help", "List the commands."), ("exit", "Leave.")]
    elif last.startswith("-"):
        known = [(word, param.help or "") for param in command.params for word in param.opts if word.startswith("-")]
    else:
        return []
    return [(word, told) for word, told in known if word.startswith(last)]


def _listed(context: Any, group: Any) -> list[tuple[str, str]]:
    """The commands of a group, each with what it does."""
    names = group.list_commands(context)
    return [(name, group.get_command(context, name).get_short_help_str(60)) for name in names]
