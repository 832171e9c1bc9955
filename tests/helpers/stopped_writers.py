"""Writers of files that are killed, and writers without room: the file that they replace stays complete.

`python tests/helpers/stopped_writers.py 1000 0` stops writers 1,000 times with seed 0 and prints a table. An attempt is
a fork of a process that has all modules. It writes in the place of a complete file and is stopped in one of four ways:
SIGKILL or SIGTERM at a drawn moment, a drawn limit of the size of files, or a drawn number of free bytes on a disk (as
root). Afterwards the file is the one before or the one that was written, bit for bit where its content has no time.
The process has not ended by another signal, without a traceback, and what has no room says so once, with status 2.
"""

import contextlib
import ctypes
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import neuro
from neuro import events

WAYS = ("kill", "term", "size", "full")


def network(seed):
    """A network whose arrays differ with the seed; too large for its YAML."""
    net = neuro.Network("n", resolution=1.0)
    thresholds = np.random.default_rng(seed).uniform(5.0, 9.0, 200)
    net.population("a", 200, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=thresholds))
    net.population("noise", 20, neuro.poisson_generator(rate=900.0))
    net.connect("noise", "a", neuro.fixed_indegree(3), weight=3.0, name="na")
    net.probe("v", "a", "V_m", every=1.0)
    return net


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


def checkpoint(path, seed):
    """Write a checkpoint, as trainings of all apps do."""
    from neuro.files.state import Checkpoint

    kept = Checkpoint(path.with_suffix(""), "neuro test checkpoint 1", {})
    kept.keep(a=np.random.default_rng(seed).random(50_000), b={str(k): np.arange(k) for k in range(40)})


def model(path, seed):
    """Write a model, and then where it was trained, as `neuro agent` does."""
    from neuro.core.hdf5 import writing
    from neuro_agent.files import FORMAT
    from neuro_agent.worlds import remember

    with writing(path, FORMAT) as file:
        file["w"] = np.random.default_rng(seed).random(50_000)
    remember(path, "World-v0")


def picture(path, seed):
    """Write a picture."""
    from matplotlib.figure import Figure

    from neuro.core.outputs import write_picture

    figure = Figure()
    figure.subplots().plot(np.random.default_rng(seed).random(200))
    write_picture(path, figure)


def command(*words):
    """A command line; {seed} is 0 or 1, {out} the file."""

    def call(path, seed):
        sys.argv = ["neuro", *(word.format(seed=seed, out=path) for word in words)]
        from neuro.cli import main

        main()

    return call


def results(path):
    """Read a file of results to its end."""
    run = neuro.results.read(path)
    return run.finished, run.spikes("a"), run.trace("v")


def sonata(path):
    """Read a network in SONATA, whose files belong together."""
    import h5py

    with h5py.File(path.with_name(f"{path.stem}_nodes.h5")) as nodes:
        return path.read_text(), nodes["nodes/a/0/V_th"][()].tolist()


def writers():
    """By name: the ending of the file, what writes it, and what reads it; what needs other packages where they are."""
    run = ("run", "net{seed}.yaml", "--for", "10", "--backend", "reference", "--out", "{out}")
    table = {
        "run": (".h5", command(*run), results),
        "report": (".html", command("report", "run{seed}.h5", "--out", "{out}"), None),
        "sonata": (".json", command("convert", "net{seed}.yaml", "{out}"), sonata),
        "save": (".yaml", lambda path, seed: network(seed).save(path), lambda path: str(neuro.load(path))),
        "state": (".h5", state, None),
        "checkpoint": (".training", checkpoint, None),
        "model": (".h5", model, None),
        "picture": (".png", picture, None),
        "filter": (
            ".npz",
            command("events", "filter", "rec{seed}.npz", "{out}", "crop: {{x: [0, 30]}}", "--force"),
            None,
        ),
        "frames": (".npz", command("events", "frames", "rec{seed}.npz", "{out}", "--force"), None),
        "gif": (".gif", command("events", "gif", "rec{seed}.npz", "{out}", "--force"), None),
        "view": (".html", command("events", "view", "rec{seed}.npz", "--out", "{out}"), None),
    }
    if find_spec("nir"):
        table["nir"] = (".nir", command("convert", "lif{seed}.yaml", "{out}"), None)
    for format in events.formats.FORMATS.values():
        if format.write:
            ending = format.suffixes[0]
            convert = command("events", "convert", "rec{seed}.npz", "{out}", "--force")
            table[f"convert {ending}"] = (ending, convert, lambda path: events.load(path).t.sum())
    return table


def prepare(folder):
    """Write the inputs of the commands into the present folder."""
    for seed in (0, 1):
        network(seed).save(folder / f"net{seed}.yaml")
        events.save(recording(seed), folder / f"rec{seed}.npz")
        neuro.compile(network(seed), "reference").run(10.0, out=folder / f"run{seed}.h5")
        net = neuro.Network("l", resolution=1.0)
        net.population("in", 40, neuro.spike_generator())
        net.population("l", 40, neuro.iaf_psc_delta(tau_m=20.0, C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=15.0))
        weight = np.random.default_rng(seed).random(1600)
        net.connect("in", "l", neuro.all_to_all(), weight=weight, delay=1.0, name="il")
        net.save(folder / f"lif{seed}.yaml")


def content(path, read):
    """What a complete file holds."""
    return repr(read(path)) if read else path.read_bytes()


