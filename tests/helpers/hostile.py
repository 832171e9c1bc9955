"""Files that a stranger may have written to run code, write elsewhere or open a connection, and a process that notices.

`cases(base, place)` writes each case into a folder of its own; `run(cases, ...)` runs them one after the other in
processes whose audit hook reports code, files outside and connections. Nothing is drawn: each run has the same bytes.
"""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml

from neuro.core.hdf5 import seal
from neuro.core.provenance import ATTRIBUTE
from neuro_sweeps.folder import SWEEP, TUNING, Folder, sum_of

ASKED = yaml.safe_load(Path(__file__).with_name("hostile.yaml").read_text("utf-8"))


REPORT = "neuro report a.h5"

NET = """\
neuro: 1
name: pair
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 4}
  exc: {model: iaf_psc_exp, shape: 3}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: 300.0, delay: 1.0}
probes:
  v: {of: exc, record: V_m, every: 5.0}
"""
WORLD = """\
world:
  environment: ENVIRONMENT
  step: 10.0
  observe: {noise: ENCODER}
  act: {winner: {of: exc}}
"""
WORLDS = {
    "of a module": ("{id: 'os:system'}", "rates"),
    "of a file": ("{python: evil.py}", "rates"),
    "of a module here": ("{id: evil}", "rates"),
    "of a path": ("{id: ./evil.py}", "rates"),
    "of a class here": ("{id: Evil}", "rates"),
    "with an encoder": ("{id: CartPole-v1}", "evil.Encoder"),
}
"""Environments and encoders of worlds that only `--with` could name."""
STREAMED = """\
neuro: 1
name: streamed
resolution: 1.0
populations:
  eye: {model: {event_camera: {stream: "tcp://127.0.0.1:9", sensor: [9, 7]}}, shape: auto}
probes: {seen: {of: eye}}
"""
TUNE = """\
network: net.yaml
for: 20 ms
parameters: {noise.rate: {from: 100.0, to: 900.0}}
objectives: {rate.exc: maximise}
trials: 2
sampler: random
backend: reference
"""
SWEEP_YAML = "network: net.yaml\nfor: 20 ms\nseeds: 2\nbackend: reference\n"


@dataclass(frozen=True)
class Case:
    """One hostile file and a command that reads it.

    Attributes:
        name: of the attack.
        kind: page, results, state, model, sweep, journal, description, recording or exchange.
        folder: the current folder of the command.
        words: the command without "neuro"; of a state the network and the state, which Python restores.
    """

    name: str
    kind: str
    folder: Path
    words: tuple[str, ...]


@dataclass(frozen=True)
class Ran:
    """What came of a case.

    Attributes:
        case: that was run.
        status: with which its command ended.
        printed: to both streams.
        did: what it must not do, a line for each; "" if nothing.
        seconds: on the clock.
        processor_s: seconds of the processor.
    """

    case: Case
    status: int
    printed: str
    did: str
    seconds: float
    processor_s: float


