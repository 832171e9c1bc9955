"""An agent in environments: what acts for it in a closed loop, and what must fail."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop, ModelError
from neuro.apps import (
    MOST as MOST,
    TESTS as TESTS,
    Environments,
    Moment,
    Quantity,
    Test,
    check,
    episode_seed as episode_seed,
)
from neuro_agent.network import SEED, STEP

if TYPE_CHECKING:
    from neuro_agent.learner import Learner


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

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


class Acting:
    """The pilot of an agent whose last observations are kept, and which a control may keep from learning.

    Args:
        agent: learns.
        pilot: of the agent.
        control: the name of a control, see `CONTROLS`, or "".
    """

    def __init__(self, agent: Learner, pilot: Any, control: str = "") -> None:
        self._agent, self._pilot, self._control = agent, pilot, control
        self._shown: deque[Floats] = deque(maxlen=SEEN)
        self._errors = np.zeros(0)
        self._rng = np.random.default_rng([agent.seed, 1])
        self._taught = pilot.taught["error"].values
        if control in ("frozen", "shuffled"):
            pilot.taught["error"].values = self._others
        if control == "scrambled":
            encoder = pilot.encoders["places"]
            encoder.fields = _Scrambled(encoder.fields, self._rng)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pilot, name)

    def begin(self, copies: int, block: int) -> None:
        """Begin a block, with all that was learnt before."""
        self._shown.clear()
        self._pilot.begin(copies, block)

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Judge and choose."""
        self._shown.append(observations[0])
        actions: npt.NDArray[Any] = self._pilot.act(observations, infos)
        if self._control == "random":
            draws = [self._rng.integers(n, size=len(observations)) for n in self._agent.actions.sizes]
            return self._agent.actions.of(np.stack(draws, axis=1))
        return actions

    def _others(self, moment: Moment) -> Floats:
        """What a control has in place of the errors."""
        errors: Floats = self._taught(moment)
        if self._control == "frozen":
            return np.zeros_like(errors)
        # Of a fixed set: errors of the last steps would report how well the agent does, and so teach.
        if self._errors.size < KEPT:
            self._errors = np.append(self._errors, errors)
        return self._rng.choice(self._errors, errors.shape)

    def arrays(self) -> dict[str, Any]:
        """All that it needs to go on."""
        seen = np.array(self._shown).reshape(-1, len(self._agent.places.dimensions))
        return {**self._pilot.arrays(), "seen": {"vectors": seen}}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Go on from `arrays`."""
        self._shown.extend(arrays["seen"]["vectors"])
        self._pilot.put(arrays)


class _Scrambled:
    """Neurons with fields, each of which spikes in place of another, drawn anew at each step."""

    def __init__(self, fields: Any, rng: np.random.Generator) -> None:
        self._fields, self._rng = fields, rng

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fields, name)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Spikes as of the fields, of other neurons."""
        offsets, when, ids = self._fields.spikes(vectors, ticks, rng)
        ids = self._rng.permutation(self._fields.size)[ids]
        copies = np.repeat(np.arange(len(vectors)), np.diff(offsets))
        return offsets, when, ids[np.lexsort((ids, when, copies))]

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """Activity as of the fields, of other neurons."""
        cells, amounts = self._fields.activity(vector)
        return self._rng.permutation(self._fields.size)[cells], amounts


class _Frozen:
    """A frozen agent in a closed loop."""

    def __init__(self, agent: Learner, made: Callable[[], Any]) -> None:
        self._agent, self._made = agent, made

    def begin(self, copies: int, block: int) -> None:
        """Make what decides."""
        self._decides = self._made()

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Choose."""
        return self._agent.actions.of(self._decides.decide(observations))


def loop_of(agent: Learner, worlds: Environments, control: str = "") -> ClosedLoop:
    """Return the closed loop in which an agent learns, from what it has learnt before."""
    pilot: Any = Acting(agent, agent.pilot(worlds, agent.seed), control)
    pilot.put(agent.arrays())
    loop = ClosedLoop(pilot, worlds, step=STEP, seed=agent.seed, explore=agent.settings.explore, block=BLOCK)
    loop.go_on({}, (*agent.begun, agent.explored))
    return loop


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
    made: Callable[[], Any],
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
