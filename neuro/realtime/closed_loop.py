"""A network joined with its world: in each control step it observes, runs, acts and learns."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from math import ceil
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.coding.world import Moment
from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.core.progress import Bar
from neuro.core.provenance import ATTRIBUTE
from neuro.files.results import Results
from neuro.files.state import Checkpoint
from neuro.model.network import Network
from neuro.realtime.environments import Environments, environment_of
from neuro.realtime.episodes import Bools, End, Floats, Ints, Log, Sums, Test, episode_seed
from neuro.realtime.pace import Pace, punctual
from neuro.realtime.pilot import NetworkPilot, Pilot
from neuro.realtime.report import Histogram, LiveRun
from neuro.run.collect import collect

MERGE = 16
"""Number of control steps after which parallel copies add up their changes of weights."""
SPARSE = 10
"""Factor on the number of random moves as long as all rewards are 0."""
TESTS = 1 << 40
"""First seed of tests, larger than the seeds of any training."""
MOST = 10_000
"""Largest number of control steps of an episode of a test."""
LOOKED_AT = 100
"""Number of observations for the comparison of two runs of a world with the same seed."""


class ClosedLoop:
    """A pilot and its environments, made by `neuro.closed_loop`.

    Learning is divided into blocks. A block begins at time 0 of the network, with new episodes and the learnt weights.
    The number of the block decides all seeds, so a killed run continues from the last complete block with equal bits.

    Attributes:
        pilot: the network, or another object that acts.
        environments: environments of the pilot.
        log: the episodes so far.
        steps: number of control steps of all environments so far.
        watch: function called after each control step, e.g. the `tick` of a page; it may wait.
        actions, rewards: recorded actions and rewards of the present block.
        account: late steps, and times of all steps but the first of each block; None without a pace.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Environments,
        *,
        step: float = 1.0,
        seed: int = 0,
        explore: int = 0,
        block: int = 10_000,
        learns: bool = True,
        keep: bool = False,
        pace: float | None = None,
    ) -> None:
        self.pilot, self.environments, self.seed = pilot, environments, seed
        self._explore, self._block, self._learns, self._step_ms, self._keep = explore, block, learns, step, keep
        self.log, self.steps = Log(), 0
        self.watch: Callable[[], object] | None = None
        self.actions: list[npt.NDArray[Any]] = []
        self.rewards: list[Floats] = []
        self._begun = [0, 0]  # episodes and blocks
        self._no_seeds = [0] * environments.n
        self._request: dict[str, Any] = {}
        self._explored = not explore
        phases = {"run": Histogram(), "act": Histogram()}
        self.account = None if pace is None else LiveRun(step / pace, phases=phases)
        self._pace = None if self.account is None else Pace(self.account, "skip")

    def recorded(self) -> dict[str, npt.NDArray[Any]]:
        """Return returns, lengths and steps of all episodes, and rewards and actions of the present block, by name."""
        episodes = {"returns": self.log.returns, "lengths": self.log.lengths, "steps": self.log.steps}
        if not self.rewards:
            return episodes
        return episodes | {"rewards": np.array(self.rewards), "actions": np.array(self.actions)}

    def results(self, *, threads: int = 1, record: Collection[str] = (), all_weights: bool = False) -> Results:
        """Return the results of the present block, with the episodes of all blocks, and the data for `neuro rerun`."""
        pilot = self._network_pilot("results")
        made = collect(self.sim, pilot.net, threads=threads, record=record, all_weights=all_weights)
        made.world.update(self.recorded())
        made.live.update({} if self.account is None else self.account.as_attributes())
        request = {**self._request, "seed": self.seed, "copies": self.environments.n, "learns": self._learns}
        provenance = json.loads(made.about[ATTRIBUTE]) | {"steered": [], "world": request}
        made.about[ATTRIBUTE] = json.dumps(provenance)
        return made

    def network(self, frozen: bool = False) -> Network:
        """Return the network with the present weights; if `frozen`, with static synapses and without signals."""
        pilot = self._network_pilot("network")
        return pilot.copies[0].network(frozen=frozen)

    @property
    def sim(self) -> Any:
        """Simulation of the first copy in the present block."""
        return self._network_pilot("sim").copies[0]

    def _network_pilot(self, what: str) -> NetworkPilot:
        if not isinstance(self.pilot, NetworkPilot):
            raise ModelError(f"{what}: the pilot is no network")
        return self.pilot

    def run(
        self,
        *,
        steps: int | None = None,
        ms: float | None = None,
        episodes: int | None = None,
        until: float | None = None,
        window: int = 100,
        out: str | PathLike[str] | None = None,
        belongs_to: Mapping[str, Any] | None = None,
        progress: bool = False,
        after: Callable[[ClosedLoop], object] | None = None,
    ) -> Log:
        """Act, and learn if the loop learns, until the first of the given ends.

        Args:
            steps: number of control steps of all environments, including steps before this call.
            ms: time of the network, instead of ``steps``; rounded up to whole steps.
            episodes: number of episodes, including episodes before this call.
            until: mean return of the last `window` episodes that ends the run.
            window: number of episodes of the mean.
            out: path of the file that the caller writes at the end. A checkpoint beside it is written after each
                block; after a kill the same call continues from the checkpoint. The caller removes the checkpoint.
            belongs_to: settings in the checkpoint. Only a run with equal settings continues.
            progress: whether to show progress on stderr.
            after: function called after each block.

        Returns:
            The log of all episodes.

        Raises:
            ModelError: no end is given, the environment raises an error, hangs or returns NaN, or the network cannot
                continue. The last checkpoint is kept.
        """
        if ms is not None:
            steps = max(1, ceil(ms / self._step_ms - 1e-9)) * self.environments.n
        end, checkpoint = End(until, steps, episodes, window), None
        self._request = {"until": until, "steps": steps, "episodes": episodes, "window": window}
        if out is not None:
            checkpoint = self.checkpoint(Path(out), belongs_to or {})
            self.go_on(checkpoint.resume())
            self._check_repeatable()

        def keep(loop: ClosedLoop) -> None:
            if checkpoint is not None:
                checkpoint.keep(**self.arrays())
            if after is not None:
                after(self)

        self.until(end, progress=progress, after=keep)
        return self.log

    def until(self, end: End, *, progress: bool = False, after: Callable[[ClosedLoop], object]) -> None:
        """Act, and learn if the loop learns, until an end. `after` is called after each block."""
        with self._watched(), Bar() if progress else nullcontext() as bar:
            self._move_at_random(end)
            while not end.reached(self.log) and (end.steps is None or self.steps < end.steps):
                self._run_block(end, bar)
                after(self)

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Stop if the environment does not answer. With a pace, also let sleeps end on time."""
        with self.environments.watched(), nullcontext() if self._pace is None else punctual():
            yield

    def _reset(self, seeds: list[int]) -> Floats:
        """Begin all episodes. The clock stops until the end of the first step, which compiles kernels."""
        if self._pace is not None:
            self._pace.rest()
        return self.environments.reset(seeds)

    def _step(
        self, observations: Floats, seeds: list[int], actions: npt.NDArray[Any] | None = None
    ) -> tuple[npt.NDArray[Any], tuple[Floats, Floats, Bools, Bools]]:
        """Take a control step when it is due, by the pilot or with given actions. Return the actions and the answer."""
        pace, env = self._pace, self.environments
        if pace is not None:
            pace.wait()
        if actions is None:
            actions = self.pilot.act(observations, env.infos)
        if pace is not None:
            pace.mark()
        answer = env.step(actions, seeds)
        if pace is not None:
            pace.mark()
            pace.end()
        return actions, answer

    def checkpoint(self, out: Path, belongs_to: Mapping[str, Any]) -> Checkpoint:
        """Return the checkpoint beside a file."""
        settings = {"seed": self.seed, "environment": self.environments.name, "environments": self.environments.n}
        return Checkpoint(out, "neuro closed loop 1", {**settings, "options": self.environments.options, **belongs_to})

    def arrays(self) -> dict[str, Any]:
        """Return the state from which `go_on` continues."""
        counts = np.array([self.steps, *self._begun, self._explored], dtype=np.int64)
        return {"counts": counts, "log": self.log.arrays(), **self.pilot.arrays()}

    @property
    def begun(self) -> tuple[tuple[int, int], bool]:
        """Numbers of begun episodes and blocks, which decide the seeds, and whether random moves are over."""
        return (self._begun[0], self._begun[1]), self._explored

    def go_on(self, arrays: Mapping[str, Any], begun: tuple[int, int, bool] | None = None) -> None:
        """Continue from the arrays of a checkpoint; without any, from the counts in `begun`."""
        if arrays:
            self.steps, *self._begun = (int(count) for count in arrays["counts"][:3])
            self._explored = bool(arrays["counts"][3])
            self.log = Log.of(arrays["log"])
            self.pilot.put(arrays)
        elif begun is not None:
            *self._begun, self._explored = begun

    def _seeds(self, begins: Bools | None = None) -> list[int]:
        """Return the seed of each beginning episode, and 0 for the other episodes."""
        if begins is not None and not np.count_nonzero(begins):
            return self._no_seeds
        seeds = []
        for k in range(self.environments.n):
            self._begun[0] += begins is None or bool(begins[k])
            seeds.append(episode_seed(self.seed, self._begun[0]))
        return seeds

    def _check_repeatable(self) -> None:
        """Warn if the world differs under equal seeds and actions: a killed run is then not repeatable."""
        if self.environments.n > 1:
            return
        with self.environments.watched():
            first, second = (self._looked_at() for _ in range(2))
        if len(first) != len(second) or any(not np.array_equal(a, b) for a, b in zip(first, second, strict=True)):
            message = f"'{self.environments.name}' differs under the same seed and actions: a killed run continues"
            warnings.warn(f"{message}, but not to the same bits", stacklevel=3)

    def _looked_at(self) -> list[Floats]:
        env, seeds = self.environments, [episode_seed(self.seed, 0)]
        env.actions.seed(self.seed)
        observations = [env.reset(seeds)]
        while len(observations) < LOOKED_AT and not env.over[0]:
            observations.append(env.step([env.actions.sample()], seeds)[0])
        return observations

    def _move_at_random(self, end: End) -> None:
        """Take random moves before learning, to learn the ranges of observations and rewards."""
        env = self.environments
        if self._explored:
            return
        env.actions.seed(self.seed)
        observations, n_steps = [self._reset(self._seeds())], self._explore
        sums, rewards, has_reward = Sums(env.n), list[float](), False
        while self.steps < (n_steps if has_reward else SPARSE * n_steps) and not end.reached(self.log):
            if end.steps is not None and self.steps >= end.steps:
                break
            begins = env.over
            actions = np.stack([env.actions.sample() for _ in range(env.n)])
            _, (new, reward, _, _) = self._step(observations[-1], self._seeds(begins), actions)
            observations.append(new)
            self.steps += env.n - int(np.count_nonzero(begins))
            sums.add(self.log, self.steps, reward, env.over)
            rewards += reward[~begins].tolist()
            has_reward |= bool(reward.any())
        self.pilot.explored(np.concatenate(observations), rewards, self.log.returns.tolist())
        # A run that ends earlier has learnt nothing, so the next run explores again.
        self._explored = self.steps >= n_steps

    def _run_block(self, end: End, bar: Bar | None) -> None:
        """Run a block of control steps, or up to the end."""
        pilot, env = self.pilot, self.environments
        pilot.begin(env.n, self._begun[1])
        self._begun[1] += 1
        observations = self._reset(self._seeds())
        sums, time = Sums(env.n), self.steps // env.n * self._step_ms
        first = np.ones(env.n, dtype=np.bool_)
        self.actions.clear()
        self.rewards.clear()
        k = 0
        while k < self._block and (end.steps is None or self.steps < end.steps):
            last = env.over
            begins = int(np.count_nonzero(last))
            actions, (observations, rewards, ended, _) = self._step(
                observations, self._seeds(last) if begins else self._no_seeds
            )
            self.steps += env.n - begins
            if self._keep:
                self.actions.append(actions)
                self.rewards.append(rewards)
            time += self._step_ms
            if self._learns:
                counts: Mapping[str, Ints] = getattr(pilot, "counts", {})
                returns = self.log._returns
                pilot.teach(
                    Moment(counts, first, last, rewards, ended, env.infos, observations, time, self.steps, returns)
                )
                if env.n > 1 and k % MERGE == MERGE - 1:
                    pilot.merge()
            first, k = last, k + 1
            if self.watch is not None:
                self.watch()
            if sums.add(self.log, self.steps, rewards, env.over):
                if bar is not None:
                    mean = f"mean return of the last {min(len(self.log), end.window)}: {self.log.mean(end.window):g}"
                    bar.show(self.steps, end.steps or self.steps, f"{len(self.log)} episodes, {mean}")
                if end.reached(self.log):
                    break
        if env.n > 1 and self._learns:
            pilot.merge()

    def test(self, episodes: int = 100, seed: int = 0, most: int = MOST) -> Test:
        """Play episodes without learning, with seeds that no training uses. The loop must not learn.

        Args:
            episodes: number of episodes.
            seed: seed of the episodes.
            most: number of control steps after which an episode is cut off.

        Raises:
            ModelError: the loop learns, has several environments, or fails as in `run`.
        """
        episodes = int(argument("test: episodes", episodes, kind="integer", at_least=1))
        if self._learns or self.environments.n > 1:
            raise ModelError(
                "test: the loop learns, or has copies: expected a frozen loop", hint="use learns=False, copies=1"
            )
        env = self.environments
        returns, lengths = np.zeros(episodes), np.zeros(episodes, dtype=np.int64)
        self.pilot.begin(1, 0)
        with self._watched():
            for k in range(episodes):
                observations = self._reset([episode_seed(seed, TESTS + k)])
                while not env.over[0] and lengths[k] < most:
                    _, (observations, reward, _, _) = self._step(observations, [0])
                    returns[k] += reward[0]
                    lengths[k] += 1
        return Test(returns, lengths)


def closed_loop(
    net: Network,
    environment: Any = None,
    *,
    backend: Any = "event",
    seed: int = 0,
    copies: int = 1,
    learns: bool = True,
    record: bool = False,
    patience: float = 60.0,
    block: int | None = None,
    pace: float | None = None,
    **options: Any,
) -> ClosedLoop:
    """Join a network with its world.

    Args:
        net: a network whose description has a `world`.
        environment: a gymnasium.Env, a VectorEnv, or a class of environments; by default the described environment.
        backend: name of the backend, or the backend itself.
        seed: seed of all random numbers.
        copies: number of parallel environments, each with a copy of the network.
        learns: whether the network learns. If not, weights stay constant and no signal is set.
        record: whether to record spikes, traces, actions and rewards of the present block.
        patience: time within which the environment must answer, s.
        block: number of control steps of a block; by default as described.
        pace: speed relative to real time, e.g. 1.0; by default as fast as possible. A delay of a whole step or more
            is not caught up. Results do not depend on the pace.
        options: options of the backend.

    Raises:
        ModelError: the network has no world, there is no such environment, or encoders, decoder and signals do not fit
            the network and the spaces of the environment.
    """
    world = net.world_section
    if world is None:
        raise ModelError(f"network '{net.name}' has no world: expected the section 'world'", hint="net.world(...)")
    copies = int(argument("copies", copies, kind="integer", at_least=1))
    pace = None if pace is None else float(argument("pace", pace, above=0))
    try:
        made = environment_of(world, environment, copies)
    except ModelError as error:
        raise error.at(net.world_origin, "world").but(path=("world", "environment", *error.path)) from None
    environments = Environments(made, patience)
    pilot = NetworkPilot(
        net if learns else net.frozen(),  # the network also learns by its own spikes and described signals
        environments,
        backend=backend,
        seed=seed,
        learns=learns,
        record=record,
        options=options,
    )
    settings: Any = {"explore": world.explore, "block": block or world.block, "learns": learns, "keep": record}
    return ClosedLoop(pilot, environments, step=world.step, seed=seed, pace=pace, **settings)


def lived(net: Network, ms: float, progress: bool = False, **words: Any) -> ClosedLoop:
    """Join a network with its world, and act for some time in a single block.

    Args:
        net: the network.
        ms: time of the network.
        progress: whether to show progress on stderr.
        words: arguments of `closed_loop`.
    """
    world = net.world_section
    steps = 1 if world is None else max(1, ceil(ms / world.step - 1e-9))
    loop = closed_loop(net, block=2 * steps, **words)  # the begin of an episode takes a step without the world
    loop.run(steps=steps + (world.explore if world is not None else 0), progress=progress)
    return loop


def lived_again(net: Network, request: Mapping[str, Any], backend: str, **keep: Any) -> Results:
    """Repeat a run from the record of its results, and return the new results.

    Args:
        net: the network.
        request: the entry `world` of the record.
        backend: name of the backend.
        keep: arguments of `ClosedLoop.results`.
    """
    ends = {word: request[word] for word in ("until", "steps", "episodes", "window")}
    options = {word: request[word] for word in ("seed", "copies", "learns")}
    loop = closed_loop(net, backend=backend, record=True, threads=keep["threads"], **options)
    loop.run(**ends)
    return loop.results(**keep)
