"""One call of a function at a point of a sweep: of a module, of a script, or one that is registered as a study."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import runpy
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError, unknown
from neuro.core.extension import named_by_user
from neuro.core.registry import Registry
from neuro.core.values import shown
from neuro.sweeps.metrics import numbers

STUDIES: Registry[Callable[..., Any]] = Registry("study", (), group="neuro.studies")
"""Functions of a point's values, by name, to metrics: those of apps, and what a file given with `--with` registers."""


@dataclass(frozen=True)
class FunctionRun:
    """What a sweep over a function calls at each point.

    Attributes:
        name: of the function in its module, or of the study.
        module: where it is defined; "" of a study.
        file: of the module, where that is a script.
        source: hash of what it is written as.
        set: values that are the same in all runs.
        paths: where modules are looked for.
        here: the function itself, in the process in which the sweep was begun.
    """

    name: str
    module: str = ""
    file: str = ""
    source: str = ""
    set: Mapping[str, Any] | None = None
    paths: tuple[str, ...] = ()
    here: Callable[..., Any] | None = None

    def same(self) -> dict[str, Any]:
        """What decides what comes of a run."""
        return {"function": self.name, "source": self.source, "set": dict(self.set or {})}

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data, from which `from_dict` makes it."""
        words = {"name": self.name, "module": self.module, "file": self.file, "source": self.source}
        return {"kind": "function", **words, "set": dict(self.set or {}), "paths": list(self.paths)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> FunctionRun:
        """What `as_dict` has written."""
        words = {name: value for name, value in content.items() if name != "kind"}
        return cls(**{**words, "paths": tuple(words["paths"])})

    def named_by_user(self) -> FunctionRun:
        """Return the same call of the function in a file that the user named by `--with`; a study stays as it is.

        Raises:
            ModelError: the user named no such file, or it defines no such function.
        """
        if not self.module:
            return self
        file = self.file or f"{self.module.replace('.', os.sep)}.py"
        module = Path(named_by_user(file)).stem
        run = replace(self, module=module, file="", paths=())
        # A name such as "os.system" leads to a function that the file has imported.
        if getattr(run.function, "__module__", None) != module:
            raise ModelError(f"{file}: defines no function '{self.name}'")
        return run

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function, found in another process by what it is called.

        Raises:
            ModelError: it is not there.
        """
        if self.here is not None:
            return self.here
        if not self.module:
            if self.name not in STUDIES:
                raise unknown("study", self.name, STUDIES)
            return STUDIES[self.name]
        sys.path[:] = [*self.paths, *(path for path in sys.path if path not in self.paths)]
        found: Any
        if self.file:
            found = runpy.run_path(self.file, run_name="__mp_main__")
            found = found.get(self.name.partition(".")[0])
        else:
            found = getattr(importlib.import_module(self.module), self.name.partition(".")[0], None)
        for word in self.name.split(".")[1:]:
            found = getattr(found, word, None)
        if not callable(found):
            raise ModelError(f"{self.file or self.module}: has no function '{self.name}'")
        function: Callable[..., Any] = found
        return function

    @property
    def files(self) -> Iterable[str]:
        """The file that the function is defined in."""
        try:
            file = inspect.getsourcefile(self.function)
        except TypeError:
            file = None
        return [os.path.abspath(file)] if file and Path(file).exists() else []

    def check_inputs(self) -> None:
        """See whether the function can be found here and is what it was when the sweep began.

        Raises:
            ModelError: it is not.
        """
        if self.here is None and _source(self.function) != self.source:
            message = f"'{self.name}' was edited since the sweep began: expected the function that it was"
            raise ModelError(message, hint="a new folder is a new sweep")

    def check(self, point: Mapping[str, Any], seeded: bool) -> None:
        """Refuse names that the function does not take.

        Raises:
            ModelError: it takes others.
        """
        try:
            taken = inspect.signature(self.function).parameters
        except ValueError:
            return
        if any(each.kind is each.VAR_KEYWORD for each in taken.values()):
            return
        names = [name for name, each in taken.items() if each.kind in (each.KEYWORD_ONLY, each.POSITIONAL_OR_KEYWORD)]
        given = [*(self.set or {}), *point, *(["seed"] if seeded else [])]
        for name in given:
            if name not in names:
                raise unknown(f"parameter of {self.name}", name, names)
        for name in names:
            if name not in given and taken[name].default is inspect.Parameter.empty:
                hint = "'seeds' gives it" if name == "seed" else ""
                raise ModelError(f"{self.name} needs '{name}', which the space does not have", hint=hint)

    def __call__(self, point: Mapping[str, Any], seed: int | None) -> tuple[dict[str, Any], None, dict[str, Any]]:
        """Call it: metrics, nothing more to write, and what the record of the run has to say."""
        seeded = {} if seed is None else {"seed": seed}
        return numbers(self.function(**{**(self.set or {}), **point, **seeded}), "value"), None, seeded


def function_run(function: Any, set: Mapping[str, Any] | None = None, here: bool = False) -> FunctionRun:
    """What calls a function in this process and in others.

    Args:
        function: of a module or of a script, or the name of a study.
        set: values that are the same in all runs.
        here: whether it is called in this process alone.

    Raises:
        ModelError: it is none, other processes cannot find it, or the values have no names.
    """
    if set is not None and not isinstance(set, Mapping):
        raise ModelError(f"set = {shown(set)}: expected values by name")
    if isinstance(function, str):
        found = FunctionRun(function, set=set)
        return FunctionRun(function, source=_source(found.function), set=set)
    if not callable(function) or not hasattr(function, "__qualname__"):
        raise ModelError(f"function = {shown(function)}: expected a function")
    name, module = function.__qualname__, function.__module__
    script = getattr(sys.modules.get("__main__"), "__file__", None) if module == "__main__" else None
    where = os.path.abspath(script) if script else ""
    paths = tuple(os.path.abspath(path) for path in sys.path)
    run = FunctionRun(name, module, where, _source(function), set, paths, function)
    if not here:
        _check_found_elsewhere(run)
    return run


def _check_found_elsewhere(run: FunctionRun) -> None:
    if "<" in run.name or (run.module == "__main__" and not run.file):
        where = "inside another function" if "<locals>" in run.name else "where it is typed in"
        if "<lambda>" in run.name:
            where = "without a name"
        hint = 'write it into a file with a name; or on="here" calls it in this process, one run after the other'
        raise ModelError(f"{run.name}: is defined {where}, so other processes cannot find it", hint=hint)


def _source(function: Callable[..., Any]) -> str:
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):
        text = repr(getattr(getattr(function, "__code__", None), "co_code", ""))
    return hashlib.sha256(text.encode()).hexdigest()
