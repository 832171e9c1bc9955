"""The microcircuit by the recipe of its benchmark: a folder to submit for the public table of simulators.

    python benchmarks/pd14.py FOLDER [--scale 1] [--ms 900000] [--seeds 10] [--reference 10] [--threads 1 2]

Recipe: INM-6/microcircuit-PD14-model, docs/benchmarking (Senk et al., Neuromorph. Comput. Eng. 6:012001, 2026). V_m
starts optimised, and the first 500 ms are left out. Speed is measured over 10 s or more without reads of the network.
Accuracy is measured over 15 min and ten seeds, by the distributions of `pd14_statistics.py` beside a reference. The
reference is NEST with its own connection rules. It is run here, because the data of the authors are not in their
repository. Input is Poisson.

FOLDER gets `spikes/` (HDF5), `statistics/` (JSON in the format of the reference's scripts) and `speed.json`. README.md
(tables), `row.yaml` and `distributions.png` are made from these. Each step is a process, and no finished step is
repeated. An interrupted run of ours continues after its last minute of biological time, other runs start again.

At full scale ours needs 4 GB and NEST 15 GB. `--reference 0` omits NEST, and `--scale 0.2` is small for both.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numba
import numpy as np
from kept import kept, markdown
from microcircuit import events, peak_gb, recorded
from pd14_statistics import MEASURES, Distributions, between, distributions, mean, within
from spike_statistics import Figure, Recording, Train

import neuro
import neuro_models
from neuro import ModelError
from neuro.core.hdf5 import put, reading, take, writing
from neuro.core.outputs import Kind, make_folder, write_text
from neuro.core.pictures import write_picture

NEST = version("nest-simulator") if find_spec("nest") else "not installed"
SPIKES = "neuro benchmark spikes 1"
TEXT = Kind("a text of this benchmark")
WARM_MS = 500.0
STRETCH_MS = 60_000.0
"""Length of a stretch, ms. An interrupted run of ours continues from the end of a stretch."""
PUBLISHED = {
    "L23E": 0.903,
    "L23I": 2.965,
    "L4E": 4.414,
    "L4I": 5.876,
    "L5E": 7.569,
    "L5I": 8.633,
    "L6E": 1.105,
    "L6I": 7.829,
}
"""Mean rates of the whole circuit in Hz, from the repository of the benchmark."""
DIGITS = {"rates": 3, "spike_cvs": 3, "spike_ccs": 5}


def told(text: str) -> None:
    """Print a line of progress with the time of day."""
    print(time.strftime("%H:%M:%S"), text, file=sys.stderr, flush=True)


def circuit(scale: float) -> neuro.Network:
    """Return the network of the recipe, with `scale` of the neurons and of the inputs of each neuron."""
    return neuro.load(neuro_models.path("microcircuit"), params={"scale": scale, "settled": 1.0})


# spikes of a seed


def stretches(ms: float) -> list[tuple[float, float]]:
    """Return begin and end of each stretch of a run, ms."""
    edges = [WARM_MS + at for at in np.arange(0.0, ms, STRETCH_MS)] + [WARM_MS + ms]
    return list(pairwise(edges))


def run_ours(path: Path, seed: int, settings: dict[str, Any]) -> None:
    """Write the spikes of a seed. The state after each stretch is stored beside them until the run ends."""
    sim = neuro.compile(circuit(settings["scale"]), seed=seed, threads=max(settings["threads"]))
    state = path.with_suffix(".state")
    if state.exists():
        sim.restore(state)
    else:
        sim.run(WARM_MS)
    every = stretches(settings["ms"])
    parts = [path.with_name(f"{path.stem}.{number}") for number in range(len(every))]
    for number, (begin, end) in enumerate(every):
        if sim.time >= end:
            continue
        sim.forget(begin)
        advance(sim.run, begin, end, f"{path.stem}, of {settings['ms']:,.0f} ms")
        save(parts[number], recorded(sim, begin))
        if number + 1 < len(every):
            sim.save(state)
    save(path, joined([loaded(part) for part in parts]))
    for file in (state, *parts):
        file.unlink(missing_ok=True)


def run_nest(path: Path, seed: int, settings: dict[str, Any]) -> None:
    """Write the spikes of a seed in NEST, which draws its own network."""
    import nest
    from microcircuit_nest import connect, populations

    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.set(resolution=0.1, local_num_threads=max(settings["threads"]), rng_seed=seed)
    net = circuit(settings["scale"])
    cells, sources = populations(net)
    connect(net, cells, sources)
    recorders = {name: nest.Create("spike_recorder", params={"start": WARM_MS}) for name in cells}
    for name, nodes in cells.items():
        nest.Connect(nodes, recorders[name])
    nest.Simulate(WARM_MS)
    advance(nest.Simulate, WARM_MS, WARM_MS + settings["ms"], f"{path.stem}, of {settings['ms']:,.0f} ms")
    trains = {}
    for name, nodes in cells.items():
        found = recorders[name].events
        trains[name] = Train(len(nodes), found["times"], found["senders"] - nodes[0].global_id)
    save(path, Recording(WARM_MS, WARM_MS + settings["ms"], trains))


def advance(run: Callable[[float], None], begin: float, end: float, what: str) -> None:
    """Run from `begin` to `end` in ms, and report each second."""
    for at in np.arange(begin, end, 1000.0).tolist():
        upto = min(at + 1000.0, end)
        run(upto - at)
        told(f"{what}: {upto - WARM_MS:,.0f}")


def save(path: Path, recording: Recording) -> None:
    """Write spikes as HDF5: for each population `size`, `times` in ms, and `neurons` counted from 0."""
    with writing(path, SPIKES, replace=True) as file:
        put(file, "window_ms", np.array([recording.begin, recording.end]))
        for name, train in recording.trains.items():
            words = {"size": np.array(train.size), "times": train.times, "neurons": train.neurons.astype(np.int32)}
            put(file, name, words)


def loaded(path: Path) -> Recording:
    """Read a recording from the file of `save`."""
    with reading(path, SPIKES) as file:
        begin, end = take(file, "window_ms")
        found = {name: take(file, name) for name in file if name != "window_ms"}
    trains = {name: Train(int(of["size"]), of["times"], of["neurons"].astype(np.int64)) for name, of in found.items()}
    return Recording(float(begin), float(end), trains)


def joined(parts: list[Recording]) -> Recording:
    """Return the spikes of successive stretches as one recording."""
    if len(parts) == 1:
        return parts[0]
    trains = {
        name: Train(
            train.size,
            np.concatenate([part.trains[name].times for part in parts]),
            np.concatenate([part.trains[name].neurons for part in parts]),
        )
        for name, train in parts[0].trains.items()
    }
    return Recording(parts[0].begin, parts[-1].end, trains)


# speed


def speed(threads: int, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the time in s of each biological second. Spikes stay in memory, and are dropped after each second."""
    wall = time.perf_counter()
    sim = neuro.compile(circuit(settings["scale"]), seed=1, threads=threads)
    sim.run(0.1)
    built = time.perf_counter() - wall
    sim.run(WARM_MS - 0.1)
    before, seconds = events(sim), []
    for _ in range(round(settings["speed_ms"] / 1e3)):
        sim.forget(sim.time)
        wall = time.perf_counter()
        sim.run(1000.0)
        seconds.append(time.perf_counter() - wall)
        told(f"speed, {threads} threads: {len(seconds)} s took {sum(seconds):.1f} s")
    count = (events(sim) - before) / len(seconds)
    return {"threads": threads, "build_s": built, "seconds": seconds, "events_per_s": count, "peak_gb": peak_gb()}


