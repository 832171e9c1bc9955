"""Files of each kind, damaged at random and read again, in a process of their own, since HDF5 may end it.

    PYTHONPATH=tests/helpers python -m flips FLIPS SEED [KIND ...]

prints a table: kind, damaged files, refused, read unchanged, changed silently, raw errors, crashes (or no end within
`LIMIT_S`).
"""

import hashlib
import signal
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

import neuro
from neuro.apps import Checkpoint, hdf5
from neuro.core import growing
from neuro.events import Dataset, Events, load, save
from neuro.results import read as read_results
from neuro_drone.model import Model as Drone
from neuro_drone.train import train as train_drone
from neuro_recognise import Recogniser, early
from neuro_recognise.observations import FORMAT, KeptAnswers, keep

OUTCOMES = ("refused", "unchanged", "silent", "raw", "crash")
LIMIT_S = 60


def network():
    net = neuro.Network("damaged", resolution=0.5)
    net.population("in", 6, neuro.poisson_generator(rate=np.linspace(100.0, 400.0, 6)))
    cells = net.population("cells", (2, 6), neuro.iaf_psc_exp(I_e=300.0))
    weight = np.random.default_rng(1).uniform(100.0, 300.0, (6, 12))
    net.connect("in", cells, neuro.all_to_all(), neuro.stdp(Wmax=400.0), weight=weight, delay=1.0, name="learning")
    net.probe("V", cells, ["V_m", "I_syn_ex"], every=1.0)
    net.probe("sent", "learning", "weight", at="pre_spikes")
    return net


def events(k=0, n=400):
    rng = np.random.default_rng(k)
    return Events(
        np.sort(rng.integers(0, 30_000, n)), rng.integers(0, 34, n), rng.integers(0, 34, n), rng.integers(0, 2, n),
        (34, 34), {"k": k}
    )  # fmt: skip


def simulated(backend="reference"):
    sim = neuro.compile(network(), backend=backend, seed=3)
    sim.run(30.0)
    return sim


def results(folder):
    simulated().run(20.0, out=folder / "a.h5")
    return [folder / "a.h5"]


def unfinished(folder):
    sim = neuro.compile(network(), backend="reference", seed=3)
    with sim.record_to(folder / "a.h5"):
        for _ in range(3):
            sim.run(10.0)
            sim._records.recording.commit()
        (folder / "b.h5").write_bytes((folder / "a.h5.part").read_bytes())
    return [folder / "b.h5"]


def cut_short(folder):
    """A commit that was cut short when its mark was written: what holds is that one, or without the mark the last."""
    sim = neuro.compile(network(), backend="reference", seed=3)
    write, copies = growing._write, []

    def kept(disk, at, data):
        if bytes(data[:5]) == b"neuro" and not copies:  # the mark
            copies.append((folder / "a.h5.part").read_bytes())
            write(disk, at, data)
            copies.append((folder / "a.h5.part").read_bytes())
        else:
            write(disk, at, data)

    with sim.record_to(folder / "a.h5"):
        sim.run(20.0)
        growing._write = kept
        sim._records.recording.commit()
        growing._write = write
    for name, data in zip(("before.h5", "mark.h5"), copies, strict=True):
        (folder / name).write_bytes(data)
    return [folder / "mark.h5", folder / "before.h5"]


def read_of_results(path):
    found = read_results(path)
    yield from (found.populations, found.projections, found.traces)
    yield from (found.about, found.files)
    assert found.network()


def state(backend):
    def made(folder):
        simulated(backend).save(folder / "a.h5")
        return [folder / "a.h5"]

    return made


def restored(backend):
    sims = []

    def read(path):
        sim = sims[0] if sims else simulated(backend)
        sims[:] = [sim]
        sim.restore(path)
        sim.run(5.0)
        return sim.time, sim.spikes("cells"), sim.weights("learning"), sim.trace("V"), sim.trace("sent")

    return read


def arrays(folder):
    network().save(folder / "net.yaml")
    return [folder / "net.h5"]


def read_of_network(path):
    """The YAML of the network has the name of its arrays."""
    (whole,) = path.parent.glob("*.yaml")
    near = path.parent / path.stem
    near.mkdir(exist_ok=True)
    (near / "net.yaml").write_bytes(whole.read_bytes())
    (near / "net.h5").write_bytes(path.read_bytes())
    net = neuro.load(near / "net.yaml")
    return net == network(), net.projections["learning"].weight.values