def attempt(call, path, seed, before, after=lambda pid: None):
    """Fork a process that writes; its status and what it says. Does not return in that process."""
    with tempfile.TemporaryFile() as said:
        pid = os.fork()
        if not pid:
            os.dup2(said.fileno(), 1), os.dup2(said.fileno(), 2)
            code = 0
            signal.alarm(60)  # a writer that hangs is a fault
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
        said.seek(0)
        return os.waitstatus_to_exitcode(status), said.read().decode("utf-8", "replace")


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


class Writer:
    """A writer with the file that it has written, which each attempt finds."""

    def __init__(self, name, ending, call, read, place):
        self.name, self.call, self.read, self.place = name, call, read, place
        self.file = f"out{ending}"
        place.mkdir()
        self.taken, self.contents = 0.0, []
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
            call(place / self.file, 1)  # here, so that forks find all modules
        for seed in (1, 0):  # the file that the attempts find has seed 0
            began = time.perf_counter()
            code, said = attempt(call, place / self.file, seed, lambda: None)
            assert not code, f"{name}: {code}\n{said}"
            self.taken = max(self.taken, time.perf_counter() - began)
            self.contents.append(content(place / self.file, read))
        self.size = sum(each.stat().st_size for each in place.iterdir())

    def stopped(self, way, draw, disk):
        """Write in the place of the file and be stopped: the fault, "" if nothing is, and whether it was stopped."""
        folder = self.place.with_name("attempt") if way != "full" else disk
        if way != "full":
            folder.mkdir()
        for each in self.place.iterdir():
            shutil.copy(each, folder)
        path, before, after = folder / self.file, lambda: None, lambda pid: None
        if way in ("kill", "term"):
            moment = draw.uniform(0.0, 1.1 * self.taken)

            def after(pid):
                time.sleep(moment)
                os.kill(pid, signal.SIGKILL if way == "kill" else signal.SIGTERM)

        elif way == "size":
            most = draw.randrange(1, int(1.1 * self.size) + 2)

            def before():
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        else:
            room = shutil.disk_usage(folder).free - draw.randrange(0, int(1.2 * self.size) + 4096)
            with (folder / "filler").open("wb") as filler:
                os.posix_fallocate(filler.fileno(), 0, max(1, room))
        try:
            code, said = attempt(self.call, path, 1, before, after)
            return self.judged(way, code, said, path), code != 0
        finally:
            shutil.rmtree(folder) if way != "full" else [each.unlink() for each in folder.iterdir()]

    def judged(self, way, code, said, path):
        """What is wrong."""
        expected = {"kill": (0, -signal.SIGKILL), "term": (0, -signal.SIGTERM, 143)}.get(way, (0, 2))
        if code not in expected or "Traceback" in said:
            return f"status {code}: {said}"
        if code == 2 and sum(line.startswith("error:") for line in said.splitlines()) != 1:
            return f"no single error: {said}"
        if not path.exists():
            return f"the file is gone: {said}"
        try:
            found = content(path, self.read)
        except Exception as error:
            return f"the file cannot be read: {error}"
        timed = self.name in ("report", "state", "model")  # they say when they were written
        if code == 0 and way not in ("kill", "term"):
            return "" if timed or found == self.contents[0] else "the file that was written is not the whole"
        if found != self.contents[1] and not (timed or found == self.contents[0]):
            return "the file is neither the one before nor the new one"
        names = {each.name for each in self.place.iterdir()} | {"filler", f"{self.file}.part"}
        left = {each.name for each in path.parent.iterdir()} - names
        return f"left behind: {left}" if left and way in ("size", "full") else ""


def main(count, seed):
    """Stop writers so many times, in turn, and print how often each was stopped in each way."""
    draw, table, wrong = random.Random(seed), Counter(), []
    folder = Path(tempfile.mkdtemp(prefix="neuro-stopped-"))  # TemporaryDirectory would be removed by each fork
    os.chdir(folder)
    try:
        prepare(folder)
        every = [Writer(name, *rest, folder / f"w{k}") for k, (name, rest) in enumerate(writers().items())]
        with small_disk(folder / "disk", 64 << 20) as disk:
            ways = [way for way in WAYS if way != "full" or disk]
            pairs = [(writer, way) for way in ways for writer in every]
            draw.shuffle(pairs)
            for k in range(count):
                writer, way = pairs[k % len(pairs)]
                problem, stopped = writer.stopped(way, draw, disk)
                table[writer.name, way, "stopped" if stopped else "ended"] += 1
                if os.environ.get("NEURO_STOPS_SAID"):
                    print(k, writer.name, way, stopped, problem, flush=True)
                if problem:
                    wrong.append(f"attempt {k}, {writer.name}, {way}: {problem}")
    finally:
        os.chdir("/")
        shutil.rmtree(folder)
    print(f"{'writer':16}" + "".join(f"{way:>14}" for way in ways) + "   (stopped of attempts)")
    for writer in every:
        cells = [(table[writer.name, way, "stopped"], table[writer.name, way, "ended"]) for way in ways]
        print(f"{writer.name:16}" + "".join(f"{f'{a} of {a + b}':>14}" for a, b in cells))
    stopped = sum(number for (_, _, how), number in table.items() if how == "stopped")
    print(f"{count} attempts, {stopped} stopped, {len(wrong)} wrong")
    print("\n".join(wrong))
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
