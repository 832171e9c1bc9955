"""An agent in environments: training, tests without learning, and what must fail."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import (
    Bar,
    Checkpoint,
    End,
    Environments,
    Log,
    Quantity,
    Sums,
    Test,
    check,
    check_output,
    episode_seed,
    hdf5,
)
from neuro_agent import files
from neuro_agent.network import SEED

if TYPE_CHECKING:
    from neuro_agent.learner import Learner


Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

BLOCK = 10_000
"""Control steps of an environment after which all episodes are cut off and the network begins at time 0.

It keeps what it has learnt. So all that a training needs to go on is weights and counts; it goes on so whether it was
interrupted or not.
"""
MERGE = 16
"""Control steps after which copies of a network that learn side by side add up what they have learnt."""
CONTROLS = ("shuffled", "frozen", "random", "scrambled")
"""What must fail: errors of other times, no learning, an actor that ignores its input, places permuted at each step."""
KEPT = 1000
"""Errors from the begin of a training that the control `shuffled` draws from."""
SEEN = 500
"""Observations of the last control steps that an agent keeps."""
SPARSE = 10
"""Where no reward comes, random moves go on for so many times as many control steps."""
MOST = 10_000
"""Control steps after which an episode of a test that does not end is cut off."""
TESTS = 1 << 40
"""Seeds of tests begin here: no training comes so far."""


class Decides(Protocol):
    """A frozen agent."""

    def decide(self, observations: Floats) -> npt.NDArray[np.int64]:
        """The neuron of each circuit for one observation, (1, circuits)."""


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

    def __init__(self, agent: Learner, env: Environments, control: str = "") -> None:
        self.agent, self.env, self.control = agent, env, control
        self.log, self.steps = Log(), 0
        self._none, self._kept = [0] * env.n, np.zeros(0)
        self.rng = np.random.default_rng([agent.seed, 1])

    def arrays(self) -> dict[str, Any]:
        """All that it needs to go on."""
        counts = np.array([self.steps], dtype=np.int64)
        return {"counts": counts, "log": self.log.arrays(), **files.arrays_of(self.agent)}

    def go_on(self, arrays: dict[str, Any]) -> None:
        """Go on from `arrays`, if there are any."""
        if arrays:
            self.steps = int(arrays["counts"][0])
            self.log = Log.of(arrays["log"])
            files.put_arrays(self.agent, arrays)

    def explore(self, end: End) -> None:
        """Move at random, before anything is learnt: see which observations and rewards there are."""
        agent, env = self.agent, self.env
        if agent.explored:
            return
        env.actions.seed(agent.seed)
        seen, least = [env.reset(self._seeds())], agent.settings.explore
        sums, rewards, some = Sums(env.n), list[float](), False
        while self.steps < (least if some else SPARSE * least) and not end.reached(self.log):
            if end.steps is not None and self.steps >= end.steps:
                break
            begins = env.over
            drawn = np.stack([env.actions.sample() for _ in range(env.n)])
            now, reward, _, _ = env.step(drawn, self._seeds(begins))
            seen.append(now)
            self._count(begins)
            sums.add(self.log, self.steps, reward, begins, env.over)
            rewards += reward[~begins].tolist()
            some |= bool(reward.any())
        agent.places.learn(np.concatenate(seen))
        agent.rewards.learn(rewards, self.log.returns.tolist())
        agent.explored = self.steps >= least  # a training that ends before has learnt nothing: the next explores anew

    def _count(self, begins: Bools) -> None:
        """Count a control step of all."""
        self.steps += self.env.n - int(np.count_nonzero(begins))

    def _seeds(self, begins: Bools | None = None) -> list[int]:
        """Seeds of the episodes that begin."""
        if begins is not None and not np.count_nonzero(begins):
            return self._none
        seeds = []
        for k in range(self.env.n):
            episodes, blocks = self.agent.begun
            self.agent.begun = episodes + int(begins is None or bool(begins[k])), blocks
            seeds.append(episode_seed(self.agent.seed, self.agent.begun[0]))
        return seeds

    def block(self, end: End, show: Callable[[Course], None]) -> None:
        """Learn for a block of control steps, or to the end of the training."""
        agent, env, s = self.agent, self.env, self.agent.settings
        most = BLOCK * env.n if end.steps is None else min(BLOCK * env.n, end.steps - self.steps)
        agent.begin(env.n, block=agent.begun[1])
        agent.begun = agent.begun[0], agent.begun[1] + 1
        seen = env.reset(self._seeds())
        sums = Sums(env.n)
        reward, value = np.zeros(env.n), np.zeros(env.n)
        begins, ended = np.ones(env.n, dtype=np.bool_), np.zeros(env.n, dtype=np.bool_)
        before = agent.weights if env.n > 1 else None
        shown_last: deque[Floats] = deque(maxlen=SEEN)
        for k in range(-(-most // env.n)):
            shown_last.append(seen[0])
            found = agent.decide(seen, self.rng if self.control == "scrambled" else None)
            # What a state is worth follows a cut-off, and nothing an end; of what has just begun nothing is known.
            errors = (reward + s.discount * found.values * ~ended - value) * ~begins
            agent.teach(self._taught(errors))
            begins = env.over
            if np.count_nonzero(begins):
                agent.forget(begins)
            seen, reward, ended, _ = env.step(agent.actions.of(self._winners(found.winners)), self._seeds(begins))
            self._count(begins)
            if not agent.rewards.known and reward.any():  # the scale is that of the first rewards: all before were 0
                first = reward[~begins]
                agent.rewards.learn([0.0] * (self.steps - first.size) + first.tolist(), self.log.returns.tolist())
            over = sums.add(self.log, self.steps, reward, begins, env.over)
            value = found.values
            share = agent.rewards.excess(value, reward)
            if share < 1.0:
                if before is not None:
                    agent.merge(before)
                agent.shrink(share)
                before, value = before and agent.weights, value * share
            reward = reward * agent.rewards.factor
            if agent.novelty:
                reward = reward + agent.novelty.of(seen)
            if before is not None and k % MERGE == MERGE - 1:
                before = agent.merge(before)
            if over:
                show(self)
                if end.reached(self.log):
                    break
        if before is not None:
            agent.merge(before)
        agent.seen = np.array(shown_last)

    def _taught(self, errors: Floats) -> Floats:
        """The errors, or what a control has in their place."""
        if self.control == "frozen":
            return np.zeros_like(errors)
        if self.control == "shuffled":
            # Of a fixed set: errors of the last steps would report how well the agent does, and so teach.
            if self._kept.size < KEPT:
                self._kept = np.append(self._kept, errors)
            return self.rng.choice(self._kept, errors.shape)
        return errors

    def _winners(self, winners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        if self.control != "random":
            return winners
        sizes = self.agent.actions.sizes
        return np.stack([self.rng.integers(n, size=len(winners)) for n in sizes], axis=1)


def checkpoint(agent: Learner, out: Path, env: Any) -> Checkpoint:
    """That of a training, beside the file of the agent."""
    worlds = Environments(env)
    told = {"seed": agent.seed, "environment": worlds.name, "options": worlds.options, "environments": worlds.n}
    told |= files.plain_of(agent)
    return Checkpoint(out, "neuro agent training 1", told)


def train(
    agent: Learner,
    env: Any,
    end: End,
    *,
    patience: float = 60.0,
    progress: bool = False,
    out: Path | None = None,
    control: str = "",
) -> Log:
    """Train an agent, see `ActorCritic.train`."""
    worlds = fitting(agent, env, patience)
    course, kept = Course(agent, worlds, control), None
    if out is not None:
        check_output(out, hdf5.kind(files.FORMAT))
        kept = checkpoint(agent, out, env)
        course.go_on(kept.resume())

    def show(course: Course) -> None:
        if progress:
            mean = f"mean return of the last {min(len(course.log), end.window)}: {course.log.mean(end.window):g}"
            bar.show(course.steps, end.steps or course.steps, f"{len(course.log)} episodes, {mean}")

    with worlds.watched(), Bar() as bar:
        course.explore(end)
        while not end.reached(course.log) and (end.steps is None or course.steps < end.steps):
            course.block(end, show)
            if kept is not None:
                kept.keep(**course.arrays())
    return course.log


def fitting(agent: Learner, env: Any, patience: float) -> Environments:
    """Return the environments, whose spaces must be those for which the agent was made."""
    worlds = Environments(env, patience)
    for what, known, found in (
        ("observations", agent.observations, worlds.observations),
        ("actions", agent.actions.space, worlds.actions),
    ):
        if known != found:
            raise ModelError(f"env: its {what} are {found}: expected {known}, for which the agent was made")
    return worlds


def test(
    agent: Learner,
    env: Any,
    made: Callable[[], Decides],
    episodes: int,
    seed: int,
    patience: float,
    most: int,
) -> Test:
    """Episodes without learning, see `ActorCritic.test`; `made` makes what decides."""
    whole = Quantity(kind="integer", at_least=1)
    episodes, most = check(whole, episodes, "test: episodes"), check(whole, most, "test: most")
    check(SEED, seed, "test: seed")
    worlds = fitting(agent, env, patience)
    if worlds.n != 1:
        raise ModelError(f"test: a vector of {worlds.n} environments: expected one", hint="gymnasium.make")
    frozen = made()
    returns, lengths = np.zeros(episodes), np.zeros(episodes, dtype=np.int64)
    with worlds.watched():
        for k in range(episodes):
            seen = worlds.reset([episode_seed(seed, TESTS + k)])
            while not worlds.over[0] and lengths[k] < most:
                winners = frozen.decide(seen)
                seen, reward, _, _ = worlds.step(agent.actions.of(winners), [0])
                returns[k] += reward[0]
                lengths[k] += 1
    return Test(returns, lengths)
