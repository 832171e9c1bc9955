"""Environments by the names that the command line takes, and those that agents' files remember."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv, VectorEnv

from neuro import ModelError
from neuro.apps import extensions, find, hdf5, install, made, output, record_input, why
from neuro_agent.files import FORMAT

ATTRIBUTE = "environment"
MINIGRID = "minigrid"
"""The package that registers environments as MiniGrid-Empty-5x5-v0 when it is imported."""


def make(name: str, frames: bool = False) -> gymnasium.Env[Any, Any]:
    """An environment.

    Args:
        name: the id of a registered one, "CartPole-v1"; "module:Id-v0" of one that a module registers when it is
            imported; or "module:Class", a class of a module. Modules of the current folder are found.
        frames: whether it is to render pictures, if it says that it can and takes `render_mode`.

    Raises:
        ModelError: there is none of that name, it needs a package that is not installed, or it cannot be made.
    """
    env: gymnasium.Env[Any, Any] = made(_find(name), name, frames=frames)
    return env


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


def _find(name: str) -> Any:
    """The id of a registered environment, or the class that "module:Class" names."""
    module, _, inner = name.rpartition(":")
    module = module or (MINIGRID if inner.startswith("MiniGrid-") else "")
    own = vars(_imported(module, name)) if module else {}
    return find(inner, {key: kind for key, kind in own.items() if isinstance(kind, type)})


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
        raise ModelError(f"environment '{name}': module '{module}' raised {why(error)}") from error


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
