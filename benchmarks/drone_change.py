"""Lasting learning against frozen weights in a changing world: `nice python benchmarks/drone_change.py --out FOLDER`.

A network is trained for 20,000 steps in still air, then flies laps in which the world changes, e.g. a wind begins. On
these laps its weights are frozen, or it goes on learning from the supervised error, or it learns until `AGAIN` and is
then frozen. The last case separates what the network has learnt from the direct effect of dopamine on the motors. Each
lap begins with the weights of the training. The oracle, the centroid and LMS fly the same laps.

Errors over time, the mean of 2 x 2 starts for each of `--seeds` trainings, are stored in the folder, so an interrupted
run can be continued. At the end FOLDER/change.png and FOLDER/change.md are written, with mean and standard deviation
over seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from kept import kept, markdown, spread

from neuro.apps import side_by_side
from neuro_drone.evaluate import ENDLESS, Flights, Start, fly_lap, reset_arguments
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

Floats = npt.NDArray[np.float64]
SINCE, AGAIN = 40.0, 70.0
"""Times in a lap of 100 s at which the world changes, and at which a network is frozen again, s."""
STEPS = 20_000
STARTS = tuple(Start((x, y)) for x in (-10.0, 10.0) for y in (-10.0, 10.0))
SMOOTH = 20
"""Number of steps of the running mean in the figure."""
PHASES = {"before": (10.0, SINCE), "5 s after": (SINCE, SINCE + 5.0), "from 70 s on": (AGAIN, 100.0)}
SOFT = "#8a919c"


@dataclass(frozen=True)
class Way:
    """A way to fly a lap.

    Attributes:
        name: name in table and figure.
        colour: colour in the figure.
        trained: name of a controller that is trained with each seed, or "".
        controller: name of a controller that needs no training, or "".
        learns: time in the lap until which the controller learns, s.
    """

    name: str
    colour: str = ""
    trained: str = ""
    controller: str = ""
    learns: float = 0.0


NETWORK = (
    Way("network, frozen", "#d55e00", "snn"),
    Way("network, learning on", "#0072b2", "snn", learns=np.inf),
    Way(f"network, frozen again at {AGAIN:g} s", "#009e73", "snn", learns=AGAIN),
)
"""The ways in the figure, with their spread over seeds. The table has all ways."""
LMS = (Way("LMS, frozen", trained="lms"), Way("LMS, learning on", trained="lms", learns=np.inf))
ORACLE = Way("oracle", controller="oracle")
WAYS = (*NETWORK, *LMS, Way("centroid", controller="centroid"), ORACLE)


@dataclass(frozen=True)
class Case:
    """A change of the world during a lap.

    Attributes:
        title: title in the figure.
        world: the scenario.
        change: settings of the scenario that take effect at `SINCE`.
        axis: index of the axis whose absolute error is shown, or None for the distance in the picture.
        unit: unit of the error.
        ways: ways that are flown.
        cut: share of the synapses onto the motors that is cut at `SINCE`, drawn with the seed of the training.
    """

    title: str
    world: str
    change: Mapping[str, Any]
    axis: int | None = None
    unit: str = "px"
    ways: tuple[Way, ...] = WAYS
    cut: float = 0.0


CASES = {
    "wind": Case("wind of 5 m/s from 40 s on", "B60", {"wind": {"speed": 5, "towards": 90, "since": SINCE}}),
    "gusts": Case(
        "wind of 5 m/s with gusts of 1 m/s from 40 s on, which turns by 180 degrees",
        "B60",
        {"wind": {"speed": 5, "towards": 0, "turning": 3, "gust": 1, "since": SINCE}},
    ),
    "load": Case(
        "0.1 kg taken up at 40 s by a drone of 0.716 kg that climbs",
        "B60-height",
        {"load": {"mass": 0.1, "since": SINCE}},
        axis=2,
        unit="px of the ball's height",
        ways=(*NETWORK, ORACLE),
    ),
    "cut": Case("20 % of the synapses onto the motors cut at 40 s", "B60", {}, ways=NETWORK, cut=0.2),
    "turned": Case(
        "motors turned by 45 degrees at 40 s, as if the camera had turned",
        "B60",
        {"motors": {"angle": 45, "since": SINCE}},
        ways=NETWORK,
    ),
    "mirrored": Case("a motor mirrored at 40 s", "B60", {"motors": {"mirror": True, "since": SINCE}}, ways=NETWORK),
}


def flown(case: Case, model: Model, learns: float) -> dict[str, Any]:
    """Return the error after each step, as a mean of all starts, and the number of starts at which the ball was lost.

    Args:
        case: the change.
        model: the model that flies. Each lap begins with its weights.
        learns: time in the lap until which the model learns, s.
    """
    laps = [one_lap(case, model, start, index, learns) for index, start in enumerate(STARTS)]
    return {"error": np.mean([track for track, _ in laps], axis=0).tolist(), "lost": sum(lost for _, lost in laps)}


def one_lap(case: Case, model: Model, start: Start, index: int, learns: float) -> tuple[Floats, bool]:
    """Return the error after each step of a lap, and True if the ball was lost. After a loss the error is constant."""
    world = load(case.world, **case.change)
    env = Flights(world, [reset_arguments(start, index)])
    loop = model.loop(env, learns=bool(learns), block=ENDLESS)
    if 0.0 < learns < np.inf:
        loop.pilot = Until(loop.pilot, model, env, round(1000.0 * learns / world.step))  # type: ignore[assignment]
    if case.cut:
        loop.pilot = Cut(loop.pilot, case.cut, model.seed, round(1000.0 * SINCE / world.step))  # type: ignore[assignment]
    lap = fly_lap(loop, env, start, bool(learns))
    env.close()
    error = np.array([px for _, px in env.errors[-1]]) if case.axis is None else np.abs(lap.track[:, case.axis])
    steps = round(1000.0 * world.task.lap / world.task.speed / world.step)
    return np.pad(error, (0, steps - len(error)), mode="edge"), lap.lost


class Until:
    """A pilot that learns for a number of steps, and then flies with frozen weights."""

    def __init__(self, pilot: Any, model: Model, env: Flights, steps: int) -> None:
        self._pilot, self._model, self._env, self._left = pilot, model, env, steps

    def begin(self, copies: int, block: int) -> None:
        """Begin a lap."""
        self._pilot.begin(copies, block)

    def act(self, observations: Floats, infos: Any) -> Any:
        """Act, with frozen weights after the steps of learning."""
        if self._left == 0:
            model = replace(self._model, learnt=self._pilot.arrays()["learnt"])
            self._pilot = model.loop(self._env).pilot
            self._pilot.begin(1, 0)
        self._left -= 1
        return self._pilot.act(observations, infos)

    def teach(self, moment: Any) -> None:
        """Learn, unless the weights are frozen."""
        if self._left >= 0:
            self._pilot.teach(moment)


class Cut:
    """A pilot that loses a share of its synapses onto the motors for good, after a number of steps."""

    def __init__(self, pilot: Any, share: float, seed: int, steps: int) -> None:
        self._pilot, self._share, self._rng, self._left = pilot, share, np.random.default_rng([seed, 11]), steps

    def begin(self, copies: int, block: int) -> None:
        """Begin a lap."""
        self._pilot.begin(copies, block)

    def act(self, observations: Floats, infos: Any) -> Any:
        """Act. After the cut, the weights of the lost synapses are set to 0 in each step."""
        if self._left > 0:
            self._left -= 1
            return self._pilot.act(observations, infos)
        pilot = self._pilot._pilot if isinstance(self._pilot, Until) else self._pilot
        weights = pilot.copies[0].get("cells_motors", "weight").copy()
        if self._left == 0:
            self._gone, self._left = self._rng.random(weights.size) < self._share, -1
        weights[self._gone] = 0.0
        pilot.copies[0].set_weights("cells_motors", weights)
        return self._pilot.act(observations, infos)

    def teach(self, moment: Any) -> None:
        """Learn as the network does."""
        self._pilot.teach(moment)


def measured(name: str, seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the errors over time of all ways with a seed, from a file if it exists."""
    return kept(folder / f"{name} {seed}.json", lambda: all_ways(name, seed, folder))