class Writer:
    """Writes cases below a folder.

    Args:
        base: a folder with what is made well, see `make_base`.
        place: where cases are written.
        outside: a folder that no case may change; its file `victim.html` is a page of ours.
    """

    def __init__(self, base: Path, place: Path, outside: Path) -> None:
        self.base, self.place, self.outside = base, place, outside
        self.cases: list[Case] = []

    @property
    def code(self) -> str:
        """Python that leaves a mark outside."""
        return f"open({str(self.outside / 'CODE_RAN')!r}, 'w').write('ran')\n"

    def folder(self, name: str) -> Path:
        """A new folder with all that is made well, and Python files that leave a mark when they are run."""
        folder = self.place / re.sub(r"\W+", "_", name)
        shutil.copytree(self.base, folder)
        (folder / "evil.py").write_text(self.code)
        (folder / "minigrid.py").write_text(self.code)
        return folder

    def add(self, name: str, kind: str, folder: Path, *commands: str | tuple[str, ...]) -> None:
        """A case for each command."""
        for each in commands:
            words = tuple(each.split()) if isinstance(each, str) else each
            self.cases.append(Case(f"{name}: {' '.join(words[:3])}", kind, folder, words))

    def page(self, name: str, command: Any, inputs: Any = None, folder: Any = None) -> Path:
        """A page whose record asks for a command."""
        here = self.folder(name)
        kept = {"net.yaml": "x", "a.h5": "x"} if inputs is None else inputs
        if isinstance(kept, dict):
            kept = {str(here / path) if isinstance(path, str) else path: digest for path, digest in kept.items()}
        record = {"command": command, "folder": str(here) if folder is None else folder, "inputs": kept}
        text = html.escape(json.dumps(record))
        (here / "page.html").write_text(f'<html><meta name="{ATTRIBUTE}" content="{text}"></html>')
        self.add(name, "page", here, "rerun page.html")
        return here

    def edited(self, name: str, kind: str, file: str, edit: Callable[[Any], object], *commands: str) -> Path:
        """A file of HDF5 with something else in it, and a digest that fits."""
        here = self.folder(name)
        with h5py.File(here / file, "r+") as opened:
            edit(opened)
        seal(here / file)
        self.add(name, kind, here, *commands)
        return here

    def swept(self, name: str, file: str, edit: Callable[[dict[str, Any]], object], *commands: str) -> Path:
        """The folder of a sweep or a tuning whose file says something else, with a digest that fits."""
        here = self.folder(name)
        holding = SWEEP if file == "runs" else TUNING
        folder = Folder(here / file, holding)
        content = {word: value for word, value in folder.read().items() if word not in ("format", "digest")}
        edit(content)
        folder.write(content)
        key = sorted(os.listdir(folder.runs))[0]
        self.add(name, "sweep", here, *(each.replace("KEY", f"{file}/runs/{key}") for each in commands))
        return here


def make_base(folder: Path, run: Callable[..., object]) -> None:
    """Write a network, results, a page, a state, a sweep, a tuning and models, as `run(*words)` makes them."""
    import neuro

    (folder / "net.yaml").write_text(NET)
    (folder / "streamed.yaml").write_text(STREAMED)
    (folder / "tune.yaml").write_text(TUNE)
    (folder / "sweep.yaml").write_text(SWEEP_YAML)
    run("run", "net.yaml", "--for", 20, "--backend", "reference", "--out", "a.h5")
    run("report", "a.h5")
    sim = neuro.compile(neuro.load(folder / "net.yaml"), backend="reference")
    sim.run(5.0)
    sim.save(folder / "state.h5")
    run("sweep", "run", "sweep.yaml", "--on", "here")
    run("tune", "run", "tune.yaml", "--on", "here")
    run("drone", "train", "--steps", 60, "--out", "fly.h5")
    run("agent", "train", "CartPole-v1", "--steps", 60, "--out", "agent.h5", "--set", "critics=5")


def attacks(writer: Writer) -> list[Case]:
    """Write all cases."""
    _pages(writer)
    _results(writer)
    _states(writer)
    _models(writer)
    _sweeps(writer)
    _journals(writer)
    _descriptions(writer)
    return writer.cases


