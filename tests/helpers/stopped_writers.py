"""Writers of files that are killed, and writers without room: the files that they replace stay complete.

`python tests/helpers/stopped_writers.py 1000 0` stops writers 1,000 times with seed 0 and prints a table; more words
choose writers by name. An attempt is a fork of a process that has imported all modules and called each writer once. It
writes in the place of complete files and is stopped in one of four ways: SIGKILL or SIGTERM, half of them at a drawn
time, half right before a drawn file is opened for writing, renamed or removed; a drawn limit of the size of files; or a
drawn number of free bytes on a disk (as root). Afterwards

- each file is the old or the new one, all are new if the process succeeded, and files that belong together are old if
  it reported an error;
- a kept part can be read by its reader and begins as the whole does;
- the process has ended by no other signal and without a traceback; a lack of room is reported once, with status 2;
- nothing else is left, except hidden parts of a process that was killed, which the next writer removes.
"""

import contextlib
import ctypes
import functools
import gc
import io
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import neuro
from neuro import events

WAYS = ("kill", "term", "size", "full")
SIGNALS = {"kill": signal.SIGKILL, "term": signal.SIGTERM}
WRITES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate")
HIDDEN = re.compile(r"\..*\.part", re.DOTALL)
SEPARATE = ("plot", "split")
"""Writers of files that do not belong together."""
HANGS_S = 120
"""Seconds after which a writer hangs, on a machine with much else to do."""


def network(seed):
    """A network whose arrays differ with the seed; too large for its YAML."""
    net = neuro.Network("n", resolution=1.0)
    thresholds = np.random.default_rng(seed).uniform(5.0, 9.0, 200)
    net.population("a", 200, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=thresholds))
    net.population("noise", 20, neuro.poisson_generator(rate=900.0))
    net.connect("noise", "a", neuro.fixed_indegree(3), weight=3.0, name="na")
    net.probe("v", "a", "V_m", every=1.0)
    return net


@functools.cache
def recording(seed):
    """Events that differ with the seed."""
    draw, n = np.random.default_rng(seed), 5_000
    x, y, p = draw.integers(0, (34, 34, 2), (n, 3)).T
    return events.Events(np.sort(draw.integers(0, 10**6, n)), x, y, p, (34, 34))


def state(path, seed):
    """Write a state of a simulation."""
    sim = neuro.compile(network(0), "reference", seed=seed)
    sim.run(2.0)
    sim.save(path)


def live(path, seed):
    """Record a run in another process, as `neuro live` does, with a commit after each of its parts."""
    sim = neuro.compile(network(seed), "reference", seed=0)
    with sim.record_to(path, live=True) as writer:
        for _ in range(4):
            sim.run(2.0)
            writer.commit()


def checkpoint(path, seed):
    """Write a checkpoint, as trainings of all apps do."""
    from neuro.files.state import Checkpoint

    kept = Checkpoint(path.with_suffix(""), "neuro test checkpoint 1", {})
    kept.keep(a=np.random.default_rng(seed).random(50_000), b={str(k): np.arange(k) for k in range(40)})


def agent(path, seed):
    """Write an agent, and then where it was trained, as `neuro agent` does."""
    from gymnasium.spaces import Box, Discrete

    import neuro_agent
    from neuro_agent.environments import remember

    spaces = Box(-1.0, 1.0, (4,)), Discrete(2)
    neuro_agent.ActorCritic(*spaces, critics=5, explore=20, seed=seed).save(path)
    remember(path, "World-v0")


@functools.cache
def drone(seed):
    """A trained controller."""
    from neuro_drone.train import train

    return train("B60", "lms", steps=50, seed=seed)


@functools.cache
def recogniser(seed):
    """A trained recogniser."""
    from neuro.events.dataset import recordings
    from neuro_recognise import fit

    return fit(recordings(f"{seed}/set"), "boe", seed=seed)


def c(path, seed):
    """Write a network as C."""
    from random_c import random_network

    with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):
        neuro.save_c(random_network(seed, "loihi"), path.parent, chip="loihi", name="net", duration=10.0)


def picture(path, seed):
    """Write a picture."""
    from matplotlib.figure import Figure

    from neuro.core.pictures import write_picture

    figure = Figure()
    figure.subplots().plot(np.random.default_rng(seed).random(200))
    write_picture(path, figure)


