"""Place, check and price the cortical microcircuit on chips: processor time, peak memory, cores, chips and hops.

    python benchmarks/chips_at_scale.py --scale 0.1 [--emulate 100]

Scale 1 has 299 million synapses and needs 10 GB. `--emulate MS` also runs the network on the emulator of SpiNNaker and
on event, and prints the rates of both. This needs 16 GB.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
import warnings
from pathlib import Path

import neuro
from neuro.chips import chip, place
from neuro.chips.quantising import refusals
from neuro.compiler import compile_network

CIRCUIT = Path(__file__).resolve().parents[1] / "models" / "neuro_models" / "microcircuit.yaml"


class Watch:
    """Prints the name of each finished part, its processor time and the peak of memory so far."""

    def __init__(self) -> None:
        self.since = time.process_time()

    def say(self, what: str) -> None:
        """Print the line of a finished part, and start the time of the next part."""
        now = time.process_time()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"{what:60} {now - self.since:8.2f} s {peak:6.2f} GB", flush=True)
        self.since = now


def fit(net: neuro.Network) -> None:
    """Compile the network once, then place it on both chips."""
    watch = Watch()
    program = compile_network(net, 1)
    watch.say(f"compiled: {sum(part.size for part in program.projections):,} synapses")
    for name, per_core in (("spinnaker", None), ("spinnaker", 80), ("loihi", None)):
        target = chip(name)
        placed = place(program, target, neurons_per_core=per_core)
        used = f"{len(placed.cores):,} cores on {placed.chips_used:,} chips, {placed.total_hops:,} hops"
        watch.say(f"{name}{f', {per_core} neurons a core' if per_core else ''}: {used}")
        for problem in placed.problems:
            print(f"  {problem.what}: {problem.why}")
        del placed
        if per_core is None:
            found = refusals(program, target)
            watch.say(f"{name}: {len(found)} refusals by its arithmetic")
            for problem in found:
                print(f"  {problem.what}: {problem.why}")


def emulate(net: neuro.Network, ms: float) -> None:
    """Run the network on both backends, and print the rates of each population after the first 20 ms."""
    for backend in ("event", "spinnaker"):
        watch = Watch()
        with warnings.catch_warnings(action="ignore"):
            sim = neuro.compile(net, backend=backend, seed=1)
        watch.say(f"{backend}: built")
        sim.run(20.0)
        before = sim.counts()
        sim.run(ms - 20.0)
        watch.say(f"{backend}: {ms:g} ms")
        after = sim.counts()
        seconds = (ms - 20.0) / 1000.0
        for part in sim.program.populations:
            if part.kind == "neuron":
                spikes = after.populations[part.name].spikes - before.populations[part.name].spikes
                print(f"  {part.name:6} {spikes / part.size / seconds:6.2f} Hz")
        print(f"  {dict(after.native) or 'nothing saturates'}")
        del sim


def main() -> int:
    """Run the parts that the options name."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--scale", type=float, default=0.1)
    options.add_argument("--emulate", type=float, default=0.0, metavar="MS")
    options.add_argument("--network", type=Path, default=CIRCUIT)
    asked = options.parse_args()
    net = neuro.load(asked.network, params={"scale": asked.scale})
    fit(net)
    if asked.emulate:
        emulate(net, asked.emulate)
    return 0


if __name__ == "__main__":
    sys.exit(main())
