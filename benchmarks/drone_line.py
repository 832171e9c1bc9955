"""The line in both directions, and the ball on textured ground: `nice python benchmarks/drone_line.py --out FOLDER`.

Each row is trained with `--seeds` seeds and flown with frozen weights from a 5 x 5 grid of starts, in one process. Each
run is stored in the folder, so an interrupted benchmark can be continued. FOLDER/line.md and FOLDER/texture.md are
written after each run. No run begins after `--minutes`. `--task` selects one of the two tasks.

`--lean MODEL` shows where a network that was trained on `line` loses the lean. The frozen network makes four flights,
two in each direction. Linear read-outs of the shares of the fields are fitted to the lean by least squares on two
flights, and tested on the other two.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from kept import kept, markdown, spread

from neuro_drone.evaluate import Flights, Lap, Start, reset_arguments, try_out
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

STARTS = (Start((20.0, 10.0), 1), Start((-10.0, -5.0), -1), Start((-20.0, 5.0), 1), Start((10.0, 0.0), -1))
NOISE = 50
CORNER = 15.0
"""Settings of the flights for `--lean`: seed of the first flight's noise, and least lean of a corner in degrees."""
Floats = npt.NDArray[np.float64]
ABOVE = {"camera.pos_thres": 0.5, "camera.neg_thres": 0.5}
"""Thresholds above most of the contrast of the texture. The contrast of the ball on the ground is ln 3 = 1.1."""
TEXTURE, REDRAWN = {"scn": "B60-texture"}, {"scn": "B60-texture", "ground.redraw": True}


@dataclass(frozen=True)
class Row:
    """A row of a table. A world is a scenario, whose name is `scn`, with changed settings."""

    controller: str
    steps: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    world: dict[str, Any] = field(default_factory=lambda: {"scn": "line"})
    tested: dict[str, Any] | None = None

    @property
    def name(self) -> str:
        """Text that distinguishes the row from others."""
        told = [f"{word}={value}" for word, value in self.settings.items()]
        told += [str(value) if word == "scn" else f"{word}={value}" for word, value in self.world.items()]
        told += [] if self.tested is None else ["flown on", *(f"{value}" for value in self.tested.values())]
        return " ".join([self.controller, *told])


ROWS = {
    "line": (
        Row("nothing"), Row("oracle"), Row("oracle", settings={"gain": [8.0, 8.0]}), Row("snn", 60_000),
        Row("centroid"), Row("static-linear"), Row("lms", 60_000), Row("snn", 20_000), Row("snn-eta0", 20_000),
        Row("snn-flipped", 20_000), Row("snn", 60_000, {"coding": "all"}), Row("static"),
    ),
    "texture": (
        Row("nothing", world=TEXTURE), Row("oracle", world=TEXTURE), Row("centroid", world=TEXTURE),
        Row("centroid", world=TEXTURE | ABOVE), Row("snn", 20_000, world={"scn": "B60"}, tested=TEXTURE),
        Row("snn", 20_000, world=TEXTURE), Row("snn", 20_000, {"coding": "peaks"}, TEXTURE),
        Row("snn", 20_000, {"coding": "peaks"}, {"scn": "B60"}, TEXTURE), Row("snn", 20_000, world=TEXTURE | ABOVE),
        Row("lms", 20_000, world=TEXTURE), Row("lms", 20_000, {"coding": "peaks"}, TEXTURE),
        Row("lms", 20_000, world=TEXTURE | ABOVE), Row("snn", 20_000, world=REDRAWN),
        Row("snn", 20_000, {"coding": "peaks"}, REDRAWN),
    ),
}  # fmt: skip


def measured(row: Row, seed: int) -> dict[str, Any]:
    """Train and test a row with a seed, and return the figures."""
    began = time.process_time()
    worlds = [dict(row.world), dict(row.tested or row.world)]
    home, abroad = (load(world.pop("scn"), **world) for world in worlds)
    tried = try_out(
        train(home, row.controller, steps=max(row.steps, 1), seed=seed, settings=row.settings), scenario=abroad
    )
    told = {"row": row.name, "steps": row.steps, "seed": seed, "cpu_s": round(time.process_time() - began, 1)}
    told |= {"all": summary(tried.each)}
    for way in sorted({lap.start.direction for lap in tried.each} - {0}):
        told[f"{way:+d}"] = summary([lap for lap in tried.each if lap.start.direction == way])
    print(json.dumps(told), flush=True)
    return told


def summary(laps: Any) -> dict[str, Any]:
    """Return the means of the errors of laps. The error of a lap without a loss is a mean over all its steps."""
    each: list[Lap] = list(laps)
    counted = {"laps": sum(lap.lap for lap in each), "lost": sum(lap.lost for lap in each), "starts": len(each)}
    names = ("error_px", "absolute", "signed")
    return {name: np.mean([getattr(lap, name) for lap in each], axis=0).tolist() for name in names} | counted


def table(task: str, runs: list[dict[str, Any]]) -> str:
    """Return the Markdown table of a task, with means and standard deviations over seeds."""
    grouped: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for run in runs:
        grouped.setdefault((run["row"], run["steps"]), []).append(run)
    second = ["direction", "abs. u, px", "abs. angle, degrees", "signed u", "signed angle"] if task == "line" else []
    rows = []
    for (name, steps), group in grouped.items():
        for way in ("+1", "-1") if second else ("all",):
            told = [run[way] for run in group]
            figures = [spread([one["error_px"] for one in told])]
            if second:
                each = [[one[what][axis] for one in told] for what in ("absolute", "signed") for axis in range(2)]
                figures = [way, *map(spread, each)]
            starts = sum(one["starts"] for one in told)
            counts = [f"{sum(one[what] for one in told)}/{starts}" for what in ("laps", "lost")]
            rows.append((name, steps, len(told), *figures, *counts))
    return markdown(("controller", "steps", "seeds", *(second or ["error, px"]), "laps", "lost"), rows)