def listen(format, path, seed):
    """Write events that cannot be had again, as `neuro events listen` does."""
    whole = recording(seed)
    parts = (whole[k : k + 500] for k in range(0, len(whole), 500))
    events.save(parts, path, format=format, replace=True, keep=True)


def command(*words):
    """A command line; {seed} is 0 or 1, {out} the file, {folder} where it lies."""

    def call(path, seed):
        sys.argv = ["neuro", *(word.format(seed=seed, out=path, folder=path.parent) for word in words)]
        from neuro.cli import main

        main()

    return call


def doctor(path, seed):
    """Write the page of a network; status 1 says that the network has a fault."""
    try:
        command("doctor", "{seed}/s.yaml", "--html", "{out}")(path, seed)
    except SystemExit as end:
        if end.code != 1:
            raise


def results(path):
    """Read a file of results to its end."""
    run = neuro.results.read(path)
    arrays = [*run.spikes("a"), *run.trace("v")]
    return run.finished, run.time, [array.tolist() for array in arrays]


def part_of_results(path, seed):
    """Read what a run has kept: it begins as the whole; up to the first commit nothing is promised."""
    from neuro.core.hdf5 import Front

    if not getattr(Front.of(path.read_bytes()[:512]), "size", 0):
        return
    kept, whole = neuro.results.read(path), whole_trace(seed)
    times, values = kept.trace("v")
    assert np.array_equal(values, whole[: len(values)]), "the trace is not the beginning of the whole"
    assert len(times) == len(values) == kept.time, f"{len(values)} values up to {kept.time} ms"


@functools.cache
def whole_trace(seed):
    """The probe of a run of 10 ms."""
    sim = neuro.compile(network(seed), "reference", seed=0)
    sim.run(10.0)
    return sim.trace("v")[1]


def part_of_events(format):
    """What reads the part that a listener has kept."""

    def read(path, seed):
        if not path.stat().st_size:  # killed before the first part
            return
        kept = events.load(path, format=format, sensor_size=(34, 34)).records()
        assert len(kept) % 500 == 0, f"{len(kept)} events: a part is not whole"
        assert np.array_equal(kept, recording(seed).records()[: len(kept)]), "the events are others"

    return read


def hdf5_content(path):
    """All arrays of a file of ours, after its digest was checked."""
    import h5py

    from neuro.core.hdf5 import check

    arrays = {}

    def add(name, item):
        if isinstance(item, h5py.Dataset):
            arrays[name] = repr(item[()].tolist())

    check(path)
    with h5py.File(path) as file:
        file.visititems(add)
    return arrays


def sealed(module):
    """What reads a page that has the time in it: its digest fits."""

    def read(path):
        from importlib import import_module

        return import_module(module).PAGE.ours(path)

    return read