def recogniser(name):
    def made(folder):
        for k in range(12):
            path = folder / "data" / "Train" / str(k % 2) / f"{k}.bin"
            path.parent.mkdir(parents=True, exist_ok=True)
            save(events(k), path)
        from neuro.events import recordings
        from neuro_recognise import fit

        fit(recordings(folder / "data", part="Train"), name, out=folder / "a.h5", cache=folder / "cache")
        return [folder / "a.h5"]

    return made


def read_of_recogniser(path):
    made = Recogniser.load(path)
    return made.method.as_words(), made.classes, made.learnt, made.training


def drone(folder):
    train_drone("B60", "lms", steps=120, episode=60).save(folder / "a.h5")
    return [folder / "a.h5"]


def drone_with_network(folder):
    train_drone("B60", "snn", steps=60, episode=60).save(folder / "a.h5")
    return [folder / "a.h5"]


def checkpoint(folder):
    rng = np.random.default_rng(2)
    parts = {"weights": {"a": rng.random((6, 7)), "b": rng.random(40)}, "file": np.arange(99, dtype=np.uint8)}
    Checkpoint(folder / "a", "training 1", {"seed": 3}).keep(**parts)
    return [folder / "a.training"]


def read_of_checkpoint(path):
    path.with_name("b.training").write_bytes(path.read_bytes())
    return Checkpoint(path.with_name("b"), "training 1", {"seed": 3}).resume()


def evidence_of(k=4):
    rng = np.random.default_rng(k)
    return [{"a": rng.random((n, 5)), "b": rng.integers(0, 9, n)} for n in range(1, 1 + k)]


def evidence(folder):
    keep(folder / "a.h5", evidence_of())
    return [folder / "a.h5"]


def read_of_evidence(path):
    if not hdf5.is_whole(path, FORMAT):
        raise neuro.ModelError("made anew")
    return [dict(one) for one in KeptAnswers(path, 4)]


def begun(folder):
    early._write(folder / "a.h5", [[one, one] for one in evidence_of()])
    return [folder / "a.h5"]


def read_of_beginnings(path):
    return [early._read(path, moment) for moment in (0, 1)]


def recording(folder):
    save(events(), folder / "a.h5")
    return [folder / "a.h5"]


def read_of_recording(path):
    found = load(path)
    return found.records(), found.sensor_size, found.metadata


def data_set(folder):
    for k in range(6):
        path = folder / "data" / str(k % 2) / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(events(k), path)
    Dataset(folder / "data").to_hdf5(folder / "a.h5", jobs=1)
    return [folder / "a.h5"]


def read_of_data_set(path):
    found = Dataset(path)
    samples = [(found[k][0].records(), found[k][0].sensor_size, found[k][1]) for k in range(len(found))]
    return found.classes, samples


KINDS = {
    "results": (results, read_of_results), "results, unfinished": (unfinished, read_of_results),
    "results, commit cut short": (cut_short, read_of_results),
    "state, reference": (state("reference"), restored("reference")),
    "state, event": (state("event"), restored("event")), "arrays of a network": (arrays, read_of_network),
    "recogniser, hats": (recogniser("hats"), read_of_recogniser),
    "recogniser, hots": (recogniser("hots"), read_of_recogniser), "drone, lms": (drone, Drone.load),
    "drone, network": (drone_with_network, Drone.load), "checkpoint": (checkpoint, read_of_checkpoint),
    "evidence": (evidence, read_of_evidence), "beginnings": (begun, read_of_beginnings),
    "recording": (recording, read_of_recording), "data set": (data_set, read_of_data_set)
}  # fmt: skip


def digest(value):
    """A hash of all that was read."""
    found = hashlib.blake2b()

    def feed(part):
        if isinstance(part, np.ndarray) and part.dtype.kind != "O":
            found.update(f"{part.dtype.str}{part.shape}".encode() + np.ascontiguousarray(part).tobytes())
        elif is_dataclass(part):
            for field in fields(part):
                found.update(field.name.encode())
                feed(getattr(part, field.name))
        elif hasattr(part, "items"):
            for name, inner in part.items():
                found.update(str(name).encode())
                feed(inner)
        elif isinstance(part, (list, tuple)) or hasattr(part, "__next__"):
            for inner in part:
                feed(inner)
            found.update(b"end")
        else:
            found.update(repr(part).encode())

    feed(value)
    return found.hexdigest()


