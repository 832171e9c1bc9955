"""An agent of spiking neurons that learns by reward, with an actor, a critic, and one error for both."""

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

    _acting: Frozen | Deployed | None = None

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Have learnt what `arrays` gave."""
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
        """Learn in an environment, or in a vector of environments at a time; a second call goes on.

        Args:
            env: a gymnasium.Env, or a VectorEnv, each of whose environments has a copy of the network; the copies add
                up what they learn.
            until: stop when the mean return of the last `window` episodes reaches this.
            steps: stop after so many control steps.
            episodes: stop after so many episodes.
            window: episodes of that mean.
            patience: seconds within which the environment must answer.
            progress: whether to show how far it is on stderr.
            out: a file to which the agent is saved at the end. Beside it lies FILE.training meanwhile, from which the
                same call goes on after a kill, to the same bits.

        Returns:
            the episodes of this call.

        Raises:
            ModelError: the environment has other spaces, gives NaN, raises or does not answer; what was learnt before
                stays.
        """
        loop = training.loop_of(self, training.fitting(self, env, patience))
        path = None if out is None else Path(out)
        words: dict[str, Any] = {"until": until, "steps": steps, "episodes": episodes, "window": window}
        if path is not None:
            check_output(path, hdf5.kind(files.FORMAT))
            words |= {"out": path, "belongs_to": files.plain_of(self)}
        self.log = self._learn(loop, progress=progress, **words)
        if path is not None:
            self.save(path)
            loop.checkpoint(path, {}).remove()
        return self.log

    def _learn(self, loop: neuro.ClosedLoop, **words: Any) -> Log:
        """Run a loop and keep what was learnt there, also before an error."""
        try:
            return loop.run(**words)
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
        """Episodes without learning, of seeds that no training has.

        Args:
            env: one environment.
            episodes: how many.
            seed: of the environment and of the network's draws.
            backend: that runs the network; a chip runs it as `deployed` says.
            patience: seconds within which the environment must answer.
            most: control steps after which an episode that does not end is cut off.

        Raises:
            ModelError: as of `train`; or the backend refuses the network.
        """
        return training.test(self, env, lambda: self.frozen(seed, backend), episodes, seed, patience, most)

    def controls(
        self, env: Any, *, steps: int, episodes: int = 100, names: tuple[str, ...] = training.CONTROLS
    ) -> dict[str, Test]:
        """What must fail: agents like this one, not trained yet, that are kept from learning; tested after `steps`.

        shuffled: errors of other times teach. frozen: nothing does. random: actions are drawn, whatever the circuit
        chooses. scrambled: each place spikes in place of another, drawn anew at each step.

        Raises:
            ModelError: a name is unknown; or as of `train` and `test`.
        """
        found = {}
        for name in names:
            if name not in training.CONTROLS:
                raise unknown("control", name, training.CONTROLS)
        for name in names:
            twin = type(self)(self.observations, self.actions.space, seed=self.seed, **self.settings.plain())
            twin._learn(training.loop_of(twin, training.fitting(twin, env, 60.0), name), steps=steps)
            found[name] = twin.test(env, episodes)
        return found

    def frozen(self, seed: int = 0, backend: str = "event") -> Frozen | Deployed:
        """The agent as it is, which learns no more: on `event` and `reference` its circuits, elsewhere `Deployed`."""
        return Frozen(self, seed, backend) if backend in DRAWING else Deployed(self, backend, seed)

    def energy(self, target: str, steps: int = 200) -> Energy:
        """What control steps of the frozen agent take on a chip, with observations of its last training.

        Args:
            target: as of `Simulation.energy`.
            steps: how many are shown; `per(steps, "decision")` of the bill gives joules a decision.

        Raises:
            ModelError: the agent has not been trained, there is no such target, or `steps` is below 1.
        """
        steps = check(Quantity(kind="integer", at_least=1), steps, "energy: steps")
        actor = Deployed(self, "event")
        for k in range(steps):
            actor.decide(self.seen[None, k % len(self.seen)])
        bill: Energy = actor.sim.energy(target)
        return bill

    def act(self, observation: Any) -> Any:
        """The action for one observation, by the frozen agent.

        Raises:
            ModelError: the observation is none of the space for which the agent was made.
        """
        if self._acting is None:
            self._acting = self.frozen(self.seed)
        seen = self.states.check(flat(self.observations, observation))
        return self.actions.of(self._acting.decide(seen))[0]

    def watch(self, env: Any, path: str | PathLike[str], seed: int = 0, *, learning: bool = False) -> Episode:
        """Play an episode and write it as a page, see `neuro_agent.watch.watch`."""
        return watch(self, env, path, seed, learning=learning)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the agent to one HDF5 file: settings, spaces, what was learnt, the log.

        Raises:
            ModelError: the file cannot be written.
        """
        files.save(self, Path(path))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read an agent that `save` wrote.

        Raises:
            ModelError: there is no such file, it is something else, as an agent of another kind is, or damaged.
        """
        return files.load(Path(path), cls)