def writers():
    """By name: the ending of the file, what writes it, and what reads it and its kept part, where it is not bytes."""
    run = ("run", "{seed}/net.yaml", "--for", "10", "--backend", "reference", "--out", "{out}")
    compare = ("compare", "{seed}/net.yaml", "--backends", "reference,event", "--for", "5")
    table = {
        "run": (".h5", command(*run), results, part_of_results),
        "live": (".h5", live, results, part_of_results),
        "report": (".html", command("report", "{seed}/run.h5", "--out", "{out}"), sealed("neuro.pages.report")),
        "plot": (".png", command("plot", "{seed}/run.h5", "--out", "{folder}")),
        "compare": (".html", command(*compare, "--html", "{out}"), sealed("neuro.compare.report")),
        "doctor": (".html", doctor, sealed("neuro_doctor.diagnosis")),
        "sweep table": (".csv", command("sweep", "table", "{seed}/sweep", "--out", "{out}")),
        "sweep page": (".html", command("sweep", "page", "{seed}/sweep", "--out", "{out}")),
        "sonata": (".json", command("convert", "{seed}/net.yaml", "{out}")),
        "pynn": (".py", command("convert", "{seed}/lif.yaml", "{out}")),
        "c": (".c", c),
        "save": (".yaml", lambda path, seed: network(seed).save(path)),
        "state": (".h5", state, hdf5_content),
        "checkpoint": (".training", checkpoint),
        "agent": (".h5", agent, hdf5_content),
        "drone": (".h5", lambda path, seed: drone(seed).save(path), hdf5_content),
        "recogniser": (".h5", lambda path, seed: recogniser(seed).save(path), hdf5_content),
        "picture": (".png", picture),
        "filter": (".npz", command("events", "filter", "{seed}/rec.npz", "{out}", "crop: {{x: [0, 30]}}", "--force")),
        "split": (
            ".npz",
            command("events", "split", "{seed}/rec.npz", "--out", "{folder}", "--every", "500", "--force"),
        ),
        "tohdf5": (
            ".h5",
            command("events", "tohdf5", "-f", "{seed}/set", "-o", "{folder}/new{seed}.h5", "--workers", "1"),
            hdf5_content,
        ),
        "frames": (".npz", command("events", "frames", "{seed}/rec.npz", "{out}", "--force")),
        "gif": (".gif", command("events", "gif", "{seed}/rec.npz", "{out}", "--force")),
        "view": (
            ".html",
            command("events", "view", "{seed}/rec.npz", "--out", "{out}"),
            sealed("neuro.events.pictures"),
        ),
    }
    if find_spec("nir"):
        table["nir"] = (".nir", command("convert", "{seed}/lif.yaml", "{out}"))
    for format in events.formats.FORMATS.values():
        if format.write:
            ending = format.suffixes[0]
            convert = command("events", "convert", "{seed}/rec.npz", "{out}", "--force")
            table[f"convert {ending}"] = (ending, convert)
            kept = part_of_events(format.name if format.grows else "csv")
            write = functools.partial(listen, format.name)
            table[f"listen {format.name}"] = (ending, write, Path.read_bytes, kept)
    return {name: (*row, Path.read_bytes)[:3] + tuple(row[3:]) for name, row in table.items()}


def prepare(folder, sweeps=True):
    """Write the inputs of the commands into the present folder."""
    for seed in (0, 1):
        place = folder / str(seed)
        for k in range(4):
            file = place / "set" / "ab"[k % 2] / f"{k}.bin"
            file.parent.mkdir(parents=True, exist_ok=True)
            events.save(recording(seed + k)[:400], file)
        events.save(recording(seed), place / "rec.npz")
        network(seed).save(place / "net.yaml")
        neuro.compile(network(seed), "reference").run(10.0, out=place / "run.h5")
        net = neuro.Network("l", resolution=1.0)
        net.population("in", 40, neuro.spike_generator())
        net.population("l", 40, neuro.iaf_psc_delta(tau_m=20.0, C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=15.0))
        weight = np.random.default_rng(seed).random(1600)
        net.connect("in", "l", neuro.all_to_all(), weight=weight, delay=1.0, name="il")
        net.save(place / "lif.yaml")
        if sweeps:
            sweep(place, seed)


def sweep(folder, seed):
    """A sweep of two runs."""
    from neuro_sweeps.definition import load_runs
    from neuro_sweeps.execute import execute
    from neuro_sweeps.executors import Executor
    from neuro_sweeps.folder import SWEEP, Folder

    text = "parameters: {w: [1.0, 2.0]}\nnetwork: s.yaml\nfor: 5 ms\nbackend: reference\n"
    (folder / "sweep.yaml").write_text(f"{text}seeds: [{seed}]\n")
    (folder / "s.yaml").write_text(
        "neuro: 1\nparameters: {w: 300.0}\npopulations:\n"
        "  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}\n  a: {model: iaf_psc_exp, shape: 10}\n"
        "projections:\n  na: {from: noise, to: a, rule: all_to_all, weight: $w, delay: 1.0}\n"
    )
    execute(load_runs(folder / "sweep.yaml", SWEEP), Folder(folder / "sweep", SWEEP), Executor("here"))