def _pages(w: Writer) -> None:
    out = str(w.outside)
    for k, option in enumerate(("--with evil.py", "--with=evil.py", "--wit=evil.py", "--w evil.py", "-with evil.py")):
        w.page(f"page with {k}", f"{REPORT} {option}", CODE)
        w.page(f"page check with {k}", f"neuro check net.yaml {option}", CODE)
    for name, command, *inputs in ASKED["pages"]:
        w.page(f"page {name}", command.replace("{out}", out), _named(*inputs[0]) if inputs else None)
    for name, command in ASKED["asked"].items():
        here = w.page(f"page by {name}", command.replace("{out}", out), MORE)
        (here / "words.txt").write_text("a.h5 --with evil.py\n")
        (here / "study.yaml").write_text("study: evil:f\nparameters: {command: [ls]}\n")
    w.page("page out upward", f"{REPORT} --out {'../' * 30}{out[1:]}/new.html")
    w.page("page force into an input", f"{REPORT} --out data/victim.html", _named("a.h5", out))
    (w.page("page linked folder", f"{REPORT} --out data/victim.html", _named("a.h5", "data")) / "data").symlink_to(out)
    inner = w.page("page link in a folder", f"{REPORT} --out data/in/new.html", _named("a.h5", "data"))
    (inner / "data").mkdir()
    (inner / "data" / "in").symlink_to(out)
    os.mkfifo(w.page("page pipe", REPORT, _named("a.h5", "pipe")) / "pipe")
    settings = w.page("page settings", "neuro doctor net.yaml --html page.html", _named("net.yaml", "matplotlibrc"))
    (settings / "matplotlibrc").write_text("backend: module://evil\n")
    w.page("page damaged command", ["neuro", "report"])
    for name, more in (("inputs", (["a.h5"],)), ("digest", ({"a.h5": 3},)), ("folder", (None, 3))):
        w.page(f"page damaged {name}", REPORT, *more)
    w.page("page zero byte", f"{REPORT}\0")
    for name, words in (("words", "x " * 300_000), ("values", "--with=evil.py " * 20_000)):
        w.page(f"page of many {name}", f"{REPORT} {words}")
    w.page("page of a long word", f"{REPORT} --out {'x' * 1_000_000}")
    w.page("page of many inputs", REPORT, _named(*(f"inputs/{k}" for k in range(20_000))))
    w.page("page of a long folder", REPORT, _named("a.h5"), "/" + "x/" * 5000)
    w.page("page of a folder that is none", REPORT, _named("a.h5"), "/dev/null")
    moved = w.page("page pipe among the moved", REPORT, _named("a.h5", "lost"))
    os.mkfifo(moved / "pipe")
    w.add("page pipe among the moved", "page", moved, "rerun page.html --moved-to .")
    loop = w.page("page loop of links", REPORT, _named("a.h5", "loop", "around"))
    (loop / "loop").symlink_to("loop")
    (loop / "around").mkdir()
    (loop / "around" / "up").symlink_to(".")
    with (w.page("page larger than the disk", REPORT, _named("a.h5", "sparse")) / "sparse").open("wb") as file:
        file.truncate(2**43)
    deep = w.page("page deep", REPORT)
    (deep / "page.html").write_text(f'<meta name="{ATTRIBUTE}" content="{"[" * 100_000}">')


def _named(*files: str) -> dict[str, str]:
    """Inputs of a record."""
    return dict.fromkeys(files, "x")


CODE = _named("net.yaml", "a.h5", "evil.py", "minigrid.py")


MORE = CODE | _named("words.txt", "study.yaml", "sweep.yaml")


def _described(text: str, files: dict[str, str] | None = None, **record: Any) -> Callable[[Any], None]:
    """Give results another network, and words of their record."""

    def edit(opened: Any) -> None:
        del opened["network"]
        opened["network"] = text
        for name, content in (files or {}).items():
            opened[f"network_files/{name}"] = np.frombuffer(content.encode(), np.uint8)
        told = json.loads(opened.attrs[ATTRIBUTE]) | record
        opened.attrs[ATTRIBUTE] = json.dumps(told)

    return edit


