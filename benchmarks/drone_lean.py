"""Where the lean of the line is lost: `python benchmarks/drone_lean.py MODEL`, MODEL a network trained on `line`.

Four flights of the frozen network, two in each direction. Linear read-outs of the fields' shares are fitted to the lean
by least squares on two of them, and tried on the other two.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, begin
from neuro_drone.model import Model

STARTS = (Start((20.0, 10.0), 1), Start((-10.0, -5.0), -1), Start((-20.0, 5.0), 1), Start((10.0, 0.0), -1))
NOISE = 50
CORNER = 15.0
Floats = npt.NDArray[np.float64]


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("model", type=Path)
    options.add_argument("--steps", type=int, default=3000, help="of a flight")
    asked = options.parse_args()
    model = Model.load(asked.model)
    flights = [flown(model, start, NOISE + k, asked.steps) for k, start in enumerate(STARTS)]
    leans = np.abs(np.concatenate([lean for _, lean in flights]))
    corner = leans > CORNER
    print(f"flown: {leans.mean():.2f} degrees, of it {leans[corner].sum() / len(leans):.2f} at corners; "
          f"on the sides {leans[~corner].mean():.2f}")  # fmt: skip
    for only_sides in (False, True):
        for fields, keep in ((8, 0.0), (8, 0.75), (16, 0.0), (16, 0.75)):
            error, told = fitted(flights, fields, keep, only_sides)
            what = "sides only" if only_sides else "all moments"
            print(f"{fields} x {fields}, keeps {keep:g}, {what}: sides {error:.2f} degrees, corners told {told:.2f}")


def flown(model: Model, start: Start, noise: int, most: int) -> tuple[Floats, Floats]:
    """Events in 16 x 16 fields, (n, 16, 16), and lean, (n,), of the moments of a flight."""
    env, pilot = DroneEnv(model.scenario), model.frozen()
    info = begin(env, start, noise)
    pilot.begin()
    counts, leans, over = [], [], False
    while not over and len(leans) < most:
        events = info["events"]
        counts.append(np.histogram2d(events.y, events.x, bins=16, range=((0, 128), (0, 128)))[0])
        leans.append(info["error"][1])
        _, _, lost, end, info = env.step(pilot.act(info["counts"], info))
        over = lost or end
    env.close()
    return np.array(counts), np.array(leans)


def inputs(counts: Floats, fields: int, keep: float) -> Floats:
    """Shares of each row of fields, of a sum of events that keeps so much from step to step, (n, fields^2)."""
    n = 16 // fields
    coarse = counts.reshape(len(counts), fields, n, fields, n).sum((2, 4))
    for k in range(1, len(coarse)):
        coarse[k] += keep * coarse[k - 1]
    rows = coarse.sum(2, keepdims=True)
    shares: Floats = (coarse / np.where(rows > 0, rows, 1) / fields).reshape(len(coarse), -1)
    return shares


def fitted(flights: list[tuple[Floats, Floats]], fields: int, keep: float, only_sides: bool) -> tuple[Any, Any]:
    """Mean error on the sides, degrees, and the share of a corner's lean that is told, on what was not fitted to."""
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


if __name__ == "__main__":
    main()
