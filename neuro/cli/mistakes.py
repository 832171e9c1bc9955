"""Telling users their mistakes: one message on stderr, exit status 2, no traceback."""

from __future__ import annotations

import errno
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer

from neuro.core.system import speaks

_MORE = re.compile(r"Got unexpected extra argument\(?s?\)? \((.*)\)")
_CHOICE = re.compile(r"Invalid value for ('[^']*'): Value error, (.*) is not one of (.*)")
_ITEM = "\n    - "
_LIST = re.compile(rf"({_ITEM}[^\n]*)+")
UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # typer has no public name for it


@contextmanager
def telling() -> Iterator[None]:
    """Turn the mistakes of users that are raised inside into a message and exit status 2, and warnings into lines."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _tell
            yield
            if sys.stdout is not None:  # it was not closed before the start
                sys.stdout.flush()
    except BrokenPipeError:  # the reader, say `head`, has seen enough
        _give_up_output()
        sys.exit(1)
    except Exception as error:
        message = _of_output(error) if (told := mistake(error)) is None else told
        if message is None:
            raise
        if message and speaks():
            from neuro.core.values import printable

            typer.echo(f"error: {printable(message)}", err=True)
        sys.exit(2)


@contextmanager
def listed_approximations() -> Iterator[None]:
    """Print warnings with their lists, such as the differences of a rule on a chip."""
    tell = warnings.showwarning
    warnings.showwarning = lambda message, *more, **named: _print_warning(str(message))
    try:
        yield
    finally:
        warnings.showwarning = tell


@contextmanager
def counted_approximations(backend: str, command: str) -> Iterator[None]:
    """Print one line with the number of a backend's approximations; other warnings are printed as usual.

    Args:
        backend: the name of the backend, for the printed line.
        command: the command that lists the approximations, for the printed line.
    """
    from neuro.run.compiled import ApproximationWarning

    approximations: list[str] = []
    tell = warnings.showwarning

    def count(message: Warning | str, category: type[Warning], *more: Any, **named: Any) -> None:
        if issubclass(category, ApproximationWarning):
            approximations.append(str(message))
        else:
            tell(message, category, *more, **named)

    warnings.showwarning = count
    try:
        yield
    finally:
        warnings.showwarning = tell
    if approximations and speaks():
        from neuro.core.errors import some

        count_text = some(len(approximations), "approximation")
        typer.echo(
            f"warning: backend '{backend}': {count_text} of the network; --verbose or {command} lists all", err=True
        )


def _give_up_output() -> None:
    """Throw away what could not be printed, which would be tried again at the end."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _of_output(error: Exception) -> str | None:
    """What to report where standard output cannot be written, as on a full disk; None if it is something else."""
    if not isinstance(error, OSError) or error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
        return None
    _give_up_output()
    return f"standard output: cannot be written: {error.strerror}"


def _tell(message: Warning | str, category: type[Warning], filename: str, *more: object, **named: object) -> None:
    """Print a warning for the user, without the place in our sources that raised it, and without its list."""
    _print_warning(_LIST.sub(_number_of_items, str(message)))


def _number_of_items(items: re.Match[str]) -> str:
    """Return the number of items in the list of a chip's differences, and where the list is printed."""
    return f" {items[0].count(_ITEM)}, listed by neuro fit"


def _print_warning(text: str) -> None:
    if speaks():
        from neuro.core.values import printable

        typer.echo(f"warning: {printable(text)}", err=True)


def mistake(error: Exception) -> str | None:
    """The message for the user; None if the error is a bug of ours."""
    from neuro.core.errors import ModelError

    if isinstance(error, ModelError):
        return "\n  ".join([str(error), *getattr(error, "__notes__", ())])
    if isinstance(error, UsageError):
        return usage(error)
    if isinstance(error, MemoryError):
        return f"this needs more memory than there is: {error}"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None


def _usage(context: Any) -> str:
    """How a command is called."""
    pieces = context.command.collect_usage_pieces(context)
    return " ".join(
        [context.command_path, *(piece.strip("{}") for piece in pieces if piece != "[OPTIONS]"), "[OPTIONS]"]
    )


def _unknown_option(name: str, context: Any) -> str:
    """The message for an option that a command does not have, with the nearest that it has."""
    from neuro.core.hints import alike

    known = [word.lstrip("-") for one in context.command.params for word in one.opts if word.startswith("--")]
    close = " or ".join(f"'--{word}'" for word in alike(name.lstrip("-"), sorted(known)))
    hint = f"did you mean {close}?" if close else f"see '{context.command_path} --help'"
    return f"unknown option '{name}'\n  hint: {hint}"


def usage(error: Exception) -> str:
    """The message of a misused option, and where to read more; "" where the help of a group was printed instead."""
    text = getattr(error, "format_message")().rstrip(".")  # noqa: B009
    if not text:
        return ""
    context = getattr(error, "ctx", None)
    if more := _MORE.fullmatch(text):
        text = f"found '{more[1]}', too: expected {_usage(context)}" if context else text
    elif choice := _CHOICE.fullmatch(text):
        text = f"{choice[1]}: found {choice[2]}: expected one of {choice[3]}"
    if text.startswith("No such option") and context is not None:
        return _unknown_option(getattr(error, "option_name"), context)  # noqa: B009
    if getattr(error, "option_name", "") == "--with":
        return f"{text}\n  hint: write it after the command, as in neuro run net.yaml --with my_neuron.py"
    return f"{text}\n  hint: see '{context.command_path} --help'" if context else text
