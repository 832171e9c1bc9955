"""Agents that learn from the reward, with equal budgets: `nice python benchmarks/drone_rl.py --out FOLDER`.

DQN, DDPG, PPO (stable-baselines3) and a linear policy by random search, on the ball (B60) or the line:

1. Tries: 12 settings of each agent (drone_rl.yaml), v_max among them, with 20,000 steps and seed 100. The best try has
   the most laps from a grid of 3 x 3 starts within 50 px (line: the spread of its test), then the fewest starts from
   which the target was lost, then the smallest error. These starts and paths differ from those of the final test.
2. Finals: the best settings with 150,000 steps and seeds 0 to 4. The test is `neuro drone test` (frozen, 25 starts,
   varied paths), and once more with `--path fixed`.

All trainings begin within 50 px. `lms` and `snn` are shown for comparison, with their defaults and 20,000 steps. They
learn from the supervised error, so their steps cannot be compared with those of the others. Their settings were chosen
earlier on B60, from more tries.

Model and result of each run are stored in the folder, so the benchmark can be continued, also within a run. The table
of all runs is written to FOLDER/table.md. No run begins after `--minutes`. `--table` runs nothing and prints a row for
each agent.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from kept import kept, markdown, spread

from neuro_drone.evaluate import FlightTest, grid, try_out
from neuro_drone.model import Model
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import load
from neuro_drone.train import train

TRY_STEPS, FINAL_STEPS = 20_000, 150_000
TRY_SEED, FINAL_SEEDS = 100, range(5)
TRY_TEST, TRY_GRID, TRY_SPREAD = 1, 3, {"B60": 50.0, "line": None}
AGENTS = ("random-search", "ppo", "dqn", "ddpg")
BESIDE, BESIDE_STEPS = ("lms", "snn"), 20_000
TASKS = ("B60", "line")

TRIES: dict[str, list[dict[str, Any]]] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
"""Twelve settings of each agent, by agent."""


@dataclass(frozen=True)
class Run:
    """A training and its test."""

    task: str
    agent: str
    stage: str
    seed: int
    steps: int
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.task}-{self.agent}-{self.stage}-{self.steps}-{self.seed}"

    def train(self, file: Path) -> Model:
        """Train the model, or continue its training."""
        own = {name: value for name, value in self.settings.items() if "." not in name}
        world = {name: value for name, value in self.settings.items() if "." in name}
        return train(load(self.task, **world), self.agent, steps=self.steps, seed=self.seed, settings=own, out=file)

    def test(self, model: Model) -> dict[str, Any]:
        """Return the figures of the test of this stage."""
        if self.stage != "final":
            places = grid(model.scenario, TRY_GRID, TRY_SPREAD[self.task], FlightCourse(seed=TRY_TEST))
            return figures(try_out(model, starts=places))
        fixed = figures(try_out(model, starts=grid(model.scenario, course=FlightCourse("fixed"))))
        return figures(try_out(model)) | {"fixed": fixed}


class Bench:
    """All runs, whose results are stored in a folder."""

    def __init__(self, folder: Path, end: float) -> None:
        self.folder, self.end = folder, end
        folder.mkdir(parents=True, exist_ok=True)

    def result(self, run: Run) -> dict[str, Any] | None:
        """Return the result of a run, which runs now if there is no result yet. Return None if the time is over."""
        file = self.folder / f"{run.name}.json"
        if file.exists() or time.monotonic() <= self.end:
            return kept(file, lambda: self._done(run, file))
        return None

    def _done(self, run: Run, file: Path) -> dict[str, Any]:
        began = time.process_time()
        model = run.train(file.with_suffix(".h5"))
        trained = time.process_time()
        told = {"task": run.task, "agent": run.agent, "stage": run.stage, "steps": run.steps, "seed": run.seed}
        told |= {"settings": run.settings} | run.test(model)
        told |= {"train_s": round(trained - began, 1), "test_s": round(time.process_time() - trained, 1)}
        print(json.dumps(told), flush=True)
        return told

    def best(self, task: str, agent: str) -> dict[str, Any] | None:
        """Return the settings of the best try, or None if the time was over before all tries ended."""
        runs = (Run(task, agent, f"try{k:02}", TRY_SEED, TRY_STEPS, one) for k, one in enumerate(TRIES[agent]))
        found = [self.result(run) for run in runs]
        self.write()
        return min((one for one in found if one), key=_rank)["settings"] if all(found) else None

    def found(self) -> Iterator[dict[str, Any]]:
        """Yield all results so far."""
        return (json.loads(file.read_text()) for file in sorted(self.folder.glob("*.json")))

    def write(self) -> None:
        """Write the table of all results so far."""
        groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        for one in self.found():
            groups.setdefault((one["task"], one["stage"], one["agent"], one["steps"]), []).append(one)
        columns = ("task", "stage", "agent", "steps", "settings", "seeds", "error", "laps", "lost", "path fixed: error",
                   "laps", "CPU of a training, s")  # fmt: skip
        rows = []
        for (task, stage, agent, steps), runs in sorted(groups.items()):
            fixed = [run["fixed"] for run in runs if "fixed" in run]
            settings = ", ".join(f"{name} {value}" for name, value in runs[0]["settings"].items())
            rows.append(
                (task, stage, agent, steps, settings, len(runs), _errors(task, runs), _all(runs, "laps"),
                 _all(runs, "lost"), _errors(task, fixed), _all(fixed, "laps"),
                 f"{np.mean([run['train_s'] for run in runs]):.0f}")
            )  # fmt: skip
        (self.folder / "table.md").write_text(markdown(columns, rows))

    def summary(self, tasks: list[str]) -> str:
        """Return a table of the results so far. Each agent has a row with its best try and with its finals."""
        heads = (
            "task", "agent", "settings", "tries", "median", "best try", "laps", "finals", "varied paths", "laps",
            "fixed path", "laps", "CPU of a final, s",
        )  # fmt: skip
        found = list(self.found())
        rows = [_row(task, agent, found) for task in tasks for agent in (*AGENTS, *BESIDE)]
        return markdown(heads, rows)


def _row(task: str, agent: str, found: list[dict[str, Any]]) -> tuple[Any, ...]:
    mine = [one for one in found if (one["task"], one["agent"]) == (task, agent)]
    finals, tries = ([one for one in mine if (one["stage"] == "final") == final] for final in (True, False))
    best = sorted(tries, key=_rank)[:1]
    settings = ", ".join(f"{name} {value}" for one in (finals or best)[:1] for name, value in one["settings"].items())
    fixed = [one["fixed"] for one in finals]
    seconds = f"{np.mean([one['train_s'] for one in finals]):.0f}" if finals else ""
    return (
        task, agent, settings, f"{len(tries)} of {len(TRIES.get(agent, ()))}", _median(task, tries),
        _errors(task, best), _all(best, "laps"), f"{len(finals)} of {len(FINAL_SEEDS)}", _errors(task, finals),
        _all(finals, "laps"), _errors(task, fixed), _all(fixed, "laps"), seconds,
    )  # fmt: skip


def main() -> None:
    """Run the missing trainings and tests."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--tasks", nargs="+", choices=TASKS, default=["B60"])
    options.add_argument("--agents", nargs="+", choices=AGENTS, default=list(AGENTS))
    options.add_argument("--minutes", type=float, default=np.inf, help="begin no run later")
    options.add_argument("--table", action="store_true", help="print what is there, a row for each agent, and end")
    asked = options.parse_args()
    bench = Bench(asked.out, time.monotonic() + 60.0 * asked.minutes)
    if asked.table:
        print(bench.summary(asked.tasks), end="")
        return
    for task in asked.tasks:
        best = {agent: bench.best(task, agent) for agent in asked.agents}
        for agents in (AGENTS[:2], BESIDE, AGENTS[2:]):  # slow agents, which take minutes per seed, come last
            for seed in FINAL_SEEDS:
                for agent in agents:
                    if agent in BESIDE:
                        bench.result(Run(task, agent, "final", seed, BESIDE_STEPS))
                    elif (settings := best.get(agent)) is not None:
                        bench.result(Run(task, agent, "final", seed, FINAL_STEPS, settings))
                bench.write()


