"""A network joined with its world: it sees, runs, acts, and is taught, once a control step."""

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
"""Control steps after which copies that learn side by side add up what they have learnt."""
SPARSE = 10
"""Where no reward comes, random moves go on for so many times as many control steps."""
TESTS = 1 << 40
"""Seeds of tests begin here: no training comes so far."""
MOST = 10_000
"""Control steps after which an episode of a test that does not end is cut off."""
LOOKED_AT = 100
"""Observations by which two runs of a world with one seed are compared."""


class ClosedLoop:
    """A pilot and its environments; made by `neuro.closed_loop`.

    Learning goes in blocks. Each begins at time 0 of the network with new episodes, all seeds keyed by its number, and
    keeps what was learnt: so a run that was killed goes on from the last whole block to the same bits.

    Attributes:
        pilot: what acts.
        environments: in which it acts.
        log: the episodes so far.
        steps: control steps of all environments so far.
        watch: called after each control step, such as the `tick` of a page, which may wait.
        actions, rewards: of the steps of the present block, if they are kept.
        account: at a pace, which steps were late, and the times of all but the first of each block; else None.
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
        self._none = [0] * environments.n
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
        """Return the results of the present block, with the episodes of all, and what makes them again."""
        pilot = self._network_pilot("results")
        made = collect(self.sim, pilot.net, threads=threads, record=record, all_weights=all_weights)
        made.world.update(self.recorded())
        made.live.update({} if self.account is None else self.account.as_attributes())
        request = {**self._request, "seed": self.seed, "copies": self.environments.n, "learns": self._learns}
        about = json.loads(made.about[ATTRIBUTE]) | {"steered": [], "world": request}
        made.about[ATTRIBUTE] = json.dumps(about)
        return made

    def network(self, frozen: bool = False) -> Network:
        """Return the network with the weights of now; `frozen`: with static synapses and no signals."""
        pilot = self._network_pilot("network")
        return pilot.copies[0].network(frozen=frozen)

    @property
    def sim(self) -> Any:
        """The simulation of the first copy in the present block."""
        return self._network_pilot("sim").copies[0]

    def _network_pilot(self, what: str) -> NetworkPilot:
        if not isinstance(self.pilot, NetworkPilot):
            raise ModelError(f"{what}: what acts is no network")
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
        """Act, and learn if it learns, until what comes first.

        Args:
            steps: control steps of all environments, those before this call included.
            ms: in place of steps the time of the network that they take; a part of a step counts as one.
            episodes: episodes, likewise.
            until: the mean return of the last `window` episodes.
            window: episodes of that mean.
            out: the file that comes of it: beside it a checkpoint is written after each block, from which the same
                call goes on after a kill. Whoever writes the file removes the checkpoint.
            belongs_to: what the checkpoint belongs to: the run goes on only from one of equal words.
            progress: whether to show how far it is on stderr.
            after: called after each block.

        Returns:
            the log of all episodes.

        Raises:
            ModelError: no end is given, the environment raises, hangs or gives NaN, or the network cannot go on; the
                last checkpoint stays.
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
        """Act, and learn if it learns, until an end; `after` is called after each block."""
        with self._watched(), Bar() if progress else nullcontext() as bar:
            self._move_at_random(end)
            while not end.reached(self.log) and (end.steps is None or self.steps < end.steps):
                self._one_block(end, bar)
                after(self)

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Stop where the environment does not answer; at a pace also let sleeps end on time."""
        with self.environments.watched(), nullcontext() if self._pace is None else punctual():
            yield

    def _reset(self, seeds: list[int]) -> Floats:
        """Begin all episodes; the clock stands until the end of the first step, which compiles what it needs."""
        if self._pace is not None:
            self._pace.rest()
        return self.environments.reset(seeds)

    def _step(
        self, observations: Floats, seeds: list[int], actions: npt.NDArray[Any] | None = None
    ) -> tuple[npt.NDArray[Any], tuple[Floats, Floats, Bools, Bools]]:
        """Take a control step of the pilot, or with the given actions, when it is due; return actions and answer."""
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
        words = {"seed": self.seed, "environment": self.environments.name, "environments": self.environments.n}
        return Checkpoint(out, "neuro closed loop 1", {**words, "options": self.environments.options, **belongs_to})

    def arrays(self) -> dict[str, Any]:
        """Return all that a run needs to go on."""
        counts = np.array([self.steps, *self._begun, self._explored], dtype=np.int64)
        return {"counts": counts, "log": self.log.arrays(), **self.pilot.arrays()}

    @property
    def begun(self) -> tuple[tuple[int, int], bool]:
        """Episodes and blocks that have begun, each with a seed of its own; and whether random moves are over."""
        return (self._begun[0], self._begun[1]), self._explored

    def go_on(self, arrays: Mapping[str, Any], begun: tuple[int, int, bool] | None = None) -> None:
        """Continue from the arrays of a checkpoint; without any, from the counts in `begun`."""
        if arrays:
            self.steps, *self._begun = (int(each) for each in arrays["counts"][:3])
            self._explored = bool(arrays["counts"][3])
            self.log = Log.of(arrays["log"])
            self.pilot.put(arrays)
        elif begun is not None:
            *self._begun, self._explored = begun

    def _seeds(self, begins: Bools | None = None) -> list[int]:
        """Seeds of the episodes that begin; of the others, which take none, 0."""
        if begins is not None and not np.count_nonzero(begins):
            return self._none
        seeds = []
        for k in range(self.environments.n):
            self._begun[0] += begins is None or bool(begins[k])
            seeds.append(episode_seed(self.seed, self._begun[0]))
        return seeds

    def _check_repeatable(self) -> None:
        """Warn of a world that differs under the same seed and actions: after a kill it only continues."""
        if self.environments.n > 1:
            return
        with self.environments.watched():
            first, second = (self._looked_at() for _ in range(2))
        if len(first) != len(second) or any(not np.array_equal(a, b) for a, b in zip(first, second, strict=True)):
            message = (
                f"'{self.environments.name}' differs under the same seed and actions: a run that was killed goes on"
            )
            warnings.warn(f"{message}, but not to the same bits", stacklevel=3)

    def _looked_at(self) -> list[Floats]:
        env, seeds = self.environments, [episode_seed(self.seed, 0)]
        env.actions.seed(self.seed)
        observations = [env.reset(seeds)]
        while len(observations) < LOOKED_AT and not env.over[0]:
            observations.append(env.step([env.actions.sample()], seeds)[0])
        return observations

    def _move_at_random(self, end: End) -> None:
        """Move at random, before anything is learnt: see which observations and rewards there are."""
        env = self.environments
        if self._explored:
            return
        env.actions.seed(self.seed)
        observations, least = [self._reset(self._seeds())], self._explore
        sums, rewards, some = Sums(env.n), list[float](), False
        while self.steps < (least if some else SPARSE * least) and not end.reached(self.log):
            if end.steps is not None and self.steps >= end.steps:
                break
            begins = env.over
            actions = np.stack([env.actions.sample() for _ in range(env.n)])
            _, (now, reward, _, _) = self._step(observations[-1], self._seeds(begins), actions)
            observations.append(now)
            self.steps += env.n - int(np.count_nonzero(begins))
            sums.add(self.log, self.steps, reward, env.over)
            rewards += reward[~begins].tolist()
            some |= bool(reward.any())
        self.pilot.explored(np.concatenate(observations), rewards, self.log.returns.tolist())
        self._explored = self.steps >= least  # a run that ends before has learnt nothing: the next explores anew

    def _one_block(self, end: End, bar: Bar | None) -> None:
        """Go on for a block of control steps, or to the end."""
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
                observations, self._seeds(last) if begins else self._none
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
        """Play episodes without learning, of seeds that no training has; the loop must not learn.

        Args:
            episodes: how many.
            seed: of the episodes.
            most: control steps after which an episode is cut off.

        Raises:
            ModelError: the loop learns, or has several environments; or as of `run`.
        """
        episodes = int(argument("test: episodes", episodes, kind="integer", at_least=1))
        if self._learns or self.environments.n > 1:
            raise ModelError(
                "test: the loop learns, or has copies: expected a frozen one", hint="learns=False, copies=1"
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
        environment: in place of the described one: a gymnasium.Env, a VectorEnv, or a class of environments.
        backend: that runs the network.
        seed: of everything random.
        copies: environments side by side, each with a copy of the network.
        learns: False keeps all weights as they are and sets no signal.
        record: whether spikes and traces of the present block, its actions and its rewards are kept.
        patience: seconds within which the environment must answer.
        block: control steps of a block, in place of those of the description.
        pace: times real time, such as 1.0, at which control steps are due; as fast as it can if None. A step that is
            late by a whole one or more is not caught up with. The bits are the same.
        options: of the backend.

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
        net if learns else net.frozen(),  # spikes and signals of the network itself teach, too
        environments,
        backend=backend,
        seed=seed,
        learns=learns,
        record=record,
        options=options,
    )
    words: dict[str, Any] = {"explore": world.explore, "block": block or world.block, "learns": learns, "keep": record}
    return ClosedLoop(pilot, environments, step=world.step, seed=seed, pace=pace, **words)


def lived(net: Network, ms: float, progress: bool = False, **words: Any) -> ClosedLoop:
    """Join a network with its world, and act there for so many ms in a single block.

    Args:
        net: the network.
        ms: time of the network.
        progress: whether to show how far it is on stderr.
        words: as of `closed_loop`.
    """
    world = net.world_section
    steps = 1 if world is None else max(1, ceil(ms / world.step - 1e-9))
    loop = closed_loop(net, block=2 * steps, **words)  # each step may begin an episode, which is none for the world
    loop.run(steps=steps + (world.explore if world is not None else 0), progress=progress)
    return loop


def lived_again(net: Network, request: Mapping[str, Any], backend: str, **keep: Any) -> Results:
    """Run once more what the record of results asks for, and return the results.

    Args:
        net: the network.
        request: the words `world` of the record.
        backend: that runs it.
        keep: what to keep, as of `ClosedLoop.results`.
    """
    ends = {word: request[word] for word in ("until", "steps", "episodes", "window")}
    words = {word: request[word] for word in ("seed", "copies", "learns")}
    loop = closed_loop(net, backend=backend, record=True, threads=keep["threads"], **words)
    loop.run(**ends)
    return loop.results(**keep)