def flown(model: Model, start: Start, noise: int, most: int) -> tuple[Floats, Floats]:
    """Return events in 16 x 16 fields, (steps, 16, 16), and the lean in degrees, (steps,), of a flight."""
    env = Seen(model.scenario, [reset_arguments(start, noise)])
    model.loop(env).test(1, most=most)
    env.close()
    return np.array(env.counts[:-1]), np.array(env.leans[:-1])


class Seen(Flights):
    """A flight that records events in 16 x 16 fields, and the lean, of each control step."""

    def _keep(self) -> None:
        events = self.last[-1]["events"]
        self.counts.append(np.histogram2d(events.y, events.x, bins=16, range=((0, 128), (0, 128)))[0])
        self.leans.append(self.last[-1]["error"][1])

    def reset(self, **words: Any) -> tuple[Any, dict[str, Any]]:
        """Begin the flight."""
        self.counts: list[Floats] = []
        self.leans: list[float] = []
        answer = super().reset(**words)
        self._keep()
        return answer

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a control step."""
        answer = super().step(action)
        self._keep()
        return answer


def inputs(counts: Floats, fields: int, keep: float) -> Floats:
    """Return the share of each field in a leaky sum of events, (steps, fields^2).

    The sum keeps the share `keep` from step to step.
    """
    n = 16 // fields
    coarse = counts.reshape(len(counts), fields, n, fields, n).sum((2, 4))
    for k in range(1, len(coarse)):
        coarse[k] += keep * coarse[k - 1]
    rows = coarse.sum(2, keepdims=True)
    shares: Floats = (coarse / np.where(rows > 0, rows, 1) / fields).reshape(len(coarse), -1)
    return shares


def fitted(flights: list[tuple[Floats, Floats]], fields: int, keep: float, only_sides: bool) -> tuple[Any, Any]:
    """Return the mean error on the sides in degrees, and the share of a corner's lean that a read-out finds.

    Both are measured on the flights to which the read-out was not fitted.
    """
    seen = [(inputs(counts, fields, keep), lean) for counts, lean in flights]
    guesses, truths = [], []
    for fit, test in ((seen[:2], seen[2:]), (seen[2:], seen[:2])):
        x, y = np.vstack([a for a, _ in fit]), np.concatenate([b for _, b in fit])
        used = np.abs(y) <= CORNER if only_sides else np.full(len(y), True)
        x, y = x[used], y[used]
        weights = np.linalg.solve(x.T @ x + 1e-3 * np.eye(x.shape[1]), x.T @ y)
        guesses += [a @ weights for a, _ in test]
        truths += [b for _, b in test]
    guess, truth = np.concatenate(guesses), np.concatenate(truths)
    corner = np.abs(truth) > CORNER
    told = np.sum(guess[corner] * np.sign(truth[corner])) / np.abs(truth[corner]).sum()
    return np.abs(guess - truth)[~corner].mean(), told


def read_outs(model: Model, steps: int) -> None:
    """Print the lean that the network flew, and the errors of linear read-outs of the lean."""
    flights = [flown(model, start, NOISE + k, steps) for k, start in enumerate(STARTS)]
    leans = np.abs(np.concatenate([lean for _, lean in flights]))
    corner = leans > CORNER
    print(f"flown: {leans.mean():.2f} degrees, of it {leans[corner].sum() / len(leans):.2f} at corners; "
          f"on the sides {leans[~corner].mean():.2f}")  # fmt: skip
    for only_sides in (False, True):
        for fields, keep in ((8, 0.0), (8, 0.75), (16, 0.0), (16, 0.75)):
            error, told = fitted(flights, fields, keep, only_sides)
            what = "sides only" if only_sides else "all moments"
            print(f"{fields} x {fields}, keeps {keep:g}, {what}: sides {error:.2f} degrees, corners told {told:.2f}")


def main() -> None:
    """Run the missing trainings and write the tables."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path)
    options.add_argument("--lean", type=Path, metavar="MODEL", help="of this network trained on the line instead")
    options.add_argument("--steps", type=int, default=3000, help="of a flight of --lean")
    options.add_argument("--task", choices=ROWS, nargs="+", default=list(ROWS))
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--minutes", type=float, default=np.inf, help="begin no run later")
    asked = options.parse_args()
    if asked.lean:
        read_outs(Model.load(asked.lean), asked.steps)
        return
    if asked.out is None:
        options.error("expected --out FOLDER or --lean MODEL")
    asked.out.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 60.0 * asked.minutes
    for task in asked.task:
        runs = []
        for row in ROWS[task]:
            for seed in range(asked.seeds if row.steps else 1):
                file = asked.out / f"{task} {row.name} {row.steps} {seed}.json"
                if file.exists() or time.monotonic() <= end:
                    runs.append(kept(file, lambda row=row, seed=seed: measured(row, seed)))
                (asked.out / f"{task}.md").write_text(table(task, runs))


if __name__ == "__main__":
    main()
