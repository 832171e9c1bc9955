"""Environments of Gymnasium: a single environment and a vector have the same form, a number of parallel episodes."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from inspect import signature
from math import isfinite
from pathlib import Path
from types import FrameType
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from neuro.coding.spaces import States, flat
from neuro.core.checks import check
from neuro.core.errors import ModelError, unknown
from neuro.core.extension import extensions
from neuro.core.lazy import taken_away
from neuro.core.quantities import Quantity
from neuro.core.registry import installed
from neuro.kernels import compile_report
from neuro.model.sections import World

for _name, _value in (("PYGAME_HIDE_SUPPORT_PROMPT", "1"), ("SDL_VIDEODRIVER", "dummy"), ("SDL_AUDIODRIVER", "dummy")):
    os.environ.setdefault(_name, _value)  # keeps pygame from printing to standard output and from opening a screen

_EXTRA = re.compile(r"gymnasium\[[\w-]+\]")


def environment_of(world: World, environment: Any = None, copies: int = 1) -> Any:
    """Return the environment of a description, or a vector of several copies.

    Args:
        world: the described world, which names an id, or a class of a file of the option `--with`.
        environment: an environment, a vector, or a class of environments; by default the described environment.
        copies: number of parallel environments.

    Raises:
        ModelError: there is no environment of that name, a package for it is not installed, or it cannot be made.
    """
    if environment is not None and not isinstance(environment, type):
        return environment
    name, options = world.environment.id, world.environment.options or {}
    kind = environment if environment is not None else find(name, _named_by_user())
    limit = world.episode

    def make() -> gymnasium.Env[Any, Any]:
        env = made(kind, name, options)
        return env if limit is None else gymnasium.wrappers.TimeLimit(env, limit)

    if world.process:
        return AsyncVectorEnv([make] * copies)
    return make() if copies == 1 else SyncVectorEnv([make] * copies)


def _named_by_user() -> dict[str, Any]:
    """Return the classes of the files of the option `--with`, by name."""
    modules = [sys.modules.get(Path(file).stem) for file in extensions()]
    return {name: kind for module in modules if module for name, kind in vars(module).items() if isinstance(kind, type)}


def find(name: str, classes: Mapping[str, Any]) -> Any:
    """Return the class of a name, or the id of a registered environment.

    Raises:
        ModelError: no class and no id has the name.
    """
    environments = {key: kind for key, kind in classes.items() if issubclass(kind, gymnasium.Env)}
    if name in environments:
        return environments[name]
    if name not in gymnasium.registry:
        _load_plugins(name.partition("/")[0])
    if name not in gymnasium.registry:
        error = unknown("environment", name, [*environments, *gymnasium.registry])
        raise error if error.suggestion else error.but(hint=f"use --with FILE.py if your FILE.py has the class {name}")
    return name


def _load_plugins(namespace: str) -> None:
    """Let installed packages register their environments: gymnasium 1.0 and later do not load plug-ins."""
    for entry in installed("gymnasium.envs"):
        if entry.name in (namespace, "__root__") and not taken_away(entry):
            try:
                plugin = entry.load()
                if callable(plugin):
                    plugin()
            except Exception as error:
                warnings.warn(f"the plug-in {entry.value} of gymnasium cannot be loaded: {_line(error)}", stacklevel=2)


def made(kind: Any, name: str, options: Mapping[str, Any] | None = None, frames: bool = False) -> Any:
    """Make an environment.

    Args:
        kind: id or class of the environment.
        name: name for messages.
        options: arguments of the environment.
        frames: whether it renders pictures, if it supports them and takes `render_mode`.

    Raises:
        ModelError: a package is not installed, the environment has no spaces, or it raises an error.
    """
    with reported(name):
        make: Any = partial(gymnasium.make, kind) if isinstance(kind, str) else kind
        make = partial(make, **(options or {}))
        env: gymnasium.Env[Any, Any] = make()
        for space in ("observation_space", "action_space"):
            if not isinstance(getattr(env, space, None), gymnasium.Space):
                raise ModelError(f"environment '{name}' has no {space}: expected a space of gymnasium")
        if not frames or "rgb_array" not in (env.metadata or {}).get("render_modes", ()):
            return env
        parameters = signature(make).parameters
        takes_mode = "render_mode" in parameters or any(p.kind is p.VAR_KEYWORD for p in parameters.values())
        return make(render_mode="rgb_array") if takes_mode else env


@contextmanager
def reported(name: str) -> Iterator[None]:
    """Report errors of making an environment in one line, and hide the warnings of gymnasium."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"environment '{name}': {why(error)}") from error


