"""A spiking agent that learns by reward: an actor, a critic, and one temporal-difference error that teaches both."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import neuro
from neuro.apps import Log, Quantity, Test, check, check_output, flat, hdf5, unknown
from neuro_agent import files, training
from neuro_agent.deployed import DRAWING, Deployed, Frozen
from neuro_agent.learner import Learner
from neuro_agent.watch import Episode, watch

if TYPE_CHECKING:
    from neuro.chips import Energy


class ActorCritic(Learner):
    """A spiking agent, see `Learner` for its arguments and attributes."""

    # The frozen agent of `act`, None until the first call and after each change of the weights.
    _acting: Frozen | Deployed | None = None

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Replace what the agent has learnt by `arrays`, in the form that `arrays()` returns."""
        self._acting = None
        super().put(arrays)

    def train(
        self,
        env: Any,
        until: float | None = None,
        *,
        steps: int | None = None,
        episodes: int | None = None,
        window: int = 100,
        patience: float = 60.0,
        progress: bool = False,
        out: str | PathLike[str] | None = None,
    ) -> Log:
        """Train in an environment, or in a vector of environments side by side; a second call continues.

        Args:
            env: a gymnasium.Env, or a VectorEnv. In a VectorEnv each environment has a copy of the network, and the
                weight changes of the copies are summed.
            until: mean return of the last `window` episodes at which training stops.
            steps: number of control steps after which training stops.
            episodes: number of episodes after which training stops.
            window: number of episodes of the mean return.
            patience: seconds within which the environment must answer.
            progress: whether to show the progress on stderr.
            out: file to which the agent is saved at the end. During training a file beside it, whose name ends in
                .training, holds a checkpoint; after a kill the same call resumes there, with bit-identical results.

        Returns:
            the episodes of this call.

        Raises:
            ModelError: the environment's spaces differ from the agent's, or it returns NaN, raises an error or does not
                answer. What was learnt before is kept.
        """
        loop = training.loop_of(self, training.fitting(self, env, patience))
        path = None if out is None else Path(out)
        options: dict[str, Any] = {"until": until, "steps": steps, "episodes": episodes, "window": window}
        if path is not None:
            check_output(path, hdf5.kind(files.FORMAT))
            options |= {"out": path, "belongs_to": files.plain_of(self)}
        self.log = self._learn(loop, progress=progress, **options)
        if path is not None:
            self.save(path)
            loop.checkpoint(path, {}).remove()
        return self.log

    def _learn(self, loop: neuro.ClosedLoop, **options: Any) -> Log:
        """Run a loop and keep what was learnt, even if it raises an error."""
        try:
            return loop.run(**options)
        finally:
            self.begun, self.explored = loop.begun
            self.put(loop.pilot.arrays())

    def test(
        self,
        env: Any,
        episodes: int = 100,
        *,
        seed: int = 0,
        backend: str = "event",
        patience: float = 60.0,
        most: int = training.MOST,
    ) -> Test:
        """Test without learning, in episodes whose seeds no training uses.

        Args:
            env: one environment.
            episodes: number of episodes.
            seed: seed of the environment and of the network's draws.
            backend: backend that runs the network; `deployed` describes the network for chips.
            patience: seconds within which the environment must answer.
            most: control steps after which an episode is cut off.

        Raises:
            ModelError: see `train`; or the backend refuses the network.
        """
        return training.test(self, env, lambda: self.frozen(seed, backend), episodes, seed, patience, most)

    def controls(
        self, env: Any, *, steps: int, episodes: int = 100, names: tuple[str, ...] = training.CONTROLS
    ) -> dict[str, Test]:
        """Train and test untrained copies of the agent that cannot learn; their tests should fail.

        - "shuffled" learns from errors of other times.
        - "frozen" does not learn.
        - "random" draws its actions at random.
        - "scrambled" permutes its input neurons (places) at random at each step.

        Args:
            env: a gymnasium.Env, or a VectorEnv for the training.
            steps: control steps of each training.
            episodes: episodes of each test.
            names: names of the controls.

        Raises:
            ModelError: a name is unknown; or see `train` and `test`.
        """
        tests = {}
        for name in names:
            if name not in training.CONTROLS:
                raise unknown("control", name, training.CONTROLS)
        for name in names:
            twin = type(self)(self.observations, self.actions.space, seed=self.seed, **self.settings.plain())
            twin._learn(training.loop_of(twin, training.fitting(twin, env, 60.0), name), steps=steps)
            tests[name] = twin.test(env, episodes)
        return tests

    def frozen(self, seed: int = 0, backend: str = "event") -> Frozen | Deployed:
        """Return the agent with frozen weights: its own circuits on `event` and `reference`, else a `Deployed`."""
        return Frozen(self, seed, backend) if backend in DRAWING else Deployed(self, backend, seed)

    def energy(self, target: str, steps: int = 200) -> Energy:
        """Return the energy of control steps of the frozen agent on a chip, with observations from its last training.

        Args:
            target: chip or processor, see `Simulation.energy`.
            steps: number of observations to decide on; `per(steps, "decision")` of the bill is joules per decision.

        Raises:
            ModelError: the agent has not been trained, the target is unknown, or `steps` is below 1.
        """
        steps = check(Quantity(kind="integer", at_least=1), steps, "energy: steps")
        actor = Deployed(self, "event")
        for k in range(steps):
            actor.decide(self.last_vectors[None, k % len(self.last_vectors)])
        bill: Energy = actor.sim.energy(target)
        return bill

    def act(self, observation: Any) -> Any:
        """Return the action of the frozen agent for one observation.

        Raises:
            ModelError: the observation is not in the space for which the agent was made.
        """
        if self._acting is None:
            self._acting = self.frozen(self.seed)
        vector = self.states.check(flat(self.observations, observation))
        return self.actions.of(self._acting.decide(vector))[0]

    def watch(self, env: Any, path: str | PathLike[str], seed: int = 0, *, learning: bool = False) -> Episode:
        """Play an episode and write it as an HTML page, see `neuro_agent.watch.watch`."""
        return watch(self, env, path, seed, learning=learning)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the agent to an HDF5 file: settings, spaces, what was learnt, and the log.

        Raises:
            ModelError: the file cannot be written.
        """
        files.save(self, Path(path))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read an agent that `save` wrote.

        Raises:
            ModelError: the file does not exist, is damaged, or holds something else, such as an agent of another kind.
        """
        return files.load(Path(path), cls)
