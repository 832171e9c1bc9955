"""An agent in a closed loop, and the controls that should fail to learn."""

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
"""Control steps of an environment per block; then all episodes are cut off and the network restarts at time 0.

The weights stay, so a resumed training needs only weights and counts. A block begins in the same way after an
interruption, so the results are the same.
"""
CONTROLS = ("shuffled", "frozen", "random", "scrambled")
"""Controls: errors of other times, no learning, random actions, places permuted at each step."""
KEPT = 1000
"""Number of errors from the start of a training from which the control `shuffled` draws."""
SEEN = 500
"""Number of observations of the last control steps that an agent keeps."""


class Acting:
    """The pilot of an agent, which keeps the last observations and can disable learning for a control.

    Args:
        agent: the agent.
        pilot: pilot of the agent.
        control: name of a control, see `CONTROLS`, or "".
    """

    def __init__(self, agent: Learner, pilot: Any, control: str = "") -> None:
        self._agent, self._pilot, self._control = agent, pilot, control
        self._last_observations: deque[Floats] = deque(maxlen=SEEN)
        self._errors = np.zeros(0)
        self._rng = np.random.default_rng([agent.seed, 1])
        self._taught = pilot.taught["error"].values
        if control in ("frozen", "shuffled"):
            pilot.taught["error"].values = self._control_errors
        if control == "scrambled":
            encoder = pilot.encoders["places"]
            encoder.fields = _Scrambled(encoder.fields, self._rng)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pilot, name)

    def begin(self, copies: int, block: int) -> None:
        """Begin a block with everything learnt so far."""
        self._last_observations.clear()
        self._pilot.begin(copies, block)

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Compute values and choose actions."""
        self._last_observations.append(observations[0])
        actions: npt.NDArray[Any] = self._pilot.act(observations, infos)
        if self._control == "random":
            draws = [self._rng.integers(n, size=len(observations)) for n in self._agent.actions.sizes]
            return self._agent.actions.of(np.stack(draws, axis=1))
        return actions

    def _control_errors(self, moment: Moment) -> Floats:
        """Return the errors of a control."""
        errors: Floats = self._taught(moment)
        if self._control == "frozen":
            return np.zeros_like(errors)
        # The set of errors is fixed. Errors of the last steps show how well the agent does, and would teach the agent.
        if self._errors.size < KEPT:
            self._errors = np.append(self._errors, errors)
        return self._rng.choice(self._errors, errors.shape)

    def arrays(self) -> dict[str, Any]:
        """Return everything that a resumed training needs."""
        observations = np.array(self._last_observations).reshape(-1, len(self._agent.places.dimensions))
        return {**self._pilot.arrays(), "seen": {"vectors": observations}}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Resume from `arrays`."""
        self._last_observations.extend(arrays["seen"]["vectors"])
        self._pilot.put(arrays)


class _Scrambled:
    """Place neurons whose spikes are moved to other neurons, drawn anew at each step."""

    def __init__(self, fields: Any, rng: np.random.Generator) -> None:
        self._fields, self._rng = fields, rng

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fields, name)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Return the spikes of the fields, moved to other neurons."""
        offsets, spike_ticks, ids = self._fields.spikes(vectors, ticks, rng)
        ids = self._rng.permutation(self._fields.size)[ids]
        copies = np.repeat(np.arange(len(vectors)), np.diff(offsets))
        return offsets, spike_ticks, ids[np.lexsort((ids, spike_ticks, copies))]

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """Return the activity of the fields, moved to other neurons."""
        cells, amounts = self._fields.activity(vector)
        return self._rng.permutation(self._fields.size)[cells], amounts


class _Frozen:
    """A frozen agent as the pilot of a closed loop."""

    def __init__(self, agent: Learner, create: Callable[[], Any]) -> None:
        self._agent, self._create = agent, create

    def begin(self, copies: int, block: int) -> None:
        """Make the frozen agent."""
        self._frozen = self._create()

    def act(self, observations: Floats, infos: Any) -> npt.NDArray[Any]:
        """Choose actions."""
        return self._agent.actions.of(self._frozen.decide(observations))


def loop_of(agent: Learner, worlds: Environments, control: str = "") -> ClosedLoop:
    """Return the closed loop in which an agent continues to learn from its present weights."""
    pilot: Any = Acting(agent, agent.pilot(worlds, agent.seed), control)
    pilot.put(agent.arrays())
    loop = ClosedLoop(pilot, worlds, step=STEP, seed=agent.seed, explore=agent.settings.explore, block=BLOCK)
    loop.go_on({}, (*agent.begun, agent.explored))
    return loop


def fitting(agent: Learner, env: Any, patience: float) -> Environments:
    """Return the environments after a check that their spaces equal the agent's."""
    worlds = Environments(env, patience)
    for name, expected, actual in (
        ("observations", agent.observations, worlds.observations),
        ("actions", agent.actions.space, worlds.actions),
    ):
        if expected != actual:
            raise ModelError(f"env: its {name} are {actual}: expected {expected}, for which the agent was made")
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
    """Test without learning, see `ActorCritic.test`; `made` returns the frozen agent."""
    count = Quantity(kind="integer", at_least=1)
    episodes, most = check(count, episodes, "test: episodes"), check(count, most, "test: most")
    check(SEED, seed, "test: seed")
    worlds = fitting(agent, env, patience)
    if worlds.n != 1:
        raise ModelError(f"test: a vector of {worlds.n} environments: expected one", hint="gymnasium.make")
    pilot: Any = _Frozen(agent, made)
    return ClosedLoop(pilot, worlds, learns=False).test(episodes, seed, most)
