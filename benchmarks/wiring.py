"""Time and memory of a synthetic wiring diagram like a fly's brain, with 140,000 neurons and 25 million edges.

The parts are: make and write the edges; load and compile them from each format; run at 17,000 spikes per second. Each
part runs in a process of its own, so its peak of memory is separate.

    python benchmarks/wiring.py                    all
    python benchmarks/wiring.py load edges.parquet --folder FOLDER    one part, in this process
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

NEURONS, EDGES, DRIVEN = 140_000, 25_000_000, 1000
SPIKES = 17_000
"""Spikes per second of the driven neurons. The same number is published for the brain of the fly."""

PARTS = (
    ("make",),
    *(("load", name) for name in ("edges.csv", "edges.parquet", "edges.h5", "edges.npz")),
    ("load", "edges.parquet", "--delays"),
    *(("load", "edges.parquet", "--shuffle", what) for what in ("weights", "signs", "edges")),
    ("run", "edges.parquet"),
)


def ids() -> np.ndarray:
    """Return ids like those of FlyWire, with 64 bits and in no order."""
    rng = np.random.default_rng(1)
    return 720575940600000000 + rng.permutation(50_000_000)[:NEURONS]


def make(folder: Path, neurons: int, edges: int) -> None:
    """Write the tables. As in a fly, a few targets get most edges."""
    import h5py
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    rng = np.random.default_rng(2)
    own = ids()[:neurons]
    transmitters = np.array(["ACH", "GABA", "GLUT"])[rng.choice(3, neurons, p=(0.7, 0.15, 0.15))]
    table = pyarrow.table({"root_id": own, "nt": transmitters, "side": np.array(["left", "right"])[own % 2]})
    pyarrow.csv.write_csv(table, folder / "neurons.csv")
    pre = rng.integers(0, neurons, edges, dtype=np.int32)
    post = (neurons * rng.random(edges) ** 1.5).astype(np.int32)
    synapses = rng.geometric(0.3, edges).astype(np.int32)
    columns = {"pre": own[pre], "post": own[post], "synapses": synapses}
    pyarrow.csv.write_csv(pyarrow.table(columns), folder / "edges.csv")
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / "edges.parquet")
    np.savez(folder / "edges.npz", **columns)
    with h5py.File(folder / "edges.h5", "w") as file:
        group = file.create_group("edges/brain")
        group["source_node_id"], group["target_node_id"] = columns["pre"], columns["post"]
        group["edge_type_id"], group["0/synapses"] = np.zeros(edges, dtype=np.int32), synapses


def load(said: argparse.Namespace) -> None:
    """Describe and compile the network, and run a biological second."""
    import neuro

    begin = time.perf_counter()
    signs = {"ACH": 1, "GABA": -1, "GLUT": -1}
    rule = neuro.from_file(
        said.folder / said.name,
        weight="synapses",
        delay="synapses" if said.delays else None,
        transmitter="nt",
        signs=signs,
        dale=True,
        shuffle=said.shuffle,
    )
    # Shiu et al., Nature 634:210, 2024, with R_m = 1 GOhm, so that a weight in pA equals one of the paper in mV.
    model = neuro.iaf_psc_exp(
        tau_m=20.0, C_m=20.0, tau_syn_ex=5.0, tau_syn_in=5.0, E_L=-52.0, V_reset=-52.0, V_th=-45.0, t_ref=2.2
    )
    net = neuro.Network("fly")
    table = neuro.neuron_table(said.folder / "neurons.csv", id="root_id")
    brain = net.wiring(
        neurons=table,
        edges=rule,
        model=model,
        weight=0.01,
        delay=0.2 if said.delays else 1.8,
        drive=68.75,
        initial={"V_m": -52.0},
    )
    sim = neuro.compile(net, backend="event", seed=1, threads=said.threads)
    taken = time.perf_counter() - begin
    synapses = sim.program.projections[0].size
    what = said.name + " with delays" * said.delays + (f", {said.shuffle} shuffled" if said.shuffle else "")
    print(f"{what}: {synapses:,} synapses loaded and compiled in {taken:.1f} s, {_peak():.2f} GB at the peak")
    if said.part == "run":
        sim.activate(brain[:DRIVEN], SPIKES / DRIVEN)
        sim.run(100.0)
        before, taken = sim.counts(), []
        for _ in range(10):
            begin, cpu = time.perf_counter(), time.process_time()
            sim.run(100.0)
            taken.append((time.perf_counter() - begin, time.process_time() - cpu))
        spikes = sim.counts().populations["brain"].spikes - before.populations["brain"].spikes
        wall, cpu = (sum(each) for each in zip(*taken, strict=True))
        least = 10 * min(wall for wall, _ in taken)
        print(
            f"{what}: {spikes:,} spikes in a biological second in {wall:.2f} s on {said.threads} threads, "
            f"{least:.2f} s at the pace of its fastest 100 ms; {cpu:.2f} s of the processor"
        )


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> None:
    """Run all parts, or the named part."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("part", nargs="?", choices=("make", "load", "run"))
    words.add_argument("name", nargs="?", default="edges.parquet")
    words.add_argument("--folder", type=Path)
    words.add_argument("--neurons", type=int, default=NEURONS)
    words.add_argument("--edges", type=int, default=EDGES)
    words.add_argument("--threads", type=int, default=1)
    words.add_argument("--delays", action="store_true", help="a delay for each edge")
    words.add_argument("--shuffle", choices=("edges", "signs", "weights"))
    said = words.parse_args()
    if said.part == "make":
        make(said.folder, said.neurons, said.edges)
    elif said.part:
        load(said)
    else:
        with tempfile.TemporaryDirectory() as folder:
            size = ["--neurons", str(said.neurons), "--edges", str(said.edges), "--folder", folder]
            for part in PARTS:
                subprocess.run([sys.executable, __file__, *part, *size, "--threads", str(said.threads)], check=True)


if __name__ == "__main__":
    main()
