"""An agent in environments: training, tests without learning, and what must fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Bar, Checkpoint, Quantity, check, check_output, hdf5
from neuro_agent import files
from neuro_agent.environments import Environments
from neuro_agent.log import Log, Test

if TYPE_CHECKING:
    from neuro_agent.agent import ActorCritic

__all__ = ["CONTROLS", "Course", "episode_seed", "test", "train"]

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

BLOCK = 20_000
"""Control steps after which all episodes are cut off and the network begins at time 0, with what it has learnt.

So all that a training needs to go on is weights and counts; it goes on so whether it was interrupted or not.
"""
MERGE = 16
"""Control steps after which copies of a network that learn side by side add up what they have learnt."""
CONTROLS = ("shuffled", "frozen", "random", "scrambled")
"""What must fail: errors of other times, no learning, an actor that ignores its input, places permuted at each step."""
TESTS = 1 << 40
"""Seeds of tests begin here: no training comes so far."""


def episode_seed(seed: int, number: int) -> int:
    """The seed of an episode of an environment; environments take 32 bits."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


class Course:
    """A training: how far it is, and what it does at each control step.

    Args:
        agent: learns.
        env: in which.
        control: the name of a control, see `CONTROLS`, or "".

    Attributes:
        log: of its episodes.
        steps: control steps of all environments.
    """

    def __init__(self, agent: ActorCritic, env: Environments, control: str = "") -> None:
        self.agent, self.env, self.control = agent, env, control
        self.log, self.steps, self.episodes, self.blocks = Log(), 0, 0, 0
        self.rng = np.random.default_rng([agent.seed, 1])

    def arrays(self) -> dict[str, Any]:
        """All that it needs to go on."""
        counts = np.array([self.steps, self.episodes, self.blocks, self.log.solved], dtype=np.int64)
        return {"counts": counts, "log": self.log.arrays(), **files.arrays_of(self.agent)}

    def go_on(self, arrays: dict[str, Any]) -> None:
        """Go on from `arrays`, if there are any."""
        if arrays:
            self.steps, self.episodes, self.blocks, solved = arrays["counts"].tolist()
            self.log = Log.of(arrays["log"], bool(solved))
            files.put_arrays(self.agent, arrays)

    def explore(self) -> None:
        """Move at random, before anything is learnt: see which observations and rewards there are."""
        agent, env = self.agent, self.env
        if agent.explored:
            return
        env.actions.seed(agent.seed)
        seen, rewards = [env.reset(self._seeds())], list[float]()
        while len(seen) * env.n <= agent.settings.explore or (not any(rewards) and len(seen) < BLOCK):
            begins = env.over.copy()
            now, reward, _, _ = env.step([env.actions.sample() for _ in range(env.n)], self._seeds(begins))
            seen.append(now)
            rewards += reward[~begins].tolist()
            self.steps += int((~begins).sum())
        agent.places.learn(np.concatenate(seen))
        agent.rewards.learn(rewards)
        agent.explored = True

    def _seeds(self, begins: Bools | None = None) -> list[int]:
        """Seeds of the episodes that begin."""
        seeds = []
        for k in range(self.env.n):
            self.episodes += begins is None or bool(begins[k])
            seeds.append(episode_seed(self.agent.seed, self.episodes))
        return seeds

    def block(self, done: Callable[[Log], bool], most: int) -> None:
        """Learn for a block of control steps, or until it is done."""
        agent, env, s = self.agent, self.env, self.agent.settings
        agent.begin(env.n, block=self.blocks)
        seen = env.reset(self._seeds())
        total, length = np.zeros(env.n), np.zeros(env.n, dtype=np.int64)
        reward, value = np.zeros(env.n), np.zeros(env.n)
        begins, ended = np.ones(env.n, dtype=np.bool_), np.zeros(env.n, dtype=np.bool_)
        before = agent.weights if env.n > 1 else None
        for k in range(-(-min(BLOCK, most) // env.n)):
            shown = self.rng.permuted(seen, axis=1) if self.control == "scrambled" else seen
            found = agent.decide(shown)
            # What a state is worth follows a cut-off, and nothing an end; of what has just begun nothing is known.
            errors = np.where(begins, 0.0, reward + np.where(ended, 0.0, s.discount * found.values) - value)
            agent.teach(self._taught(errors))
            if env.over.any():
                agent.forget(env.over)
            acted = [agent.actions.action(each) for each in self._winners(found.winners)]
            begins = env.over.copy()
            seen, reward, ended, cut = env.step(acted, self._seeds(begins))
            total, length = total + reward, length + ~begins
            self.steps += int((~begins).sum())
            reward, value = reward * agent.rewards.factor, found.values
            for which in np.flatnonzero(ended | cut):
                self.log.add(float(total[which]), int(length[which]), self.steps)
                total[which], length[which] = 0.0, 0
            if before is not None and k % MERGE == MERGE - 1:
                before = agent.merge(before)
            if (ended | cut).any() and done(self.log):
                break
        self.blocks += 1

    def _taught(self, errors: Floats) -> Floats:
        """The errors, or what a control has in their place."""
        if self.control == "frozen":
            return np.zeros_like(errors)
        if self.control == "shuffled":
            self._kept = np.append(getattr(self, "_kept", np.zeros(0)), errors)[-1000:]
            return self.rng.choice(self._kept, errors.shape)
        return errors

    def _winners(self, winners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        if self.control != "random":
            return winners
        sizes = self.agent.actions.sizes
        return np.stack([self.rng.integers(n, size=len(winners)) for n in sizes], axis=1)


@dataclass(frozen=True, slots=True)
class End:
    """When a training ends: at what comes first.

    Attributes:
        until: the mean return of the last `window` episodes.
        steps, episodes: how many there may be.
        window: episodes of that mean.
    """

    until: float | None = None
    steps: int | None = None
    episodes: int | None = None
    window: int = 100

    def __post_init__(self) -> None:
        if self.until is None and self.steps is None and self.episodes is None:
            raise ModelError("train: found no end: expected until, steps or episodes", hint="until=475.0")
        for name, value in (("steps", self.steps), ("episodes", self.episodes), ("window", self.window)):
            if value is not None:
                check(Quantity(kind="integer", at_least=1), value, f"train: {name}")

    def reached(self, log: Log) -> bool:
        """Whether a training has ended by its episodes."""
        log.solved = log.solved or (
            self.until is not None and len(log) >= self.window and log.mean(self.window) >= self.until
        )
        return log.solved or (self.episodes is not None and len(log) >= self.episodes)


def checkpoint(agent: ActorCritic, out: Path, env: Any) -> Checkpoint:
    """That of a training, beside the file of the agent."""
    told = {"seed": agent.seed, "environments": Environments(env).n, **files.plain_of(agent)}
    return Checkpoint(out, "neuro agent training 1", told)


def train(
    agent: ActorCritic,
    env: Any,
    end: End,
    *,
    patience: float = 60.0,
    progress: bool = False,
    out: Path | None = None,
    control: str = "",
) -> Log:
    """Train an agent, see `ActorCritic.train`."""
    worlds = _fitting(agent, env, patience)
    course = Course(agent, worlds, control)
    kept = None if out is None else checkpoint(agent, out, env)
    if out is not None and kept is not None:
        check_output(out, hdf5.kind(files.FORMAT))
        course.go_on(kept.resume())
    with worlds.watched(), Bar() as bar:
        course.explore()
        while not end.reached(course.log) and (end.steps is None or course.steps < end.steps):
            course.block(end.reached, BLOCK if end.steps is None else end.steps - course.steps)
            if progress:
                mean = f"mean return of the last {min(len(course.log), end.window)}: {course.log.mean(end.window):g}"
                bar.show(course.steps, end.steps or course.steps, f"{len(course.log)} episodes, {mean}")
            if kept is not None:
                kept.keep(**course.arrays())
    return course.log


def _fitting(agent: ActorCritic, env: Any, patience: float) -> Environments:
    worlds = Environments(env, patience)
    for what, known, found in (
        ("observations", agent.observations, worlds.observations),
        ("actions", agent.actions.space, worlds.actions),
    ):
        if known != found:
            raise ModelError(f"env: its {what} are {found}: expected {known}, for which the agent was made")
    return worlds


def test(agent: ActorCritic, env: Any, episodes: int, seed: int, backend: str, patience: float) -> Test:
    """Episodes without learning, see `ActorCritic.test`."""
    worlds = _fitting(agent, env, patience)
    if worlds.n != 1:
        raise ModelError(f"test: a vector of {worlds.n} environments: expected one", hint="gymnasium.make")
    frozen = agent.frozen(seed, backend)
    returns, lengths = np.zeros(episodes), np.zeros(episodes, dtype=np.int64)
    with worlds.watched():
        for k in range(episodes):
            seen = worlds.reset([episode_seed(seed, TESTS + k)])
            while not worlds.over[0]:
                winners = frozen.decide(seen)
                seen, reward, _, _ = worlds.step([agent.actions.action(winners[0])], [0])
                returns[k] += reward[0]
                lengths[k] += 1
    return Test(returns, lengths)
