"""Learning on against frozen weights where the world changes: `nice python benchmarks/drone_change.py --out FOLDER`.

A network is trained for 20,000 steps in still air, then flies laps in which a wind begins. On these laps its weights
are frozen; or it goes on learning from the supervised error; or it learns until `AGAIN` and flies frozen from then on,
which tells what was learnt from what the dopamine steers by itself. Each lap begins with the weights of the training.
The oracle, the centroid and LMS fly the same laps.

Errors along time, mean of 2 x 2 starts for each of `--seeds` trainings, are kept in the folder; a second start goes on.
FOLDER/change.png and FOLDER/change.md are written at the end, with mean and standard deviation over seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from kept import kept, markdown, spread

from neuro.apps import side_by_side
from neuro_drone.controllers import Controller, make
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, begin
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

Floats = npt.NDArray[np.float64]
SINCE, AGAIN = 40.0, 70.0
"""s of a lap of 100 s: when the world changes, and when a network that has learnt the change is frozen again."""
STEPS = 20_000
STARTS = tuple(Start((x, y)) for x in (-10.0, 10.0) for y in (-10.0, 10.0))
SMOOTH = 20
"""Steps of the running mean in the figure."""
PHASES = {"before": (10.0, SINCE), "5 s after": (SINCE, SINCE + 5.0), "from 70 s on": (AGAIN, 100.0)}
SOFT = "#8a919c"


@dataclass(frozen=True)
class Way:
    """How a lap is flown.

    Attributes:
        name: in table and figure.
        colour: in the figure.
        trained: the controller, trained with each seed; empty for one that needs no training.
        controller: by name, of one that needs none.
        learns: until when, s.
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
"""What the figure shows, with the spread over seeds; the others are in the table."""
LMS = (Way("LMS, frozen", trained="lms"), Way("LMS, learning on", trained="lms", learns=np.inf))
ORACLE = Way("oracle", controller="oracle")
WAYS = (*NETWORK, *LMS, Way("centroid", controller="centroid"), ORACLE)


@dataclass(frozen=True)
class Case:
    """A change of the world.

    Attributes:
        title: in the figure.
        world: the scenario.
        change: of it in flight.
        axis: whose error is told: None the distance in the picture, else the number of the axis, absolute.
        unit: of the error.
        ways: that are flown.
    """

    title: str
    world: str
    change: Mapping[str, Any]
    axis: int | None = None
    unit: str = "px"
    ways: tuple[Way, ...] = WAYS


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
}


def flown(case: Case, pilot: Callable[[], Controller], learns: float) -> dict[str, Any]:
    """The error after each step, mean of all starts, and from how many the ball was lost.

    Args:
        case: the change.
        pilot: makes the controller, anew for each start.
        learns: until when, s.
    """
    env = DroneEnv(load(case.world, **case.change))
    laps = [one_lap(env, case, pilot(), start, index, learns) for index, start in enumerate(STARTS)]
    env.close()
    return {"error": np.mean([track for track, _ in laps], axis=0).tolist(), "lost": sum(lost for _, lost in laps)}


def one_lap(
    env: DroneEnv, case: Case, controller: Controller, start: Start, index: int, learns: float
) -> tuple[Floats, bool]:
    """The error after each step of a lap, and whether the ball was lost: from then on the error stays as it was."""
    info = begin(env, start, index)
    controller.begin()
    seconds = env.scenario.step / 1000.0
    steps = round(env.scenario.task.lap / env.scenario.task.speed / seconds)
    track, lost = np.zeros(steps), False
    for step in range(steps):
        if lost:
            track[step:] = track[step - 1]
            break
        if learns and step == round(min(learns, 1e6) / seconds):
            controller = controller.frozen()
            controller.begin()
        _, _, lost, _, info = env.step(controller.act(info["counts"], info))
        controller.learn(info)
        track[step] = info["error_px"] if case.axis is None else abs(info["error"][case.axis])
    return track, lost


def measured(name: str, seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Errors along time of all ways with a seed; flown if the file is not there."""
    return kept(folder / f"{name} {seed}.json", lambda: all_ways(name, seed, folder))


def all_ways(name: str, seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Errors along time of all ways with a seed, flown now."""
    case, told = CASES[name], {}
    for way in case.ways:
        if way.trained:
            out = folder / f"{case.world} {way.trained} {seed}.h5"
            model = train(load(case.world), way.trained, steps=STEPS, seed=seed, out=out)
            pilot = pilot_of(model, case, bool(way.learns))
        elif seed == 0:
            pilot = bound(way.controller, case)
        else:
            continue
        told[way.name] = flown(case, pilot, way.learns)
        print(name, seed, way.name, f"{told[way.name]['error'][-1]:.2f}", told[way.name]["lost"], flush=True)
    return told


def one_of(job: tuple[str, int, Path], report: Callable[[Any], None]) -> dict[str, dict[str, Any]]:
    """`measured`, in a process of its own."""
    return measured(*job)


def pilot_of(model: Model, case: Case, learning: bool) -> Callable[[], Controller]:
    """What makes the trained controller anew."""
    world = load(case.world, **case.change)
    return lambda: model.learner(world) if learning else model.frozen(world)


def bound(name: str, case: Case) -> Callable[[], Controller]:
    """What makes a controller that needs no training."""
    return lambda: make(name, load(case.world, **case.change))


Runs = list[dict[str, Any]]
"""What `measured` has of a way, of each seed."""


def table(found: Mapping[str, Mapping[str, Runs]]) -> str:
    """Mean errors in each phase, mean and standard deviation over seeds, Markdown."""
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
    """Errors along time, (seeds, steps)."""
    return np.array([run["error"] for run in runs])


def figure(found: Mapping[str, Mapping[str, Runs]], file: Path) -> None:
    """Error over time, a panel for each change."""
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
            if way.learns == AGAIN:  # up to then it is the one that goes on learning
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
    """Fly what is missing, then draw and tell."""
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