def damaged(whole, rng):
    """Bits, bytes or stretches changed, exchanged, or the end cut off."""
    data = bytearray(whole)
    at, n = int(rng.integers(len(data))), int(rng.integers(1, 65))
    match int(rng.choice(8, p=[0.4, 0.15, 0.15, 0.06, 0.06, 0.06, 0.06, 0.06])):
        case 0:
            data[at] ^= 1 << rng.integers(8)
        case 1:
            for place in rng.integers(len(data), size=rng.integers(2, 9)):
                data[place] ^= 1 << rng.integers(8)
        case 2:
            data[at] = rng.integers(256)
        case 3:
            data[at : at + n] = rng.bytes(n)[: len(data) - at]
        case 4:
            data[at : at + 512] = bytes(len(data[at : at + 512]))
        case 5:
            del data[at:]
        case 6:
            other = int(rng.integers(len(data)))
            data[at : at + n], data[other : other + n] = data[other : other + n], data[at : at + n]
        case 7:
            del data[at : at + n]
    return bytes(data)


def outcomes(kind, paths, seed, first, last):
    """What comes of each damaged file."""
    read = KINDS[kind][1]
    expected = {digest(read(path)) for path in paths}
    whole, path = paths[0].read_bytes(), paths[0].with_name(f"damaged{paths[0].suffix}")
    for k in range(first, last):
        path.write_bytes(damaged(whole, np.random.default_rng([seed, k])))
        signal.alarm(LIMIT_S)
        try:
            yield "unchanged" if digest(read(path)) in expected else "silent"
        except neuro.ModelError:
            yield "refused"
        except Exception as error:
            yield f"raw {type(error).__name__}: {error}".replace("\n", " ")
        signal.alarm(0)


def tried(kinds, flips, seed, folder):
    """How often each outcome came, by kind, and of each that should not be its number and its message."""
    counts, told = {kind: Counter() for kind in kinds}, []
    jobs = []
    for number, kind in enumerate(kinds):
        place = folder / str(number)
        place.mkdir()
        jobs.append((kind, KINDS[kind][0](place), 0))
    while jobs:
        words = [f"{kind}|{first}|{'|'.join(map(str, paths))}" for kind, paths, first in jobs]
        command = [sys.executable, "-m", "flips", "--of", str(seed), str(flips), *words]
        done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent)
        lines = [line.split("\t") for line in done.stdout.splitlines()]
        per, left = {kind: [outcome for name, outcome in lines if name == kind] for kind, _, _ in jobs}, []
        for kind, paths, first in jobs:
            for k, outcome in enumerate(per[kind]):
                word = outcome.split(" ")[0]
                counts[kind][word] += 1
                if word not in ("refused", "unchanged"):
                    told.append(f"{kind}, {first + k}: {outcome}")
            if first + len(per[kind]) < flips:
                left.append((kind, paths, first + len(per[kind])))
        if left:
            kind, paths, at = left[0]
            if done.returncode > 0:
                raise RuntimeError(done.stderr)
            counts[kind]["crash"] += 1
            told.append(f"{kind}, {at}: ended with {done.returncode}: {done.stderr[-2000:]}")
            left[0] = (kind, paths, at + 1)
        jobs = [job for job in left if job[2] < flips]
    return counts, told


def table(counts):
    rows = [("kind", "damaged", *OUTCOMES)]
    rows += [(kind, sum(found.values()), *(found[word] for word in OUTCOMES)) for kind, found in counts.items()]
    return "\n".join("".join(f"{cell!s:<28}" if k == 0 else f"{cell!s:>10}" for k, cell in enumerate(r)) for r in rows)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    if sys.argv[1] == "--of":
        for job in sys.argv[4:]:
            kind, first, *paths = job.split("|")
            for outcome in outcomes(kind, list(map(Path, paths)), int(sys.argv[2]), int(first), int(sys.argv[3])):
                print(kind, outcome, sep="\t", flush=True)
    else:
        with tempfile.TemporaryDirectory() as folder:
            found, told = tried(sys.argv[3:] or list(KINDS), int(sys.argv[1]), int(sys.argv[2]), Path(folder))
        print(*told, table(found), sep="\n")