# the folder


def steps(folder: Path, settings: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    """Yield names and files of all steps, in order."""
    for threads in settings["threads"]:
        yield f"speed {threads}", folder / f"speed_{threads}.json"
    for who, number in (("neuro", settings["seeds"]), ("nest", settings["reference"])):
        for seed in range(1, number + 1):
            yield f"{who} {seed}", folder / "spikes" / f"{who}_seed{seed}.h5"


def step(name: str, path: Path, settings: dict[str, Any]) -> None:
    """Run one of `steps`."""
    who, number = name.split()
    if who == "speed":
        kept(path, lambda: speed(int(number), settings))
    elif who == "neuro":
        run_ours(path, int(number), settings)
    else:
        run_nest(path, int(number), settings)


def statistics(folder: Path, who: str) -> list[Distributions]:
    """Return the distributions of all seeds of a simulator.

    They are computed once and stored with the names and in the format of the reference's scripts.
    """
    every = []
    for path in sorted((folder / "spikes").glob(f"{who}_seed*.h5")):
        place = folder / "statistics" / path.stem
        if not all((place / f"{measure}.json").exists() for measure in MEASURES):
            told(f"statistics of {path.stem}")
            make_folder(place)
            for measure, found in distributions(loaded(path)).items():
                listed = {name: values.tolist() for name, values in found.items()}
                kept(place / f"{measure}.json", lambda listed=listed: listed)  # type: ignore[misc]
        words = {measure: json.loads((place / f"{measure}.json").read_text()) for measure in MEASURES}
        every.append({m: {name: np.array(values) for name, values in of.items()} for m, of in words.items()})
    return every


def cell(figure: Figure, digits: int) -> str:
    """Return a figure and its error as text."""
    if np.isnan(figure.value):
        return "-"
    return f"{figure.value:.{digits}f}" + ("" if np.isnan(figure.error) else f" ± {figure.error:.{digits}f}")


def compared(ours: list[Distributions], theirs: list[Distributions], measure: str) -> str:
    """Return the table of a measure."""
    published = measure == "rates"
    rows = []
    for name in PUBLISHED:
        means = [cell(mean(every, measure, name), DIGITS[measure]) for every in (theirs, ours)]
        apart = [within(theirs, measure, name), within(ours, measure, name), between(theirs, ours, measure, name)]
        row = [name, *([PUBLISHED[name]] if published else []), *means, *(cell(figure, 3) for figure in apart)]
        rows.append(row)
    heads = ["population", *(["published"] if published else []), "NEST", "neuro"]
    return markdown([*heads, "distance within NEST", "within neuro", "between both"], rows)


def machine() -> dict[str, str]:
    """Return processor, memory and versions of this machine by name."""
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    model = names[0].partition(":")[2].strip() if names else platform.processor()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    versions = {"neuro": neuro.__version__, "python": platform.python_version(), "numpy": np.__version__}
    system = {
        "processor": f"{model}, {os.cpu_count()} cores",
        "memory": f"{memory:.0f} GB",
        "system": platform.platform(),
    }
    return system | versions | {"numba": numba.__version__, "NEST": NEST}


def row(fastest: dict[str, Any], settings: dict[str, Any], about: dict[str, str]) -> str:
    """Return the entry for the file of data points of the public table."""
    factor, watts = float(np.mean(fastest["seconds"])), settings["watts"]
    joules = "" if watts is None else f"{watts * factor / fastest['events_per_s'] * 1e6:.4f}"
    energy = "energy not measured" if watts is None else f"energy from {watts:g} W at the power outlet"
    words = {
        "authoryear": "",
        "year": time.strftime("%Y"),
        "simulator": f"neuro {about['neuro']}",
        "num_nodes": 1,
        "system": about["processor"],
        "process_node_nm": "",
        "rtf": f"{factor:.3f}",
        "esyn_muJ": joules,
        "drive": "Poisson",
        "comment": f"threads {fastest['threads']}, scale {settings['scale']:g}; {energy}",
    }
    return "- neuro:\n" + "".join(f"  - {word}: {value}".rstrip() + "\n" for word, value in words.items())


def bundle(folder: Path, settings: dict[str, Any]) -> None:
    """Write README.md, row.yaml and distributions.png from the results so far."""
    ours, theirs = statistics(folder, "neuro"), statistics(folder, "nest")
    speeds = [json.loads(path.read_text()) for path in sorted(folder.glob("speed_*.json"))]
    about = machine()
    fastest = min(speeds, key=lambda each: float(np.mean(each["seconds"])))
    entry = row(fastest, settings, about)
    lines = [
        "# The cortical microcircuit by the recipe of its benchmark",
        f"Scale {settings['scale']:g}. Input: Poisson. V_m: optimised start. Left out: {WARM_MS:g} ms. Accuracy: "
        f"{settings['ms'] / 1e3:g} s; seeds: {len(ours)} of neuro, {len(theirs)} of NEST"
        f"{' (the recipe: 900 s, 10 seeds)' if settings['ms'] < 9e5 or min(len(ours), len(theirs)) < 10 else ''}. "
        f"Speed: {settings['speed_ms'] / 1e3:g} s.",
        "## Machine and versions",
        markdown(["what", "found"], about.items()),
        "## Speed",
        markdown(
            ["threads", "real-time factor", "least and largest of a second", "events/s", "build, s", "memory, GB"],
            [
                [
                    each["threads"],
                    f"{np.mean(each['seconds']):.2f}",
                    f"{min(each['seconds']):.2f} to {max(each['seconds']):.2f}",
                    f"{each['events_per_s']:.3g}",
                    f"{each['build_s']:.1f}",
                    f"{each['peak_gb']:.2f}",
                ]
                for each in speeds
            ],
        ),
        "## Row of the table",
        f"```yaml\n{entry}```",
        "## Accuracy",
        "Means over neurons or pairs, with standard errors over seeds; distances are the statistic of Kolmogorov and "
        "Smirnov, with standard deviations over pairs of networks. Both simulators draw networks of their own, so a "
        "distance between them is to be as large as one within NEST.",
        *(f"### {MEASURES[m][0].upper()}{MEASURES[m][1:]}\n{compared(ours, theirs, m)}" for m in MEASURES),
        "![Distributions](distributions.png)",
    ]
    write_text(folder / "row.yaml", entry, TEXT, replace=True)
    picture(folder / "distributions.png", ours, theirs)
    write_text(folder / "README.md", "\n\n".join(lines) + "\n", TEXT, replace=True)
    told(f"{folder / 'README.md'} is written")


def picture(path: Path, ours: list[Distributions], theirs: list[Distributions]) -> None:
    """Draw histograms of all seeds, with those of NEST in grey."""
    edges = {"rates": np.arange(0.0, 20.1, 1.0), "spike_cvs": np.arange(0.5, 1.51, 0.05)}
    edges["spike_ccs"] = np.arange(-0.015, 0.0151, 0.001)
    figure, axes = plt.subplots(len(PUBLISHED), 3, figsize=(9, 11), sharex="col", layout="constrained")
    for (line, name), (column, measure) in ((a, b) for a in enumerate(PUBLISHED) for b in enumerate(MEASURES)):
        axis = axes[line, column]
        for networks, colour, width in ((theirs, "#999999", 2.0), (ours, "#0072B2", 0.8)):
            for network in networks:
                shares = np.histogram(network[measure][name], edges[measure])[0] / max(network[measure][name].size, 1)
                axis.stairs(shares, edges[measure], color=colour, lw=width)
        axis.set(yticks=[], xlabel=MEASURES[measure] if name == "L6I" else "")
        if column == 0:
            axis.set_ylabel(name)
    write_picture(path, figure)
    plt.close(figure)


def main() -> None:
    """Run the missing steps, then write the page of the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--ms", type=float, default=900_000.0, help="of a seed, after 500 ms")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--reference", type=int, default=10, help="seeds of NEST")
    parser.add_argument("--threads", type=int, nargs="+", default=[1])
    parser.add_argument("--speed-ms", type=float, default=10_000.0)
    parser.add_argument("--watts", type=float, help="mean power at the outlet while speed is measured")
    parser.add_argument("--only", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    settings = {word: value for word, value in vars(asked).items() if word not in ("folder", "only")}
    make_folder(asked.folder / "spikes")
    before = kept(asked.folder / "settings.json", lambda: settings)
    if changed := [word for word in ("scale", "ms") if before[word] != settings[word]]:
        parser.error(f"{asked.folder} has {changed[0]} = {before[changed[0]]:g}: expected the same, or another folder")
    every = list(steps(asked.folder, settings))
    if asked.only:
        step(asked.only, dict(every)[asked.only], settings)
        return
    for number, (name, path) in enumerate(every, 1):
        if not path.exists():
            told(f"{number} of {len(every)}: {name}")
            subprocess.run([sys.executable, *sys.argv, "--only", name], check=True)
    bundle(asked.folder, settings)


if __name__ == "__main__":
    try:
        main()
    except (ModelError, subprocess.CalledProcessError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit("interrupted: run the same command again to resume")