def attempt(call, path, seed, before=lambda: None, after=lambda pid: None):
    """Fork a process that writes; its status and its output. Does not return in that process."""
    with tempfile.TemporaryFile() as log:
        pid = os.fork()
        if not pid:
            os.dup2(log.fileno(), 1), os.dup2(log.fileno(), 2)
            code = 0
            signal.alarm(HANGS_S)
            try:
                before()
                call(path, seed)
            except SystemExit as error:
                code = error.code or 0
            except neuro.ModelError as error:
                print(f"error: {error}", file=sys.stderr)
                code = 2
            except BaseException:
                traceback.print_exc()
                code = 1
            ctypes.pythonapi.Py_Exit(code)  # Python ends as ever, and the blocks that this process has entered do not
        after(pid)
        _, status = os.waitpid(pid, 0)
        log.seek(0)
        return os.waitstatus_to_exitcode(status), log.read().decode("utf-8", "replace")


def at_a_write(number, do):
    """A function after whose call `do` is called before each file, or one, is opened for writing, renamed or removed.

    Args:
        number: of the file, from 1; 0: each.
        do: called before.
    """

    def begin():
        count = 0

        def hook(event, args):
            nonlocal count
            opens = event == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if opens or event in WRITES:
                count += 1
                if number in (0, count):
                    do()

        sys.addaudithook(hook)

    return begin


@contextlib.contextmanager
def small_disk(place, size):
    """A file system of some bytes; None where none can be mounted."""
    place.mkdir()
    options = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if os.geteuid() or subprocess.run(options, capture_output=True, check=False).returncode:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def clear(folder):
    """Empty a folder."""
    for each in folder.iterdir():
        shutil.rmtree(each) if each.is_dir() else each.unlink()


class Writer:
    """A writer, and the files of seed 0 that each attempt finds and of seed 1 that it writes."""

    def __init__(self, name, ending, call, read, read_part=None, *, place):
        self.name, self.call, self.read, self.read_part, self.place = name, call, read, read_part, place
        self.file = f"out{ending}"
        place.mkdir()
        log, code = io.StringIO(), 0
        with contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
            try:
                call(place / self.file, 1)  # here, so that forks find all modules
            except SystemExit as error:
                code = error.code
        assert not code, f"{name}: {log.getvalue()}"
        self.new = self.contents(place)
        assert self.new, f"{name} writes nothing"
        clear(place)
        gc.collect()
        gc.freeze()  # else the end of each fork looks at, and so copies, all that this process has
        began = time.perf_counter()
        with tempfile.TemporaryFile() as calls:
            marks = at_a_write(0, lambda: os.write(calls.fileno(), b"."))
            code, log = attempt(call, place / self.file, 0, marks)
            self.calls = os.fstat(calls.fileno()).st_size
        assert not code, f"{name}: {code}\n{log}"
        self.taken = time.perf_counter() - began
        self.old = self.contents(place)
        self.size = sum(each.stat().st_size for each in place.iterdir())

    def contents(self, folder):
        """By name what the complete files of a folder hold."""
        names = {each.name for each in folder.iterdir() if not each.name.endswith(".part")} - {"filler"}
        return {name: self.read(folder / name) for name in sorted(names) if (folder / name).is_file()}

    def stopped(self, way, draw, disk):
        """Write in the place of the files and be stopped: the fault, "" if nothing is, and whether it was stopped."""
        folder = self.place.with_name("attempt") if way != "full" else disk
        folder.mkdir(exist_ok=True)
        for each in self.place.iterdir():
            shutil.copy(each, folder)
        before, after = lambda: None, lambda pid: None
        if way in SIGNALS and draw.random() < 0.5:
            moment = draw.uniform(0.0, 1.1 * self.taken)

            def after(pid):
                time.sleep(moment)
                os.kill(pid, SIGNALS[way])

        elif way in SIGNALS:
            number = draw.randrange(1, self.calls + 1)
            before = at_a_write(number, lambda: os.kill(os.getpid(), SIGNALS[way]))

        elif way == "size":
            most = draw.randrange(1, int(1.1 * self.size) + 2)

            def before():
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        else:
            room = shutil.disk_usage(folder).free - draw.randrange(0, int(1.2 * self.size) + 4096)
            with (folder / "filler").open("wb") as filler:
                os.posix_fallocate(filler.fileno(), 0, max(1, room))
        try:
            code, log = attempt(self.call, folder / self.file, 1, before, after)
            self.wait_for_parts(folder)
            return self.judged(way, code, log, folder), code != 0
        finally:
            clear(folder)

    def wait_for_parts(self, folder):
        """Wait until the other process of a live run has done what it was sent."""
        import fcntl

        for part in folder.glob(f"{self.file}.part"):
            with part.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX)

    def judged(self, way, code, log, folder):
        """What is wrong."""
        expected = {"kill": (0, -signal.SIGKILL), "term": (0, -signal.SIGTERM, 143)}.get(way, (0, 2))
        if code not in expected or "Traceback" in log:
            return f"status {code}: {log}"
        if code == 2 and sum(line.startswith("error:") for line in log.splitlines()) != 1:
            return f"no single error: {log}"
        if missing := self.old.keys() - {each.name for each in folder.iterdir()}:
            return f"gone: {missing}: {log}"
        try:
            contents = self.contents(folder)
        except Exception as error:
            return f"a file cannot be read: {error}"
        for name, content in contents.items():
            if content == self.new.get(name) or (
                content == self.old.get(name) and (code or way in SIGNALS or name not in self.new)
            ):
                continue
            return f"{name} is neither the one before nor the new one"
        if code == 2 and self.name not in SEPARATE and contents != self.old:
            return "some files are new, others are not"
        left = {each.name for each in folder.iterdir()} - contents.keys() - {"filler"}
        if self.read_part and f"{self.file}.part" in left:
            left.remove(f"{self.file}.part")
            try:
                self.read_part(folder / f"{self.file}.part", 1)
            except Exception as error:
                return f"the part cannot be read: {type(error).__name__}: {error}"
        left = {name for name in left if not name.endswith(".parts")}  # the same call of `tohdf5` goes on with them
        if way in SIGNALS:
            left = {name for name in left if not (HIDDEN.fullmatch(name) and (folder / name).is_file())}
        return f"left behind: {left}" if left else ""