def _results(w: Writer) -> None:
    reads = ("rerun a.h5", "plot a.h5", "report a.h5 --out new.html")

    def results(name: str, edit: Callable[[Any], object]) -> None:
        w.edited(f"results {name}", "results", "a.h5", edit, *reads)

    plays = STREAMED.replace('stream: "tcp://127.0.0.1:9", sensor: [9, 7]', "file: FILE")
    results("tag", _described("!!python/object/apply:os.system [ls]"))
    results("stream", _described(STREAMED))
    hidden = {"b.yaml": STREAMED.replace("neuro: 1\n", "")}
    results("included stream", _described("neuro: 1\ninclude: [b.yaml]\n", hidden))
    results("plays outside", _described(plays.replace("FILE", "/etc/passwd")))
    upward = f"{'../' * 12}{os.path.relpath(w.outside, '/')}/new.dat"
    source = _named(f"{w.base}/{upward}", f"/{upward}")
    results("copies outside", _described(plays.replace("FILE", upward), inputs=source))
    attributes = {
        "names a table": ("backend", "evil.yaml"),
        "backend": ("backend", "evil:backend"),
        "record": (ATTRIBUTE, "[1]"),
        "many threads": ("threads", -3),
    }
    for name, words in attributes.items():
        results(name, lambda f, words=words: f.attrs.modify(*words))
    results("file is a group", lambda f: f.require_group("network_files/x.py"))
    link = h5py.ExternalLink(str(w.outside / "victim.html"), "/")
    results("link outside", lambda f: f.__setitem__("network_files/b.yaml", link))
    circle = {f"{k}.yaml": f"include: [{k + 1}.yaml]\n" for k in range(1, 2000)} | {"2000.yaml": "include: [1.yaml]\n"}
    results("include each other", _described("neuro: 1\ninclude: [1.yaml]\n", circle))
    for name, path, edit in _links(w):
        results(name, lambda f, p=path, e=edit: e(f, p))

    def huge(opened: Any) -> None:
        del opened["populations/exc"]
        opened.create_group("populations/exc").create_dataset("steps", (2**48,), "i8", chunks=(1024,))

    results("huge", huge)
    names = NET.replace("exc:", '"<script>alert(1)</script>":').replace("exc,", '"<script>alert(1)</script>",')
    results("script in a name", _described(names))


def _links(w: Writer, *paths: str) -> list[tuple[str, str, Callable[[Any, str], None]]]:
    """Links to other files, in the place of arrays and groups; each with its name and place."""
    secret, pipe = str(w.outside / "victim.txt"), w.place / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)

    def link(target: Any) -> Callable[[Any, str], None]:
        return lambda opened, path: opened.__setitem__(path, target)

    def array(*args: Any, **words: Any) -> Callable[[Any, str], None]:
        return lambda opened, path: opened.create_dataset(path, *args, **words)

    def virtual(opened: Any, path: str) -> None:
        """An array whose numbers are in a pipe, that nobody writes into."""
        layout = h5py.VirtualLayout(shape=(10,), dtype="i8")
        layout[:] = h5py.VirtualSource(str(pipe), "x", shape=(10,))
        opened.create_virtual_dataset(path, layout)

    def objects(opened: Any, path: str) -> None:
        opened.create_dataset(path, (1,), h5py.ref_dtype)[0] = opened.ref

    def instead(edit: Callable[[Any, str], None]) -> Callable[[Any, str], None]:
        def edited(opened: Any, path: str) -> None:
            opened.pop(path, None)
            edit(opened, path)

        return edited

    edits = {
        "soft link in a ring": link(h5py.SoftLink("/")),
        "soft link to nothing": link(h5py.SoftLink("/nothing")),
        "external link": link(h5py.ExternalLink(secret, "/")),
        "external link to a pipe": link(h5py.ExternalLink(str(pipe), "/x")),
        "external link to a device": link(h5py.ExternalLink("/dev/zero", "/x")),
        "virtual array of a pipe": virtual,
        "array of another file": array((4,), "u1", external=[(secret, 0, 4)]),
        "references": objects,
        "bomb of a petabyte of zeros": array((2**47,), "i8", chunks=(2**20,), compression="gzip"),
    }
    places = paths or ("network", "populations/exc", "populations/exc/steps", "network_files")
    return [(f"{name} at {path}", path, instead(edit)) for name, edit in edits.items() for path in places]


def _states(w: Writer) -> None:
    restore = ("RESTORE net.yaml state.h5", "rerun state.h5")

    def state(name: str, edit: Callable[[Any], object]) -> None:
        w.edited(name, "state", "state.h5", edit, *restore)

    state("state command", lambda f: _command(f, "neuro check net.yaml --with=evil.py"))
    state("state network", lambda f: _network_of(f, "!!python/name:os.system"))
    for name, path, edit in _links(w, "engine", "engine/net/step", "engine/emitted/0/ids"):
        state(f"state {name}", lambda f, p=path, e=edit: e(f, p))
    state("state huge", lambda f: f.create_dataset("more", (2**50,), "i8", chunks=(64,)))
    state("state pickled", lambda f: f.attrs.modify("format", _pickled(w)))


