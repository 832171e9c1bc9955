"""Errors and warnings on the command line. A user's error prints one message on stderr and exits with status 2."""

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
_EXPECTED = {
    "int_parsing": "a whole number",
    "float_parsing": "a number",
    "greater_than_equal": "a number >= {ge}",
    "less_than_equal": "a number <= {le}",
}
"""Accepted values of an option, by the type of the error in typer."""

_ITEM = "\n    - "
_LIST = re.compile(rf"({_ITEM}[^\n]*)+")
UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # typer has no public name for it


@contextmanager
def telling() -> Iterator[None]:
    """Print user errors and warnings in the block as messages. An error exits with status 2, without a traceback.

    An exception that is not a user's error is raised again.
    """
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _tell
            yield
            if sys.stdout is not None:  # stdout is None if the shell closed it before the start
                sys.stdout.flush()
    except BrokenPipeError:  # the reader of the pipe, e.g. `head`, has ended
        _give_up_output()
        sys.exit(1)
    except Exception as error:
        message = mistake(error)
        if message is None:
            message = _output_error(error)
        if message is None:
            raise
        if message and speaks():
            from neuro.core.errors import printable

            typer.echo(f"error: {printable(message)}", err=True)
        sys.exit(2)


@contextmanager
def listed_approximations() -> Iterator[None]:
    """Print warnings in full, including lists such as a rule's differences on a chip."""
    previous = warnings.showwarning
    warnings.showwarning = lambda message, *arguments, **options: _print_warning(str(message))
    try:
        yield
    finally:
        warnings.showwarning = previous


@contextmanager
def counted_approximations(backend: str, command: str) -> Iterator[None]:
    """Print one line with the number of approximations of a backend. Other warnings are printed as usual.

    Args:
        backend: the name of the backend, for the printed line.
        command: the command that lists the approximations, for the printed line.
    """
    from neuro.run.compiled import ApproximationWarning

    approximations: list[str] = []
    previous = warnings.showwarning

    def count(message: Warning | str, category: type[Warning], *location: Any, **options: Any) -> None:
        if issubclass(category, ApproximationWarning):
            approximations.append(str(message))
        else:
            previous(message, category, *location, **options)

    warnings.showwarning = count
    try:
        yield
    finally:
        warnings.showwarning = previous
    if approximations and speaks():
        from neuro.core.errors import some

        count_text = some(len(approximations), "approximation")
        typer.echo(
            f"warning: backend '{backend}': {count_text} of the network; --verbose or {command} lists all", err=True
        )


def _give_up_output() -> None:
    """Send further standard output to the null device, because Python would flush it again at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _output_error(error: Exception) -> str | None:
    """Return the message for a failed write to standard output, e.g. on a full disk, or None for other errors."""
    if not isinstance(error, OSError) or error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
        return None
    _give_up_output()
    return f"standard output: cannot be written: {error.strerror}"


def _tell(message: Warning | str, category: type[Warning], filename: str, *more: object, **options: object) -> None:
    """Print a warning without its line of code. A list in the warning is replaced by the number of its items."""
    _print_warning(_LIST.sub(_number_of_items, str(message)))


def _number_of_items(items: re.Match[str]) -> str:
    """Return the number of items in a list of differences, and the command that prints the list, as text."""
    return f" {items[0].count(_ITEM)}, listed by neuro fit"


def _print_warning(text: str) -> None:
    if speaks():
        from neuro.core.errors import printable

        typer.echo(f"warning: {printable(text)}", err=True)


def mistake(error: Exception) -> str | None:
    """Return the message for a user's error, or None if the exception is a bug in neuro."""
    from neuro.core.errors import ModelError

    if isinstance(error, ModelError):
        return "\n  ".join([str(error), *getattr(error, "__notes__", ())])
    if isinstance(error, UsageError):
        return usage(error)
    if isinstance(error, MemoryError):
        return f"more memory is needed than is free: {error}"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None


def _usage(context: Any) -> str:
    """Return the usage of a command, e.g. "neuro run FILE [OPTIONS]"."""
    pieces = context.command.collect_usage_pieces(context)
    return " ".join(
        [context.command_path, *(piece.strip("{}") for piece in pieces if piece != "[OPTIONS]"), "[OPTIONS]"]
    )


def _unknown_option(name: str, context: Any) -> str:
    """Return the message for an unknown option. The hint names the most similar options of the command."""
    from neuro.core.hints import close_names

    known = [word.lstrip("-") for p in context.command.params for word in p.opts if word.startswith("--")]
    close = " or ".join(f"'--{word}'" for word in close_names(name.lstrip("-"), sorted(known)))
    hint = f"did you mean {close}?" if close else f"see '{context.command_path} --help'"
    return f"unknown option '{name}'\n  hint: {hint}"


def _expected(error: Exception) -> str:
    """Return text with the refused value and the accepted values, or "" for other errors."""
    first: Any = getattr(error.__cause__, "errors", lambda: [{"type": ""}])()[0]
    expected = _EXPECTED.get(first["type"])
    return f"'{first['input']}': expected {expected.format(**first.get('ctx', {}))}" if expected else ""


def usage(error: Exception) -> str:
    """Return the message for a wrong option or argument, with a hint, or "" if the help of a group was printed."""
    text = getattr(error, "format_message")().rstrip(".")  # noqa: B009
    if not text:
        return ""
    context = getattr(error, "ctx", None)
    if more := _MORE.fullmatch(text):
        text = f"found '{more[1]}', too: expected {_usage(context)}" if context else text
    elif choice := _CHOICE.fullmatch(text):
        text = f"{choice[1]}: found {choice[2]}: expected one of {choice[3]}"
    elif expected := _expected(error):
        text = text.replace(getattr(error, "message"), expected)  # noqa: B009
    if text.startswith("No such option") and context is not None:
        return _unknown_option(getattr(error, "option_name"), context)  # noqa: B009
    if getattr(error, "option_name", "") == "--with":
        return f"{text}\n  hint: write it after the command, as in neuro run net.yaml --with my_neuron.py"
    return f"{text}\n  hint: see '{context.command_path} --help'" if context else text
