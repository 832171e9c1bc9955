"""Run Python files of the user, which register parts, before a command."""

from __future__ import annotations

import shlex
import sys
import warnings
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from neuro.core.errors import ModelError, Where
from neuro.core.inputs import existing
from neuro.core.registry import registered

__all__ = ["extensions", "named_by_user", "run_extension", "run_extensions"]

_run: dict[Path, bytes] = {}
"""Contents of the files that have run, by path."""


def run_extension(file: Any) -> None:
    """Run a Python file as a module of the same name. The file registers parts.

    A file that has run in this process is not run again.

    Args:
        file: path of the file.

    Raises:
        ModelError: the file cannot be read, has the name of another module, was edited since the first run, or has a
            mistake; the error has the line of the mistake.
    """
    path = existing(file, "a Python file")
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    resolved = path.resolve()
    if resolved in _run:
        if _run[resolved] != text:
            raise ModelError(f"{path}: was edited since it was run: expected a new start")
        return
    _check_name(path, resolved)
    n_registered = registered()
    _execute(path, text)
    _run[resolved] = text
    if registered() == n_registered and not _has_environment(sys.modules[path.stem]):
        warnings.warn(
            f"{path}: registers nothing\n  hint: write @neuro.register above a class, or neuro.register(part)",
            stacklevel=2,
        )


def _has_environment(module: ModuleType) -> bool:
    """Return whether a file defines an environment; environments are not registered."""
    bases = (base for kind in vars(module).values() if isinstance(kind, type) for base in kind.__mro__)
    return any(base.__module__ == "gymnasium.core" and base.__name__ == "Env" for base in bases)


def extensions() -> tuple[str, ...]:
    """Return the files that have run, so that new processes can run them again."""
    return tuple(map(str, _run))


def named_by_user(file: str) -> str:
    """Return the file of the option `--with` with the same name as a recorded file.

    A record never runs code by itself. Only the name of the recorded path is used; the code comes from the user's file.

    Raises:
        ModelError: no option `--with` has a file of that name.
    """
    for path in extensions():
        if Path(path).name == Path(file).name:
            return path
    raise ModelError(f"it was made with {file}", hint=f"if you trust this file, add --with {shlex.quote(file)}")


def run_extensions(files: tuple[str, ...]) -> None:
    """Run the files of another process, without their warnings, which that process has printed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for file in files:
            run_extension(file)


def _check_name(path: Path, resolved: Path) -> None:
    """Refuse a file that is no module, or has the name of another module."""
    name = path.stem
    if path.suffix != ".py" or not name.isidentifier():
        raise ModelError(f"{path}: expected a Python file with a plain name, such as my_filter.py")
    module = sys.modules.get(name) or PathFinder.find_spec(name)
    origin = getattr(module, "__file__", None) or getattr(module, "origin", None)
    if name in sys.stdlib_module_names or (module is not None and Path(origin or "").resolve() != resolved):
        raise ModelError(f"{path}: '{name}' is the name of another module: expected another name")


def _execute(path: Path, text: bytes) -> None:
    """Run the text of a file as the module of its name. Errors have the line of the file."""
    spec = spec_from_file_location(path.stem, path.resolve())
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    if str(path.resolve().parent) not in sys.path:
        sys.path.append(str(path.resolve().parent))  # modules in the file's folder can be imported, after all others
    try:
        exec(compile(text, str(path.resolve()), "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[path.stem]
        raise _located(error, path, module) from None


def _located(error: BaseException, path: Path, module: ModuleType) -> ModelError:
    """Convert an exception of the file to a ModelError with the line of the mistake."""
    if isinstance(error, SyntaxError) and error.filename == module.__file__:
        return ModelError(error.msg, where=Where(str(path), error.lineno or 0, error.offset or 0))
    if isinstance(error, ModelError) and error.where is not None and error.where.file != path.name:
        return error
    line, trace = 0, error.__traceback__
    while trace is not None:
        line = trace.tb_lineno if trace.tb_frame.f_code.co_filename == module.__file__ else line
        trace = trace.tb_next
    place = Where(str(path), line)
    if isinstance(error, ModelError):
        return error.but(where=place)
    return ModelError(f"{type(error).__name__}: {error}".removesuffix(": "), where=place)
