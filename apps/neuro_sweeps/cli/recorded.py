"""The recorded commands that `neuro rerun` may repeat, with the allowed options of each.

Anybody can write a record. So the command is parsed by its own parser, without running any callback. The parsed values
are checked and written as new arguments, and no text of the record reaches the new process unchecked.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from neuro import ModelError
from neuro.apps import extensions, named_by_user

__all__ = ["ALLOWED", "DROPPED", "command_of", "repeated"]

ALLOWED = {
    "report": "file out chip",
    "compare": "file backends duration seed threads set as_json out html rules",
    "doctor": "file duration backend seed set chip train drive reward_after as_json html",
    "events view": "source out most from_format sensor lenient",
    "sweep page": "folder out",
    "tune page": "folder out",
    "agent train": "environment out until steps episodes seed envs set",
    "agent watch": "file environment out seed learning",
    "agent compare": "environment steps seeds episodes out method set",
    "drone train": "scenario controller steps seed repeats out set",
    "drone watch": "model scenario controller out error path seed backend set",
    "drone compare": "scenario steps repeats seed starts path test_seed row more out json set",
    "recognise train": "method data out part preset seed backend set",
    "recognise watch": "model recording out several boxes allow assurance backend set",
    "recognise compare": "data out method part without folds repeats chips backend workers",
    "remus demo": "data out seed",
    "train": "file data input output out part without test backends folds epochs duration start scale window batch "
    "rate decay loss temperature surrogate slope trainable augment cost bits on prune neurons_per_core search budget "
    "device html seed threads set",
}
"""Allowed parameters by command: they read inputs, choose numbers, or name a file that is written into the new folder.

Other commands run code of their input (`convert --run-script`), use a network (`live`, `events listen`,
`sweep run --on`), or write no file to compare.
"""

DROPPED = ("force",)
"""Parameters that are dropped, since they only replace existing files."""

_MODULES = "environment"
"""Parameter that may name a module, as "module:Class"."""


def repeated(commands: Any, words: Sequence[str], place: Callable[[str], str]) -> list[str]:
    """Return the arguments that repeat a recorded command in a new folder.

    Args:
        commands: the group of all commands.
        words: words of the command, without "neuro".
        place: function that converts a path of the command to a path in the new folder.

    Raises:
        ModelError: the command, an option or a value is not allowed, or the command needs a Python file that the user
            did not name by `--with`.
    """
    name = next((text for n in (1, 2) if (text := " ".join(words[:n])) in ALLOWED), None)
    if name is None:
        raise _refusal(f"'neuro {' '.join(words[:2])}'", f"expected one of {', '.join(ALLOWED)}")
    path, arguments_given = name.split(), list(words[len(name.split()) :])
    command = command_of(commands, path)
    context = command.context_class(command, info_name=name)
    options, extra, _ = command.make_parser(context).parse_args(arguments_given)
    if extra:
        raise _refusal(f"'{extra[0]}' of 'neuro {name}'", "expected only its options and arguments")
    arguments = list[str]()
    for option, value in _values(command.get_params(context), options):
        if "--with" in option.opts:
            for file in value:
                named_by_user(file)
        elif option.name not in DROPPED:
            if option.name not in ALLOWED[name].split():
                raise _refusal(f"{option.opts[0]} of 'neuro {name}'", "expected an option that only reads or computes")
            texts = [place(_check_text(text, option)) for text in value if isinstance(text, str)]
            if option.param_type_name == "argument":
                arguments += texts
            else:
                path += [f"{option.opts[0]}={text}" for text in texts] or option.opts[:1]
    path += [f"--with={file}" for file in extensions()]
    return [*path, "--", *arguments]


def command_of(commands: Any, path: Sequence[str]) -> Any:
    """Return the command of a name, e.g. ["sweep", "page"]."""
    _, command, _ = commands.resolve_command(commands.context_class(commands), [path[0]])
    return command if len(path) == 1 else command.commands[path[1]]


def _values(params: Sequence[Any], options: dict[str, Any]) -> Iterator[tuple[Any, Sequence[Any]]]:
    """Yield the parameters of the recorded command with their values. The value of a flag is True."""
    for option in params:
        value = options.get(option.name)
        values = value if isinstance(value, list | tuple) else [value]
        if values and all(isinstance(item, str) or item is True for item in values):
            yield option, values


def _check_text(text: str, option: Any) -> str:
    if "://" in text:
        raise _refusal(f"the address {text}", "expected files")
    module, colon, _ = text.rpartition(":")
    if option.name == _MODULES and colon:
        named_by_user(f"{module.replace('.', os.sep)}.py")
    return text


def _refusal(entry: str, expected: str) -> ModelError:
    return ModelError(f"records {entry}, which is not repeated from a file: {expected}")
