"""Environments by name, and which of them an agent's file was trained in."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv, VectorEnv

from neuro import ModelError
from neuro.apps import extensions, hdf5, install, output, record_input, unknown
from neuro_agent.files import FORMAT

__all__ = ["bar_of", "check_remembered", "make", "make_many", "remember", "remembered", "why"]

for _name, _value in (("PYGAME_HIDE_SUPPORT_PROMPT", "1"), ("SDL_VIDEODRIVER", "dummy"), ("SDL_AUDIODRIVER", "dummy")):
    os.environ.setdefault(_name, _value)  # pygame greets on standard output, and looks for a screen that nobody needs

ATTRIBUTE = "environment"
MINIGRID = "minigrid"
"""The package that registers environments as MiniGrid-Empty-5x5-v0 when it is imported."""
_EXTRA = re.compile(r"gymnasium\[[\w-]+\]")


def make(name: str, frames: bool = False) -> gymnasium.Env[Any, Any]:
    """An environment.

    Args:
        name: the id of a registered one, "CartPole-v1"; "module:Id-v0" of one that a module registers when it is
            imported; or "module:Class", a class of a module. Modules of the current folder are found.
        frames: whether it is to render pictures, if it says that it can and takes `render_mode`.

    Raises:
        ModelError: there is none of that name, it needs a package that is not installed, or it cannot be made.
    """
    found = _find(name)
    with _told(name):
        made = partial(gymnasium.make, found) if isinstance(found, str) else found
        env: gymnasium.Env[Any, Any] = made()
        for space in ("observation_space", "action_space"):
            if not isinstance(getattr(env, space, None), gymnasium.Space):
                raise ModelError(f"environment '{name}': it has no {space}: expected a space of gymnasium")
        return made(render_mode="rgb_array") if frames and _renders(env) and _takes_mode(made) else env


def make_many(name: str, n: int) -> gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]:
    """An environment, or a vector of n of them.

    Raises:
        ModelError: as of `make`.
    """
    return make(name) if n == 1 else SyncVectorEnv([lambda: make(name)] * n)


def bar_of(name: str) -> float | None:
    """The mean return at which an environment counts as solved; None where it says none."""
    found = _find(name)
    return gymnasium.spec(found).reward_threshold if isinstance(found, str) else None


def _renders(env: gymnasium.Env[Any, Any]) -> bool:
    return "rgb_array" in (env.metadata or {}).get("render_modes", ())


def _takes_mode(made: Callable[..., Any]) -> bool:
    words = signature(made).parameters
    return "render_mode" in words or any(one.kind is one.VAR_KEYWORD for one in words.values())


def _find(name: str) -> Any:
    """The id of a registered environment, or the class that "module:Class" names."""
    module, _, inner = name.rpartition(":")
    module = module or (MINIGRID if inner.startswith("MiniGrid-") else "")
    own = vars(_imported(module, name)) if module else {}
    classes = {key: kind for key, kind in own.items() if isinstance(kind, type) and issubclass(kind, gymnasium.Env)}
    if inner in classes:
        return classes[inner]
    if inner not in gymnasium.registry:
        raise unknown("environment", inner, [*classes, *gymnasium.registry])
    return inner


def _imported(module: str, name: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path and module != MINIGRID:
        sys.path.append(here)  # the user's own files are found, and hide nothing
    try:
        found = importlib.import_module(module)
        file = getattr(found, "__file__", None) or ""
        if file and str(Path(file).parent) == here:  # `neuro rerun` takes it along
            record_input(file)
        return found
    except ModuleNotFoundError as error:
        if module.endswith(".py"):
            inner = name.rpartition(":")[2]
            raise ModelError(
                f"environment '{name}': found a file: expected a module", hint=f"write {module[:-3]}:{inner}"
            ) from None
        if error.name != module.partition(".")[0]:
            raise ModelError(
                f"environment '{name}': module '{module}' needs '{error.name}', which is not here"
            ) from None
        if module == MINIGRID:
            raise ModelError(f"environment '{name}': minigrid is not installed", hint=install("agent")) from None
        raise ModelError(
            f"environment '{name}': there is no module '{module}': expected one of the current folder or a package"
        ) from None
    except Exception as error:
        raise ModelError(f"environment '{name}': module '{module}' raised {_line(error)}") from error


@contextmanager
def _told(name: str) -> Iterator[None]:
    """Errors of making an environment in one line; gymnasium's warnings are of its own names and tell users nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"environment '{name}': {why(error)}") from error


def why(error: BaseException) -> str:
    """An error of an environment in one line; what is not installed with the command that installs it."""
    extra = _EXTRA.search(str(error))
    return _line(error) if extra is None else f"it needs {extra[0]}: pip install '{extra[0]}'"


def _line(error: BaseException) -> str:
    first = (str(error).splitlines() or [""])[0]
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def remember(path: Path, name: str) -> None:
    """Write into an agent's file in which environment it was trained.

    Raises:
        ModelError: it cannot be written.
    """
    import h5py

    with output(path, hdf5.kind(FORMAT)) as part:
        shutil.copyfile(path, part)
        with hdf5.disk(part, "r+b") as disk:
            with h5py.File(disk, "r+") as file:
                file.attrs[ATTRIBUTE] = json.dumps(name)
            disk.seal(FORMAT)


def remembered(path: Path) -> str:
    """The environment in which an agent's file was trained, "" where it does not say.

    Raises:
        ModelError: there is no such file, it is something else, or damaged.
    """
    with hdf5.reading(path, FORMAT) as file:
        return str(json.loads(file.attrs[ATTRIBUTE])) if ATTRIBUTE in file.attrs else ""


def check_remembered(path: Path, name: str) -> None:
    """Refuse the module that an agent's file names, as anybody may have written it, unless the user names it as well.

    Raises:
        ModelError: the module is not that of a file given by `--with`.
    """
    module = name.rpartition(":")[0]
    if module and module not in {Path(file).stem for file in extensions()}:
        message = f"{path}: was trained in '{name}', which runs the module {module}"
        raise ModelError(message, hint=f"say so, if you trust it: {name} behind the file, or --with {module}.py")