def until_interrupted(count):
    """Numbers up to `count`; Ctrl-C ends them."""
    ended = []
    before = signal.signal(signal.SIGINT, lambda *_: ended.append(True))
    try:
        for k in range(count):
            if ended:
                return
            yield k
    finally:
        signal.signal(signal.SIGINT, before)


def main(count, seed, *names):
    """Stop writers so many times, in turn, and print how often each was stopped in each way."""
    count, seed = int(count), int(seed)
    draw, table, wrong, began = random.Random(seed), Counter(), [], time.perf_counter()
    folder = Path(tempfile.mkdtemp(prefix="neuro-stopped-"))  # TemporaryDirectory would be removed by each fork
    os.chdir(folder)
    try:
        prepare(folder, sweeps=not names)
        rows = {name: row for name, row in writers().items() if not names or name in names}
        every = [Writer(name, *row, place=folder / f"w{k}") for k, (name, row) in enumerate(rows.items())]
        print(f"{len(every)} writers, ready after {time.perf_counter() - began:.0f} s", flush=True)
        with small_disk(folder / "disk", 64 << 20) as disk:
            ways = [way for way in WAYS if way != "full" or disk]
            pairs = [(writer, way) for way in ways for writer in every]
            draw.shuffle(pairs)
            for k in until_interrupted(count):
                writer, way = pairs[k % len(pairs)]
                problem, stopped = writer.stopped(way, draw, disk)
                table[writer.name, way, "stopped" if stopped else "ended"] += 1
                if problem:
                    wrong.append(f"attempt {k}, {writer.name}, {way}: {problem}")
                    print(wrong[-1], flush=True)
                elif k % 100 == 99:
                    print(f"{k + 1} attempts, {time.perf_counter() - began:.0f} s", flush=True)
    finally:
        os.chdir("/")
        shutil.rmtree(folder)
    print(f"{'writer':16}" + "".join(f"{way:>14}" for way in ways) + "   (stopped of attempts)")
    for writer in every:
        cells = [(table[writer.name, way, "stopped"], table[writer.name, way, "ended"]) for way in ways]
        print(f"{writer.name:16}" + "".join(f"{f'{a} of {a + b}':>14}" for a, b in cells))
    stopped = sum(number for (_, _, how), number in table.items() if how == "stopped")
    print(f"{table.total()} attempts, {stopped} stopped, {len(wrong)} wrong")
    print("\n".join(wrong))
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
