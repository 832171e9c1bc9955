"""Time an emulated chip: `python benchmarks/run_chip.py ff|rec [--steps N] [--backend loihi]` -> one JSON line."""

from __future__ import annotations

import argparse
import json
import time

from chip_networks import feedforward, recurrent, sources

import neuro


def main() -> None:
    """Print the line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("net", choices=("ff", "rec"))
    options.add_argument("--steps", type=int, default=0)
    asked = options.parse_args()
    print(json.dumps(timed(asked.net, asked.steps)))


def timed(name: str, steps: int = 0) -> dict[str, object]:
    """Steps per second after a warm-up of 50 steps, counting included: of the processor's time and of the clock's."""
    steps = steps or (20_000 if name == "ff" else 3_000)
    net = feedforward() if name == "ff" else recurrent()
    began = time.perf_counter()
    sim = neuro.compile(net, backend="loihi")
    setup = time.perf_counter() - began
    if name == "ff":
        sim.inject("sources", *sources(1000, steps + 50))
    sim.run(50.0)
    clock, began = time.perf_counter(), time.process_time()
    sim.run(float(steps))
    seconds, clock = time.process_time() - began, time.perf_counter() - clock
    counts = sim.counts()
    return {
        "tool": "neuro loihi",
        "net": name,
        "steps": steps,
        "steps_per_s": round(steps / seconds, 1),
        "clock_steps_per_s": round(steps / clock, 1),
        "spikes_per_step": round(counts.spikes / counts.steps, 1),
        "setup_s": round(setup, 3),
    }


if __name__ == "__main__":
    main()
