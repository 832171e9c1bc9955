"""DQN and DDPG on the drone's tasks: `nice python benchmarks/drone_rl.py --out FOLDER`.

The tuning protocol, the same for both agents and both tasks (ball: scenario B60; line: scenario line):

1. Tuning: v_max 0.3, 0.5, 1 and 2 m/s, one seed each, 50,000 steps of DQN, 25,000 of DDPG (an update of DDPG costs
   about three of DQN's). The best is the one with the most laps, then the fewest starts from which the target was
   lost, then the smallest error.
2. Final: that v_max and the spiking network's (the scenario's own), 150,000 steps of DQN, 75,000 of DDPG, new seeds:
   tuning has seed 100, finals have 0, 1, 2.

All other settings are the agents' defaults, chosen beforehand on B60 from a few trainings with one seed each. DQN at
0.5 m/s, 50,000 steps: learning rate 3e-4 and gamma 0.9 (7.8 px, 25 laps of 25), beside gamma 0.8 with a batch of 128
(7.9 px, 25) and stable-baselines3's own 1e-4, 0.99, 32 and a target copied each 10,000 steps (15.0 px, 22); 1e-3 gave
12.0 px, 22 laps, and at 1 m/s 10.3 px, 25 laps after 50,000 steps and 37.0 px, 0 laps after 150,000 of another seed.
DDPG at 0.5 m/s, 25,000 steps: the package's 1e-3 (8.8 and 17.4 px, 25 and 21 laps), beside 3e-4 (13.1 px, 6 laps).

Episodes are those of every other controller, see `neuro_drone.train.EPISODES`. Tests are with frozen networks from the
5 x 5 grid of starts; the target counts as lost where it leaves the picture before the end.
`--observation counts` shows the agents counts of events in place of the thesis' zeros and ones; give it a folder of its
own.

Each run keeps its model and its result in the folder; a second start goes on. After each run the table is written to
FOLDER/table.md. `--minutes` begins no run later than that; `--share` takes a share of all steps, where time is short.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neuro_drone.evaluate import Tried, try_out
from neuro_drone.scenario import load
from neuro_drone.train import train

SPEEDS = (0.3, 0.5, 1.0, 2.0)
TUNING = {"dqn": 50_000, "ddpg": 25_000}
FINAL = {"dqn": 150_000, "ddpg": 75_000}
TUNING_SEED = 100
TASKS = ("B60", "line")
COLUMNS = (
    "task", "agent", "steps", "v_max, m/s", "seeds", "error, px", "error, degrees", "laps", "lost", "CPU, s a run"
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A training and its test."""

    task: str
    agent: str
    v_max: float
    steps: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.task}-{self.agent}-{self.v_max:g}-{self.steps}-{self.seed}"


class Bench:
    """All runs, kept in a folder."""

    def __init__(self, folder: Path, observation: str, end: float) -> None:
        self.folder, self.observation, self.end = folder, observation, end
        folder.mkdir(parents=True, exist_ok=True)

    def result(self, run: Run) -> dict[str, Any] | None:
        """What came of a run; it is done now unless it was before, or the time is over (None)."""
        file = self.folder / f"{run.name}.json"
        if file.exists():
            return json.loads(file.read_text())
        if time.monotonic() > self.end:
            return None
        began, model_file = time.process_time(), self.folder / f"{run.name}.h5"
        world = load(run.task, **{"drone.v_max": run.v_max})
        seen = {"observation": self.observation}
        words = {"steps": run.steps, "seed": run.seed, "settings": seen}
        model = train(world, run.agent, out=model_file, **words)
        cpu = time.process_time() - began
        tried = try_out(model)
        kept = [lap for lap in tried.each if not lap.lost]
        told = {"task": run.task, "agent": run.agent, "v_max": run.v_max, "steps": run.steps, "seed": run.seed} | seen
        line = _line_errors(tried)
        told |= {"error_px": line[0] if run.task == "line" else tried.error_px, "degrees": line[1], "laps": tried.laps}
        told |= {"lost": tried.starts - len(kept), "starts": tried.starts, "cpu_s": round(cpu, 1)}
        unfinished = file.with_suffix(".part")
        unfinished.write_text(json.dumps(told))
        unfinished.replace(file)
        print(json.dumps(told), flush=True)
        self.write()
        return told

    def tune(self, task: str, agent: str, steps: int) -> float | None:
        """The best v_max of a short training; None where the time did not suffice."""
        runs = [self.result(Run(task, agent, v, steps, TUNING_SEED)) for v in SPEEDS]
        found = [one for one in runs if one is not None]
        return min(found, key=_rank)["v_max"] if len(found) == len(runs) else None

    def write(self) -> None:
        """Write the table of all results so far."""
        found: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        for one in (json.loads(file.read_text()) for file in sorted(self.folder.glob("*.json"))):
            found.setdefault((one["task"], one["agent"], one["steps"], one["v_max"]), []).append(one)
        lines = [
            "| task | agent | steps | v_max, m/s | seeds | error, px | error, degrees | laps | lost | CPU, s a run |"
        ]
        lines.append("| --- " * 10 + "|")
        for (task, agent, steps, v_max), runs in sorted(found.items()):
            second = _spread([r["degrees"] for r in runs]) if task == "line" else ""
            lines.append(
                f"| {task} | {agent} | {steps} | {v_max:g} | {len(runs)} | {_spread([r['error_px'] for r in runs])} | "
                f"{second} | {_all(runs, 'laps')} | {_all(runs, 'lost')} | {np.mean([r['cpu_s'] for r in runs]):.0f} |"
            )
        (self.folder / "table.md").write_text("\n".join(lines) + "\n")


def main() -> None:
    """Run what is missing."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    options.add_argument("--observation", choices=("binary", "counts"), default="binary")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--share", type=float, default=1.0, help="of the steps")
    options.add_argument("--minutes", type=float, default=np.inf, help="begin no run later")
    asked = options.parse_args()
    torch.set_num_threads(1)
    bench = Bench(asked.out, asked.observation, time.monotonic() + 60.0 * asked.minutes)
    for task in asked.tasks:
        best = {agent: bench.tune(task, agent, round(asked.share * steps)) for agent, steps in TUNING.items()}
        own = load(task).drone.v_max
        for seed in range(asked.seeds):
            for agent, v_max in best.items():
                for v in dict.fromkeys((v_max, own)):
                    if v is not None:
                        bench.result(Run(task, agent, v, round(asked.share * FINAL[agent]), seed))
    bench.write()


def _line_errors(tried: Tried) -> list[float]:
    """Mean absolute errors of both axes over all starts, without moments at which no line was to be seen."""
    means = [np.abs(lap.track[np.isfinite(lap.track).all(axis=1)]).mean(axis=0) for lap in tried.each]
    return np.mean(means, axis=0).tolist()


def _rank(one: dict[str, Any]) -> tuple[float, ...]:
    return (-one["laps"], one["lost"], one["error_px"])


def _spread(values: list[float]) -> str:
    return f"{np.mean(values):.2f}" + (f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else "")


def _all(runs: list[dict[str, Any]], what: str) -> str:
    return f"{sum(r[what] for r in runs)}/{sum(r['starts'] for r in runs)}"


if __name__ == "__main__":
    main()