def all_ways(name: str, seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Fly all ways with a seed and return their errors over time."""
    case, told = CASES[name], {}
    for way in case.ways:
        if way.trained:
            out = folder / f"{case.world} {way.trained} {seed}.h5"
            model = train(load(case.world), way.trained, steps=STEPS, seed=seed, out=out)
        elif seed == 0:
            model = train(load(case.world), way.controller)
        else:
            continue
        told[way.name] = flown(case, model, way.learns)
        print(name, seed, way.name, f"{told[way.name]['error'][-1]:.2f}", told[way.name]["lost"], flush=True)
    return told


def one_of(job: tuple[str, int, Path], report: Callable[[Any], None]) -> dict[str, dict[str, Any]]:
    """Return the result of `measured`. Each job runs in its own process."""
    return measured(*job)


Runs = list[dict[str, Any]]
"""Results of `measured` for one way, by seed."""


def table(found: Mapping[str, Mapping[str, Runs]]) -> str:
    """Return a Markdown table of the mean errors in each phase, with mean and standard deviation over seeds."""
    rows = []
    for name, ways in found.items():
        rate = 1000.0 / load(CASES[name].world).step
        for way, runs in ways.items():
            tracks = errors(runs)
            cells = [spread(tracks[:, round(a * rate) : round(b * rate)].mean(axis=1)) for a, b in PHASES.values()]
            lost = f"{sum(run['lost'] for run in runs)} of {len(STARTS) * len(runs)}"
            rows.append((CASES[name].title, way, *cells, lost))
    return markdown(("change", "way", *PHASES, "lost"), rows)


def errors(runs: Runs) -> Floats:
    """Return the errors over time, (seeds, steps)."""
    return np.array([run["error"] for run in runs])


def figure(found: Mapping[str, Mapping[str, Runs]], file: Path) -> None:
    """Draw the error over time, with a panel for each change."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(7.4, 0.7 + 2.4 * len(found)), dpi=150)
    panels = fig.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, ways) in zip(panels, found.items(), strict=True):
        case = CASES[name]
        seconds = load(case.world).step / 1000.0
        for way in NETWORK:
            tracks = np.array(
                [np.convolve(one, np.full(SMOOTH, 1.0 / SMOOTH), "valid") for one in errors(ways[way.name])]
            )
            time = (np.arange(tracks.shape[1]) + SMOOTH) * seconds
            if way.learns == AGAIN:  # before, it equals the way that goes on learning
                tracks, time = tracks[:, time >= AGAIN], time[time >= AGAIN]
            mean, sd = tracks.mean(axis=0), tracks.std(axis=0, ddof=1) if len(tracks) > 1 else 0.0
            axes.fill_between(time, mean - sd, mean + sd, color=way.colour, alpha=0.2, lw=0)
            axes.plot(time, mean, color=way.colour, lw=1.3, label=way.name)
        for when in (SINCE, AGAIN):
            axes.axvline(when, color=SOFT, lw=0.8, ls=":")
        axes.set_title(case.title, loc="left", fontsize=10)
        axes.set_ylabel(f"error, {case.unit}")
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(0.0, 100.0)
    panels[0].legend(loc="upper right", fontsize=8, frameon=False, ncols=len(NETWORK))
    panels[-1].set_xlabel("time, s")
    fig.tight_layout()
    fig.savefig(file)


def main() -> None:
    """Fly the missing laps, then draw the figure and print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--seeds", type=int, default=8)
    options.add_argument("--cases", choices=CASES, nargs="+", default=list(CASES))
    asked = options.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, Runs]] = {}
    for name in asked.cases:
        each = side_by_side(one_of, [(name, seed, asked.out) for seed in range(asked.seeds)])
        found[name] = {
            way.name: np.array([one[way.name] for one in each if way.name in one]) for way in CASES[name].ways
        }
    (asked.out / "change.md").write_text(table(found))
    figure(found, asked.out / "change.png")
    print(table(found))


if __name__ == "__main__":
    main()
