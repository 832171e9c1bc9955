"""The drone's loop without a host: it learns by its own dopamine, and the controls that must fail.

    python benchmarks/drone_loop.py [--steps 60000] [--seeds 0 1 2 3 4] [--starts 5] [--backend event]
        [--only NAME ...] [--curve STEPS] [--json FILE]

The network is `neuro_models/loop.yaml`. After the training its weights are frozen and its babbling neurons are cut off,
and it flies one lap of B60 from each of starts x starts places on varied paths, as `neuro drone test` does. The figure
is the mean distance of the ball from the middle, px. Controls:

- late dopamine: motors and critic hear the dopaminergic neurons 5 s late
- reward elsewhere: the reward neurons see the fields at one side in place of the middle
- no critic: its synapses onto the dopaminergic neurons have weight 0
- frozen: nothing is learnt
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import yaml

import neuro
import neuro_models
from neuro_drone.evaluate import ENDLESS, Flights, FlightTest, fly_lap, grid, reset_arguments
from neuro_drone.scenario import load

Weights = dict[str, Any]
LATE = "computed: {{expression: 'trace(0.01 * rate({snc}), 50.0) - {base}', every: 10.0, delay: 5000.0, scale: {eta}}}"
CONTROLS = ("loop", "late dopamine", "reward elsewhere", "no critic", "frozen")


def network(control: str = "loop", **parameters: float) -> neuro.Network:
    """Return the network of a row of the table.

    Args:
        control: one of `CONTROLS`.
        **parameters: of the file, in place of its own.

    Raises:
        ModelError: the file has no such parameter.
    """
    text = Path(neuro_models.path("loop")).read_text("utf-8")
    if control == "late dopamine":
        baseline = parameters.get("baseline", yaml.safe_load(text)["parameters"]["baseline"])
        for axis in "xy":
            for eta in ("$eta", "$eta_critic"):
                values = f"population: {{population: snc_{axis}, tau: 50.0, baseline: $baseline, scale: {eta}}}"
                assert text.count(values) == 1
                text = text.replace(values, LATE.format(snc=f"snc_{axis}", base=baseline, eta=eta))
    if control == "reward elsewhere":
        fields = {":, 6:9": ":, 0:3", ":, 4:11": ":, 0:7", ":, 2:13": ":, 0:11"}
        fields |= {"6:9, :": "12:15, :", "4:11, :": "8:15, :", "2:13, :": "4:15, :"}
        for middle, side in fields.items():
            assert text.count(f'"{middle}"') == 1
            text = text.replace(f'"{middle}"', f'"{side}"')
    if control == "no critic":
        parameters["expectation"] = 0.0
    if control == "frozen":
        parameters |= {"eta": 0.0, "eta_critic": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "loop.yaml"
        path.write_text(text, "utf-8")
        return neuro.load(path, parameters)


def fly(control: str, weights: Weights, starts: int, **parameters: float) -> FlightTest:
    """Fly with frozen weights, without babbling, one lap from each of starts x starts places."""
    scenario = load("B60")
    places = grid(scenario, starts)
    env = Flights(scenario, (reset_arguments(place, index) for index, place in enumerate(places)))
    learnt = neuro.closed_loop(network(control, **parameters, babble=0.0))
    learnt.pilot.put({"learnt": weights})
    loop = neuro.closed_loop(learnt.network(frozen=True), env, learns=False, block=ENDLESS)
    laps = tuple(fly_lap(loop, env, place) for place in places)
    env.close()
    return FlightTest(laps)


def main() -> None:
    """Train, fly and print a row for each control and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--backend", default="event")
    parser.add_argument("--only", nargs="+", default=["loop"], choices=CONTROLS)
    parser.add_argument("--curve", type=int, default=None)
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE")
    parser.add_argument("--json", type=Path, default=None)
    args = parser.parse_args()
    parameters = {name: float(value) for name, value in (one.split("=") for one in args.set)}
    rows = []
    for control in args.only:
        for seed in args.seeds:
            loop = neuro.closed_loop(network(control, **parameters), seed=seed, backend=args.backend)
            for steps in range(args.curve or args.steps, args.steps + 1, args.curve or args.steps):
                loop.run(steps=steps)
                test = fly(control, loop.pilot.weights, args.starts, **parameters)
                rows.append({"control": control, "seed": seed, "steps": steps, "px": test.error_px, "laps": test.laps})
                figures = f"{test.error_px:.2f} px, {test.laps} of {test.starts} laps"
                print(f"{control}, seed {seed}, {steps:,} steps: {figures}", flush=True)
                if args.json is not None:
                    args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