def figures(tried: FlightTest) -> dict[str, Any]:
    """Return the figures of a test: errors, laps, and the number of starts from which the target was lost.

    `absolute` has the errors on both axes, without moments at which no line was visible.
    """
    seen = [lap.track[np.isfinite(lap.track).all(axis=1)] for lap in tried.each]
    absolute = np.mean([np.abs(track).mean(axis=0) for track in seen], axis=0).tolist()
    lost = sum(lap.lost for lap in tried.each)
    return {"error_px": tried.error_px, "absolute": absolute, "laps": tried.laps, "lost": lost, "starts": tried.starts}


def _median(task: str, runs: list[dict[str, Any]]) -> str:
    """Return the median of the error as text. On a line it is the error of the column."""
    errors = [run["absolute"][0] if task == "line" else run["error_px"] for run in runs]
    return f"{np.median(errors):.2f} px" if errors else ""


def _rank(one: dict[str, Any]) -> tuple[float, ...]:
    error = one["absolute"][0] if one["task"] == "line" else one["error_px"]
    return (-one["laps"], one["lost"], error)


def _errors(task: str, runs: list[dict[str, Any]]) -> str:
    if not runs:
        return ""
    if task == "line":
        column, lean = np.transpose([run["absolute"] for run in runs])
        return f"{spread(column)} px, {spread(lean)} degrees"
    return f"{spread([run['error_px'] for run in runs])} px"


def _all(runs: list[dict[str, Any]], what: str) -> str:
    return f"{sum(r[what] for r in runs)} of {sum(r['starts'] for r in runs)}" if runs else ""


if __name__ == "__main__":
    main()