def _command(opened: Any, command: str, **words: Any) -> None:
    told = json.loads(opened.attrs[ATTRIBUTE]) | {"command": command, **words}
    opened.attrs[ATTRIBUTE] = json.dumps(told)


def _network_of(opened: Any, text: str) -> None:
    del opened["network_files/network.yaml"]
    opened["network_files/network.yaml"] = np.frombuffer(text.encode(), np.uint8)


def _pickled(w: Writer) -> str:
    return f"cbuiltins\nexec\n(V{w.code.strip()}\ntR."


def _models(w: Writer) -> None:
    agent = ("agent test agent.h5 --episodes 1", "agent watch agent.h5 --out new.html", "rerun agent.h5")
    drone = ("drone energy fly.h5", "rerun fly.h5")

    def model(name: str, edit: Callable[[Any], object], *commands: str) -> None:
        w.edited(name, "model", "agent.h5" if name.startswith("agent") else "fly.h5", edit, *commands)

    for k, world in enumerate(("evil:Env", "antigravity:X", "MiniGrid-X-v0", "os:system", "a.b:C", "minigrid:X")):
        text = json.dumps(world)
        model(f"agent environment {k}", lambda f, text=text: f.attrs.modify("environment", text), *agent)
    for name, path, edit in _links(w, "learnt", "learnt/value"):
        model(f"agent {name}", lambda f, p=path, e=edit: e(f, p), agent[0])
    for name, path, edit in _links(w, "network/network.yaml", "learnt/cells_motors"):
        model(f"drone {name}", lambda f, p=path, e=edit: e(f, p), drone[0])
    model("agent command", lambda f: _command(f, "neuro agent train evil:Env --out agent.h5 --steps 10"), *agent)
    outside = f"--out {w.outside}/new.h5"
    model("agent outside", lambda f: _command(f, f"neuro agent train CartPole-v1 --steps 10 {outside}"), agent[2])
    model("drone with", lambda f: _command(f, "neuro drone train --with evil.py"), *drone)
    model("drone outside", lambda f: _command(f, f"neuro drone train --steps 40 {outside}"), drone[1])
    model("drone controller", lambda f: f.attrs.modify("controller", "evil:Controller"), *drone)
    ppo = w.folder("model of pickles")
    (ppo / "fly.h5").write_bytes(_pickled(w).encode())
    more = ("drone test fly.h5", "drone watch fly.h5", "recognise test fly.h5 --data .", "agent test fly.h5")
    w.add("model of pickles", "model", ppo, *drone, *more)


def _function(w: Writer, name: str, module: str, file: str = "") -> Callable[[dict[str, Any]], None]:
    def edit(content: dict[str, Any]) -> None:
        paths = [str(w.place / "evil"), str(w.outside)]
        what = {"kind": "function", "name": name, "module": module, "file": file, "source": "x"}
        content["what"] = {**what, "set": {"command": f"touch {w.outside}/CODE_RAN"}, "paths": paths}

    return edit


