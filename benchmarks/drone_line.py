"""The line in both directions, and the ball on textured ground: `nice python benchmarks/drone_line.py --out FOLDER`.

Each row is trained from `--seeds` seeds and flown with frozen weights from a 5 x 5 grid of starts, one process. Each
run is kept in the folder; a second start goes on. FOLDER/line.md and FOLDER/texture.md are written after each run,
`--minutes` begins no run later than that, `--task` asks for one of the two.
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

from neuro_drone.evaluate import Lap, try_out
from neuro_drone.scenario import load
from neuro_drone.train import train

ABOVE = {"camera.pos_thres": 0.5, "camera.neg_thres": 0.5}
"""Thresholds above most of the texture's contrast; that of the ball on the ground is ln 3 = 1.1."""
TEXTURE, REDRAWN = {"scn": "B60-texture"}, {"scn": "B60-texture", "ground.redraw": True}


@dataclass(frozen=True)
class Row:
    """A line of a table; worlds are changes of a scenario, whose name is `scn`."""

    controller: str
    steps: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    world: dict[str, Any] = field(default_factory=lambda: {"scn": "line"})
    tested: dict[str, Any] | None = None

    @property
    def name(self) -> str:
        """What tells it from the others."""
        told = [f"{word}={value}" for word, value in self.settings.items()]
        told += [str(value) if word == "scn" else f"{word}={value}" for word, value in self.world.items()]
        told += [] if self.tested is None else ["flown on", *(f"{value}" for value in self.tested.values())]
        return " ".join([self.controller, *told])


ROWS = {
    "line": (
        Row("nothing"), Row("oracle"), Row("oracle", settings={"gain": [8.0, 8.0]}), Row("snn", 60_000),
        Row("centroid"), Row("static-linear"), Row("lms", 60_000), Row("snn", 20_000), Row("snn-eta0", 20_000),
        Row("snn-flipped", 20_000), Row("snn", 60_000, {"coding": "shares"}), Row("static"),
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


def measured(row: Row, seed: int, file: Path, late: bool) -> dict[str, Any] | None:
    """What came of a run, which is flown if the file is not there and there is time."""
    if file.exists() or late:
        return json.loads(file.read_text()) if file.exists() else None
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
    unfinished = file.with_suffix(".part")
    unfinished.write_text(json.dumps(told))
    unfinished.replace(file)
    print(json.dumps(told), flush=True)
    return told


def summary(laps: Any) -> dict[str, Any]:
    """Means over laps; where nothing is lost, of all steps."""
    each: list[Lap] = list(laps)
    absolute, signed = (
        np.mean([getattr(lap, what) for lap in each], axis=0).tolist() for what in ("absolute", "signed")
    )
    counted = {"laps": sum(lap.lap for lap in each), "lost": sum(lap.lost for lap in each), "starts": len(each)}
    return {
        "error_px": float(np.mean([lap.error_px for lap in each])),
        "absolute": absolute,
        "signed": signed,
    } | counted


def table(task: str, runs: list[dict[str, Any]]) -> str:
    """The table of a task, Markdown; means and standard deviations over seeds."""
    grouped: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for run in runs:
        grouped.setdefault((run["row"], run["steps"]), []).append(run)
    second = ["direction", "abs. u, px", "abs. angle, degrees", "signed u", "signed angle"] if task == "line" else []
    columns = ["controller", "steps", "seeds", *(second or ["error, px"]), "laps", "lost"]
    lines = ["| " + " | ".join(columns) + " |", "| --- " * len(columns) + "|"]
    for (name, steps), group in grouped.items():
        for way in ("+1", "-1") if second else ("all",):
            told = [run[way] for run in group]
            figures = [way, *axes(told, "absolute"), *axes(told, "signed")] if second else [spread(told, "error_px")]
            counts = [
                f"{sum(one[what] for one in told)}/{sum(one['starts'] for one in told)}" for what in ("laps", "lost")
            ]
            lines.append("| " + " | ".join([name, str(steps), str(len(told)), *figures, *counts]) + " |")
    return "\n".join(lines) + "\n"


def axes(told: list[dict[str, Any]], what: str) -> Iterator[str]:
    """Both axes of an error."""
    return (spread([{what: one[what][axis]} for one in told], what) for axis in range(2))


def spread(told: list[dict[str, Any]], what: str) -> str:
    """Mean and standard deviation over seeds."""
    values = [one[what] for one in told]
    return f"{np.mean(values):.2f}" + (f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else "")


def main() -> None:
    """Do what is missing."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--task", choices=ROWS, nargs="+", default=list(ROWS))
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--minutes", type=float, default=np.inf, help="begin no run later")
    asked = options.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 60.0 * asked.minutes
    for task in asked.task:
        runs = []
        for row in ROWS[task]:
            for seed in range(asked.seeds if row.steps else 1):
                file = asked.out / f"{task} {row.name} {row.steps} {seed}.json"
                told = measured(row, seed, file, time.monotonic() > end)
                runs += [] if told is None else [told]
                (asked.out / f"{task}.md").write_text(table(task, runs))


if __name__ == "__main__":
    main()
