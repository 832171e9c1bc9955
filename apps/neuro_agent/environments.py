"""Environments by name on the command line, and their names in agent files."""

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
"""Package that registers environments such as MiniGrid-Empty-5x5-v0 when it is imported."""


def make(name: str, frames: bool = False) -> gymnasium.Env[Any, Any]:
    """Make an environment.

    Args:
        name: an id of gymnasium, e.g. "CartPole-v1"; "module:Id-v0", an id that a module registers when imported; or
            "module:Class", a class of a module. Modules in the current folder are found.
        frames: whether to render pictures, if the environment supports it and accepts `render_mode`.

    Raises:
        ModelError: the name is unknown, a package is missing, or the environment cannot be made.
    """
    env: gymnasium.Env[Any, Any] = made(_find(name), name, frames=frames)
    return env


def make_many(name: str, n: int) -> gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]:
    """Make an environment, or a vector of n environments.

    Raises:
        ModelError: see `make`.
    """
    return make(name) if n == 1 else SyncVectorEnv([lambda: make(name)] * n)


def bar_of(name: str) -> float | None:
    """Return the mean return at which an environment counts as solved; None if it has no reward threshold."""
    kind = _find(name)
    return gymnasium.spec(kind).reward_threshold if isinstance(kind, str) else None


def _find(name: str) -> Any:
    """Return the id of a registered environment, or the class that "module:Class" names."""
    module, _, inner = name.rpartition(":")
    module = module or (MINIGRID if inner.startswith("MiniGrid-") else "")
    namespace = vars(_imported(module, name)) if module else {}
    return find(inner, {key: kind for key, kind in namespace.items() if isinstance(kind, type)})


def _imported(module: str, name: str) -> Any:
    folder = str(Path.cwd())
    if folder not in sys.path and module != MINIGRID:
        sys.path.append(folder)  # last, so that files of the user do not hide packages
    try:
        imported = importlib.import_module(module)
        file = getattr(imported, "__file__", None) or ""
        if file and str(Path(file).parent) == folder:  # for `neuro rerun`, which copies the file
            record_input(file)
        return imported
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
    """Write the name of the environment of the training into an agent's file.

    Raises:
        ModelError: the file cannot be written.
    """
    import h5py

    with output(path, hdf5.kind(FORMAT)) as part:
        shutil.copyfile(path, part)
        with hdf5.disk(part, "r+b") as disk:
            with h5py.File(disk, "r+") as file:
                file.attrs[ATTRIBUTE] = json.dumps(name)
            disk.seal(FORMAT)


def remembered(path: Path) -> str:
    """Return the environment in which an agent was trained, "" if the file names none.

    Raises:
        ModelError: the file does not exist, is damaged, or is no agent.
    """
    with hdf5.reading(path, FORMAT) as file:
        return str(json.loads(file.attrs[ATTRIBUTE])) if ATTRIBUTE in file.attrs else ""


def check_remembered(path: Path, name: str) -> None:
    """Refuse a module that only the agent's file names, since running it could run anybody's code.

    Raises:
        ModelError: no file given by `--with` has the module's name.
    """
    module = name.rpartition(":")[0]
    if module and module not in {Path(file).stem for file in extensions()}:
        message = f"{path}: was trained in '{name}', which runs the module {module}"
        raise ModelError(message, hint=f"if you trust the module: {name} after the file, or --with {module}.py")