def _sweeps(w: Writer) -> None:
    goes_on = "sweep run sweep.yaml --out runs --workers 1", "tune run tune.yaml --out tuned --workers 1"
    reads = ("rerun KEY", *(f"sweep {word} runs" for word in ("status", "table", "page", "plot")))
    tuned = (
        "rerun KEY",
        *(f"tune {word} tuned" for word in ("status", "table", "page")),
        "tune test tuned --workers 1",
    )
    reads, tuned = (*reads, f"{goes_on[0]} --retry-failed"), (*tuned, f"{goes_on[1]} --retry-failed")
    kinds = [("system", "posix", ""), ("system", "os", ""), ("f", "evil", ""), ("f", "__main__", "evil.py")]
    for k, kind in enumerate(kinds):
        w.swept(f"sweep function {k}", "runs", _function(w, *kind), *reads)
        w.swept(f"tuning function {k}", "tuned", _function(w, *kind), *tuned)
    evil = {"with": {"evil.py": "x"}}
    w.swept("sweep with", "runs", lambda c: c.update(evil), *reads)
    w.swept("tuning with", "tuned", lambda c: c.update(evil), *tuned)
    w.swept("sweep of nothing", "runs", lambda c: c.update(what={"kind": "evil"}), *reads)
    w.swept("sweep backend", "runs", lambda c: c["what"].update(backend="evil:backend"), *reads)
    w.swept("sweep unlike", "runs", lambda c: c.update(what=[1]), reads[0])
    here = w.swept("sweep forgotten runs", "runs", lambda c: c.update(evil))
    for each in sorted((here / "runs" / "runs").iterdir()):
        shutil.rmtree(each)
    w.add("sweep forgotten runs", "sweep", here, goes_on[0])
    here = w.swept("tuning forgotten", "tuned", _function(w, "system", "posix"))
    for each in sorted((here / "tuned" / "runs").iterdir()):
        shutil.rmtree(each)
    (here / "tuned" / "journal.log").unlink()
    w.add("tuning forgotten", "sweep", here, goes_on[1])

    def linked(name: str, path: str, target: Path, kind: str, command: str) -> None:
        """A link in the place of a part of a folder."""
        here = w.swept(name, path.partition("/")[0], lambda c: None)
        shutil.rmtree(here / path) if (here / path).is_dir() else (here / path).unlink()
        (here / path).symlink_to(target)
        w.add(name, kind, here, command)

    linked("sweep page of a link", "runs/sweep.html", w.outside / "victim.txt", "sweep", "sweep page runs")
    for name in ("runs", "claims"):
        linked(f"sweep link of {name}", f"runs/{name}", w.outside, "sweep", goes_on[0])
    linked("tuning link of its journal", "tuned/journal.log", w.outside / "empty.txt", "journal", goes_on[1])
    here = w.swept("sweep study", "runs", lambda c: None)
    (here / "sweep.yaml").write_text("study: evil:f\nparameters: {command: [ls]}\n")
    w.add("sweep study", "sweep", here, "sweep run sweep.yaml --out new")
    (here / "s2.yaml").write_text("network: !!python/name:os.system\n")
    w.add("sweep tag", "sweep", here, "sweep run s2.yaml --out new", "tune run s2.yaml --out new")


def _journals(w: Writer) -> None:
    reads = (
        "tune status tuned",
        "tune table tuned",
        "tune page tuned",
        "tune plot tuned",
        "tune run tune.yaml --out tuned --workers 1",
    )

    def journal(name: str, edit: Callable[[dict[str, Any]], object]) -> None:
        here = w.folder(name)
        path = here / "tuned" / "journal.log"
        before, lines = "search", []
        for line in path.read_text().splitlines():
            log = {word: value for word, value in json.loads(line).items() if word != "sum"}
            edit(log)
            before = sum_of(log, before)
            lines.append(json.dumps({**log, "sum": before}))
        path.write_text("\n".join(lines) + "\n")
        w.add(name, "journal", here, *reads)

    pickled = _pickled(w)
    distribution = json.dumps({"name": "__import__('os').system", "attributes": {"choices": [pickled]}})
    words = {"distribution": distribution, "user_attr": {"x": pickled}, "values": [pickled]}
    words["study_name"] = f"../../{w.outside}/x"
    for word, value in words.items():
        journal(f"journal {word}", lambda log, word=word, value=value: log.update({word: value} if word in log else {}))
    journal("journal operation", lambda log: log.update(op_code=99))
    here = w.folder("journal pickle")
    (here / "tuned" / "journal.log").write_bytes(pickled.encode())
    w.add("journal pickle", "journal", here, *reads)


