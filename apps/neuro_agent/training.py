"""An agent in environments: training, tests without learning, and what must fail."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop, ModelError
from neuro.apps import (
    MOST as MOST,
    TESTS as TESTS,
    Checkpoint,
    End,
    Environments,
    Log,
    Moment,
    Quantity,
    TemporalDifference,
    Test,
    check,
    check_output,
    episode_seed as episode_seed,
    hdf5,
)
from neuro_agent import files
from neuro_agent.network import SEED

if TYPE_CHECKING:
    from neuro_agent.learner import Learner


Floats = npt.NDArray[np.float64]

BLOCK = 10_000
"""Control steps of an environment after which all episodes are cut off and the network begins at time 0.

It keeps what it has learnt. So all that a training needs to go on is weights and counts; it goes on so whether it was
interrupted or not.
"""
CONTROLS = ("shuffled", "frozen", "random", "scrambled")
"""What must fail: errors of other times, no learning, an actor that ignores its input, places permuted at each step."""
KEPT = 1000
"""Errors from the begin of a training that the control `shuffled` draws from."""
SEEN = 500
"""Observations of the last control steps that an agent keeps."""


class Decides(Protocol):
    """A frozen agent."""

    def decide(self, observations: Floats) -> npt.NDArray[np.int64]:
        """The neuron of each circuit for one observation, (1, circuits)."""


class _Pilot:
    """An agent as what acts in a closed loop, and learns or is kept from it.

    Args:
        agent: learns.
        control: the name of a control, see `CONTROLS`, or "".
    """

    def __init__(self, agent: Learner, control: str = "") -> None:
        self._agent, self._control = agent, control
        self._kept = np.zeros(0)
        self._difference = TemporalDifference(agent.rewards, agent.settings.discount)
        self._rng = np.random.default_rng([agent.seed, 1])
        self._shown: deque[Floats] = deque(maxlen=SEEN)

    def begin(self, copies: int, block: int) -> None:
        """Begin a block, with all that was learnt before."""
        self._agent.begin(copies, block=block)
        self._before = self._agent.weights if copies > 1 else None
        self._difference.begin(copies)
        self._shown.clear()

    def act(self, seen: Floats, infos: Any) -> npt.NDArray[Any]:
        """Judge and choose."""
        agent = self._agent
        self._shown.append(seen[0])
        self._decision = agent.decide(seen, self._rng if self._control == "scrambled" else None)
        winners = self._decision.winners
        if self._control == "random":
            winners = np.stack([self._rng.integers(n, size=len(winners)) for n in agent.actions.sizes], axis=1)
        return agent.actions.of(winners)

    def explored(self, seen: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Learn bounds and scales from random moves."""
        self._agent.places.learn(seen)
        self._agent.rewards.learn(rewards, returns)

    def teach(self, moment: Moment) -> None:
        """Learn from the error of the last step but one."""
        agent, difference = self._agent, self._difference
        agent.teach(self._taught(difference.errors(self._decision.values, moment)))
        if np.count_nonzero(moment.last):
            agent.forget(moment.last)
        share = difference.share(moment)
        if share < 1.0:
            self.merge()
            agent.shrink(share)
            self._before = self._before and agent.weights
        difference.take(moment)
        if agent.novelty:
            difference.reward = difference.reward + agent.novelty.of(moment.observations)

    def merge(self) -> None:
        """Let all copies have what each has learnt."""
        if self._before is not None:
            self._before = self._agent.merge(self._before)

    def _taught(self, errors: Floats) -> Floats:
        """The errors, or what a control has in their place."""
        if self._control == "frozen":
            return np.zeros_like(errors)
        if self._control == "shuffled":
            # Of a fixed set: errors of the last steps would report how well the agent does, and so teach.
            if self._kept.size < KEPT:
                self._kept = np.append(self._kept, errors)
            return self._rng.choice(self._kept, errors.shape)
        return errors

    def end(self) -> None:
        """Keep the observations of the last steps."""
        self._agent.seen = np.array(self._shown)

    def arrays(self) -> dict[str, Any]:
        """All that it needs to go on."""
        return files.arrays_of(self._agent)

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Go on from `arrays`."""
        files.put_arrays(self._agent, dict(arrays))


class _Frozen:
    """A frozen agent in a closed loop."""

    def __init__(self, agent: Learner, made: Callable[[], Decides]) -> None:
        self._agent, self._made = agent, made

    def begin(self, copies: int, block: int) -> None:
        """Make what decides."""
        self._decides = self._made()

    def act(self, seen: Floats, infos: Any) -> npt.NDArray[Any]:
        """Choose."""
        return self._agent.actions.of(self._decides.decide(seen))


def checkpoint(agent: Learner, out: Path, env: Any) -> Checkpoint:
    """That of a training, beside the file of the agent."""
    worlds = Environments(env)
    told = {"seed": agent.seed, "environment": worlds.name, "options": worlds.options, "environments": worlds.n}
    told |= files.plain_of(agent)
    return Checkpoint(out, "neuro agent training 2", told)


def loop_of(agent: Learner, worlds: Environments, control: str = "") -> ClosedLoop:
    """Return the closed loop in which an agent learns."""
    pilot: Any = _Pilot(agent, control)
    return ClosedLoop(pilot, worlds, seed=agent.seed, explore=agent.settings.explore, block=BLOCK)


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
    loop, kept = loop_of(agent, fitting(agent, env, patience), control), None
    if out is not None:
        check_output(out, hdf5.kind(files.FORMAT))
        kept = checkpoint(agent, out, env)
    loop.go_on(kept.resume() if kept is not None else {}, (*agent.begun, agent.explored))

    def after(loop: ClosedLoop) -> None:
        agent.begun, agent.explored = loop.begun
        loop.pilot.end()  # type: ignore[attr-defined]  # as loop_of has made it
        if kept is not None:
            kept.keep(**loop.arrays())

    loop.until(end, progress=progress, after=after)
    agent.begun, agent.explored = loop.begun
    return loop.log


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
    pilot: Any = _Frozen(agent, made)
    return ClosedLoop(pilot, worlds, learns=False).test(episodes, seed, most)