def why(error: BaseException) -> str:
    """Return an error of an environment in one line; for a missing package the command that installs it."""
    extra = _EXTRA.search(str(error))
    return _line(error) if extra is None else f"it needs {extra[0]}: pip install '{extra[0]}'"


def _line(error: BaseException) -> str:
    text = (str(error).splitlines() or [""])[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
_PATIENCE = Quantity("s", above=0, infinite=True)
_GIVE_UP = signal.SIGURG
"""A signal that nothing else sends, and that does nothing by default. Background jobs ignore SIGINT."""


class Environments:
    """Parallel episodes. An episode that has ended shows its last observation for a step; then another begins.

    Args:
        env: an environment, or a vector of environments.
        patience: time within which the environment must answer, s.

    Attributes:
        name: name of the environment.
        options: options with which gymnasium made the environment, if they are plain data.
        n: number of parallel episodes.
        observations: space of one observation.
        actions: space of one action.
        over: True for each episode that has ended and restarts at the next step.
        found: last observation of the environment, or observations of the vector.
        infos: last info of each episode.
        rewards: rewards of the last step, 0 where an episode begins, (n,).

    Raises:
        ModelError: `env` is no environment.
    """

    def __init__(self, env: Any, patience: float = 60.0) -> None:
        self._env, self.patience = env, float(check(_PATIENCE, patience, "patience"))
        self._vector = isinstance(env, VectorEnv)
        if not self._vector and not isinstance(env, gymnasium.Env):
            raise ModelError(f"env: found {type(env).__name__}: expected a gymnasium.Env or a VectorEnv")
        self.n = int(env.num_envs) if self._vector else 1
        self.observations = env.single_observation_space if self._vector else env.observation_space
        self.actions = env.single_action_space if self._vector else env.action_space
        mode = env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP) if self._vector else AutoresetMode.NEXT_STEP
        if mode not in (AutoresetMode.NEXT_STEP, AutoresetMode.NEXT_STEP.value):
            name = getattr(mode, "name", repr(mode))
            raise ModelError(f"env: a vector of autoreset_mode {name}: expected NEXT_STEP, gymnasium's default")
        spec = getattr(env, "spec", None)
        self.name = str(spec.id) if spec is not None else type(env).__name__
        self.options = {} if spec is None else _plain(spec.kwargs)
        self._states = States(self.observations)
        self.over: Bools = np.zeros(self.n, dtype=np.bool_)
        self.found: Any = None
        self.infos: tuple[Mapping[str, Any], ...] = ({},) * self.n
        self.rewards: Floats = np.zeros(self.n)
        self._calls = 0

    def reset(self, seeds: Sequence[int]) -> Floats:
        """Begin all episodes with the first seed, and return the first observations, (n, dimensions)."""
        answer, info = self._answer("reset", "observation, info", seed=int(seeds[0]))
        self._hear(info)
        self.over, self.rewards = np.zeros(self.n, dtype=np.bool_), np.zeros(self.n)
        return self._vectors(answer)

    def step(self, actions: npt.NDArray[Any] | list[Any], seeds: Sequence[int]) -> tuple[Floats, Floats, Bools, Bools]:
        """Take one step in each episode; an episode that is over returns the first observation of the next one.

        Args:
            actions: action for each episode; ignored for episodes that are over.
            seeds: seeds of the next episodes; vectors choose their own.

        Returns:
            observations (n, dimensions), rewards, terminated, truncated; the reward of an episode that was over is 0.
        """
        if self._vector:
            restarted = self.over
            answer, reward, ended, cut = self._step(actions)
            return self._checked(answer, np.where(restarted, 0.0, reward), ended & ~restarted, cut & ~restarted)
        if self.over[0]:
            return self.reset(seeds), np.zeros(1), np.zeros(1, np.bool_), np.zeros(1, np.bool_)
        return self._checked(*self._step(actions[0]))

    def _step(self, action: Any) -> tuple[Any, ...]:
        *answer, info = self._answer("step", "observation, reward, terminated, truncated, info", action)
        self._hear(info)
        return tuple(answer)

    def _hear(self, info: Any) -> None:
        """Store the info of the environment. The arrays of a vector's info have an entry for each episode."""
        if type(info) is not dict and not isinstance(info, Mapping):
            raise ModelError(f"env returned info of type {type(info).__name__}: expected a dictionary")
        if not self._vector:
            self.infos = (info,)
            return
        if not info:  # so for most vectors, in each step
            self.infos = ({},) * self.n
            return
        arrays = {word: values for word, values in info.items() if not word.startswith("_")}
        self.infos = tuple(
            {word: values[k] for word, values in arrays.items() if len(values) > k} for k in range(self.n)
        )

    def _answer(self, name: str, expected: str, *arguments: Any, **keywords: Any) -> tuple[Any, ...]:
        self._calls += 1
        try:
            answer = getattr(self._env, name)(*arguments, **keywords)
        except (ModelError, KeyboardInterrupt):
            raise
        except Exception as error:
            raise ModelError(f"env.{name} raised {type(error).__name__}: {error}") from error
        self._calls += 1
        if not isinstance(answer, tuple) or len(answer) != 1 + expected.count(","):
            size = f"{len(answer)} values" if isinstance(answer, tuple) else type(answer).__name__
            raise ModelError(f"env.{name} returned {size}: expected ({expected})")
        return answer

    def _checked(self, answer: Any, reward: Any, ended: Any, cut: Any) -> tuple[Floats, Floats, Bools, Bools]:
        if (
            type(reward) is float
            and type(ended) is bool
            and type(cut) is bool
            and isfinite(reward)
            and not self._vector
        ):
            # This is the usual case; the checks of arrays would take ten times as long.
            self.over = np.array([ended or cut])
            self.rewards = np.array([reward])
            return self._vectors(answer), self.rewards, np.array([ended]), np.array([cut and not ended])
        try:
            rewards = np.asarray(reward, dtype=np.float64).reshape(self.n)
        except (TypeError, ValueError, OverflowError):
            raise ModelError(f"env.step returned the reward {reward!r}: expected a number") from None
        is_valid = np.isfinite(rewards)
        if np.count_nonzero(is_valid) < self.n:
            raise ModelError(f"env.step returned the reward {rewards[~is_valid][0]:g}: expected a finite number")
        ends, cuts = self._flags("terminated", ended), self._flags("truncated", cut)
        self.over, self.rewards = ends | cuts, rewards
        return self._vectors(answer), rewards, ends, cuts & ~ends

    def _flags(self, name: str, answer: Any) -> Bools:
        flags = np.array([answer]) if isinstance(answer, bool) else np.asarray(answer)
        if flags.size != self.n or flags.dtype.kind not in "bui":
            raise ModelError(f"env.step returned {name} = {answer!r}: expected True or False")
        return flags.astype(np.bool_).reshape(self.n)

    def _vectors(self, answer: Any) -> Floats:
        self.found = answer
        return self._states.check(flat(self.observations, answer, self.n if self._vector else 0))

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Stop with an error if a call of the environment does not return within `patience`; main thread only.

        The time begins anew after each kernel that is compiled: an environment may compile its own in the first step.
        """
        if threading.current_thread() is not threading.main_thread() or not np.isfinite(self.patience):
            yield
            return
        over, hung, main = threading.Event(), threading.Event(), threading.get_ident()

        def look() -> None:
            calls, since = self._calls, time.monotonic()
            while not over.wait(min(1.0, self.patience / 4)):
                if self._calls != calls or self._calls % 2 == 0:
                    calls, since = self._calls, time.monotonic()
                elif time.monotonic() - max(since, compile_report.latest()) > self.patience:
                    hung.set()
                    # A signal of the system also ends a call that waits for a clock or a socket.
                    signal.pthread_kill(main, _GIVE_UP)
                    return

        def give_up(number: int, frame: FrameType | None) -> None:
            if hung.is_set():
                raise _Hung

        previous = signal.signal(_GIVE_UP, give_up)
        watcher = threading.Thread(target=look, daemon=True)
        watcher.start()
        try:
            try:
                yield
            finally:
                over.set()
                watcher.join()
        except _Hung:
            message = f"env: a call has not returned for {self.patience:g} s: expected an answer"
            raise ModelError(message, hint="set patience= to a longer time") from None
        finally:
            signal.signal(_GIVE_UP, signal.SIG_DFL if previous is None else previous)


class _Hung(BaseException):
    """A call of an environment does not return. An `except Exception` of the environment does not catch this error."""


def _plain(options: Mapping[str, Any]) -> dict[str, Any]:
    plain_options = {}
    for name, value in options.items():
        with suppress(TypeError, ValueError):
            plain_options[name] = json.loads(json.dumps(value))
    plain_options.pop("render_mode", None)
    return plain_options