def _descriptions(w: Writer) -> None:
    reads = ("check net.yaml", "run net.yaml --for 1 --backend reference", "show net.yaml", "doctor net.yaml --for 1")

    def described(name: str, text: str, *commands: str) -> Path:
        here = w.folder(name)
        (here / "net.yaml").write_text(text)
        w.add(name, "description", here, *(commands or reads))
        return here

    described("yaml tag", "!!python/object/apply:os.system ['touch x']\n")
    described("yaml include", f"neuro: 1\ninclude: [{w.outside}/victim.html]\n")
    described("yaml arithmetic", NET.replace("300.0", "\"$(__import__('os').system('ls'))\""))
    described("yaml name", NET.replace("iaf_psc_exp", "evil:Neuron"))
    for name, (environment, encoder) in WORLDS.items():
        world = WORLD.replace("ENVIRONMENT", environment).replace("ENCODER", encoder)
        described(f"world {name}", NET + world, "run net.yaml --steps 1 --backend reference")
    pickles = described("yaml pickle", NET.replace("300.0", "{file: w.npy}"))
    np.save(pickles / "w.npy", np.array([_Runs(w.code)], dtype=object), allow_pickle=True)
    here = w.folder("events pickle")
    np.savez(here / "a.npz", t=np.array([_Runs(w.code)], dtype=object))
    w.add("events pickle", "recording", here, "events info a.npz", "events view a.npz --out new.html")
    here = w.folder("scenario tag")
    (here / "s.yaml").write_text("!!python/name:os.system\n")
    w.add("scenario tag", "description", here, "drone train --scenario s.yaml --steps 10", "fit net.yaml --chip s.yaml")
    here = w.folder("exchange pickle")
    for name in ("a.nir", "a.net", "a.sonata.h5"):
        (here / name).write_bytes(_pickled(w).encode())
        w.add(f"exchange {name}", "exchange", here, f"convert {name} out.yaml")


class _Runs:
    """Runs code when it is unpickled."""

    def __init__(self, code: str) -> None:
        self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, (self.code,)


WATCH = '''\
"""Reports what a process and all that it starts do and must not: this file is imported by each as it begins."""
import os
import sys

LOG, STRANGER = os.environ["HOSTILE_LOG"], os.environ["HOSTILE_CASES"]
ROOTS = os.environ["HOSTILE_ROOTS"].split(os.pathsep)
WRITES = {"os.rename": (0, 1), "os.remove": (0,), "os.mkdir": (0,), "os.rmdir": (0,), "os.symlink": (1,),
          "os.link": (1,), "os.truncate": (0,), "os.chmod": (0,), "os.utime": (0,)}
CONNECTS = ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo")
PROGRAMS = ("git", "fc-list", "uname", os.path.basename(sys.executable), "python", "python3")

def outside(path):
    if not isinstance(path, (str, bytes)):
        return False
    path = os.path.realpath(os.path.abspath(os.fsdecode(path)))
    return not any(path == root or path.startswith(root + os.sep) for root in ROOTS)

def tell(*what):
    descriptor = os.open(LOG, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, (" ".join(map(str, what))[:500] + "\\n").encode())
    os.close(descriptor)

busy = False

def watch(event, arguments):
    global busy
    if busy:
        return
    busy = True
    try:
        if event == "open" and arguments[0] != LOG:
            flags = arguments[2] if isinstance(arguments[2], int) else 0
            if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) and outside(arguments[0]):
                tell("writes", arguments[0])
        elif event in WRITES:
            for k in WRITES[event]:
                beside = isinstance(arguments[-1], int) and arguments[-1] > 2 and event in ("os.rmdir", "os.remove")
                if not beside and outside(arguments[k]):  # shutil.rmtree names what it removes by an open folder
                    tell(event, arguments[k])
        elif event in CONNECTS:
            tell(event, arguments[1:])
        elif event in ("os.system", "os.exec", "os.posix_spawn"):
            tell(event, arguments)
        elif event == "subprocess.Popen":
            if os.path.basename(os.fsdecode(arguments[0])) not in PROGRAMS:
                tell(event, arguments[:2])
        elif event == "exec" and hasattr(arguments[0], "co_filename"):
            name = os.path.abspath(arguments[0].co_filename)
            if name.startswith(STRANGER + os.sep) and os.path.isfile(name):
                tell("runs", name)
        elif event == "ctypes.dlopen" and str(arguments[0]).startswith(STRANGER + os.sep):
            tell("loads", arguments[0])
        elif event == "import" and arguments[0] in ("evil", "antigravity"):
            tell("imports", arguments[0])
    finally:
        busy = False

sys.addaudithook(watch)
'''

DRIVER = '''\
"""Run each case in a process of its own, which begins with all modules there; two at once."""
import json, os, resource, signal, sys, time, traceback
import sitecustomize
import neuro.cli.commands, neuro_sweeps.rerun, neuro_sweeps.definition, neuro.files.results, neuro, matplotlib.figure

cases, log = json.load(open(sys.argv[1])), os.environ["HOSTILE_LOG"]


def run(number, folder, words):
    signal.alarm(100)
    os.chdir(folder)
    sitecustomize.LOG = os.environ["HOSTILE_LOG"] = f"{log}-{number}"
    sitecustomize.busy = True  # the next file is ours
    printed = os.open(f"{log}-{number}-printed", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sitecustomize.busy = False
    os.dup2(printed, 1), os.dup2(printed, 2)
    status = 99
    try:
        if words[0] == "RESTORE":
            try:
                sim = neuro.compile(neuro.load(words[1]), backend="reference")
                sim.restore(words[2])
                status = 0
            except neuro.ModelError as error:
                print(error)
                status = 2
        else:
            sys.argv = ["neuro", *words]
            from neuro.cli import main
            main()
    except SystemExit as leaving:
        status = leaving.code or 0
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush(), sys.stderr.flush()
    os._exit(status)


def wait():
    child, ended, used = os.wait4(-1, 0)
    number, begin = running.pop(child)
    texts = []
    for name in (f"{log}-{number}-printed", f"{log}-{number}"):
        texts.append(open(name, errors="replace").read() if os.path.exists(name) else "")
    seconds = time.monotonic() - begin, used.ru_utime + used.ru_stime
    done[number] = [os.waitstatus_to_exitcode(ended), *texts, *seconds]


running, done = {}, {}
waiting = dict(enumerate(cases))
while waiting or running:
    free = [n for n, (folder, _) in waiting.items() if folder not in {cases[k][0] for k, _ in running.values()}]
    if len(running) == 2 or not free:
        wait()
        continue
    number = free[0]
    folder, words = waiting.pop(number)
    child = os.fork()
    if not child:
        run(number, folder, words)
    running[child] = number, time.monotonic()
print(json.dumps([done[number] for number in range(len(cases))]))
'''


def run(cases: list[Case], place: Path, roots: list[Path], timeout_s: float) -> Iterator[Ran]:
    """Run cases, two at once but one in a folder, and yield what came of each.

    Args:
        cases: to run.
        place: a folder for the files of the watch.
        roots: folders into which the commands may write.
        timeout_s: for all.
    """
    watch = place / "watch"
    watch.mkdir(parents=True)
    (watch / "sitecustomize.py").write_text(WATCH)
    (place / "driver.py").write_text(DRIVER)
    (place / "cases.json").write_text(json.dumps([[str(case.folder), case.words] for case in cases]))
    temporary = place / "temporary"
    temporary.mkdir()
    from neuro.kernels.kept import folder

    allowed = [temporary, *roots, Path("/dev"), *([kept] if (kept := folder()) else [])]
    env = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(watch), *filter(None, sys.path)]),
        "TMPDIR": str(temporary),
        "HOME": str(temporary),
        "XDG_CACHE_HOME": str(Path(os.path.realpath(allowed[-1])).parents[1]),
        "MPLCONFIGDIR": str(temporary),
        "HOSTILE_LOG": str(place / "log"),
        "HOSTILE_ROOTS": os.pathsep.join(os.path.realpath(each) for each in allowed),
        "HOSTILE_CASES": os.path.realpath(cases[0].folder.parent),
    }
    command = [sys.executable, "-P", str(place / "driver.py"), str(place / "cases.json")]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=timeout_s)
    assert not done.returncode, done.stderr[-2000:]
    for case, (status, printed, did, *seconds) in zip(cases, json.loads(done.stdout), strict=True):
        yield Ran(case, status, printed, did, *seconds)
