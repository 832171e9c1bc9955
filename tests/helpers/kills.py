"""What is killed with SIGKILL, goes on and is killed again: what it came to beside what was never killed.

`python tests/helpers/kills.py tuning 50 0` kills searches 50 times. Each attempt is a fork of a process that has all
modules, so it costs only what it does. Half of the kills fall right before a file is opened for writing, renamed,
removed or made, drawn among all such moments; the others at a moment drawn from the time that the whole takes.
"""

import importlib.util
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
WRITES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "shutil.rmtree")


def module(path):
    """A file of the tests as a module, as processes of a sweep find it."""
    sys.path.insert(0, str((TESTS / path).parent))
    name = Path(path).stem
    spec = importlib.util.spec_from_file_location(name if name != "conftest" else path.replace("/", "_"), TESTS / path)
    made = importlib.util.module_from_spec(spec)
    sys.modules[made.__name__] = made
    spec.loader.exec_module(made)
    return made


class Sweep:
    """Runs of a network, results kept."""

    NET = {
        "neuro": 1,
        "populations": {
            "noise": {"model": {"poisson_generator": {"rate": 900.0}}, "shape": 20},
            "exc": {"model": "iaf_psc_exp", "shape": 10},
        },
        "parameters": {"w": 300.0},
        "projections": {"in": {"from": "noise", "to": "exc", "rule": "all_to_all", "weight": "$w", "delay": 1.0}},
    }

    def __init__(self, place):
        from neuro_sweeps.definition import load_runs
        from neuro_sweeps.folder import SWEEP, Folder

        said = {"network": "net.yaml", "for": "20 ms", "backend": "reference", "keep": "results", "seeds": 2}
        (place / "net.yaml").write_text(json.dumps(self.NET))
        (place / "sweep.yaml").write_text(json.dumps({**said, "parameters": {"w": [200.0, 300.0, 400.0]}}))
        self.file, self.load = place / "sweep.yaml", lambda file: load_runs(file, SWEEP)
        self.folder = lambda out: Folder(out, SWEEP)

    def do(self, out):
        from neuro_sweeps.execute import execute
        from neuro_sweeps.executors import Executor

        execute(self.load(self.file), self.folder(out / "runs"), Executor(*self.place))

    place = ("here",)

    def bits(self, out):
        from neuro_sweeps.table import table_of

        table = table_of(out / "runs")
        assert sorted(os.listdir(out / "runs" / "runs")) == sorted(table.keys), "something was left behind"
        return table.csv(), [arrays(out / "runs" / "runs" / key / "results.h5") for key in table.keys]


class SweepOfWorld(Sweep):
    """Runs of a network that learns in its world, results kept."""

    def __init__(self, place):
        super().__init__(place)
        import neuro_models

        text = Path(neuro_models.path("cartpole")).read_text().replace("explore: 400", "explore: 50")
        (place / "net.yaml").write_text(text)
        said = {"network": "net.yaml", "for": "4000 ms", "keep": "results", "seeds": 2}
        (place / "sweep.yaml").write_text(json.dumps({**said, "parameters": {"critics": [2, 5, 10]}}))


class SweepOnCores(Sweep):
    """The same in two processes of their own, which are killed with the one that asks."""

    place = ("cores", 2)


class Tuning:
    """A search by TPE whose trials are pruned by hyperband."""

    function = "climbing"
    words = {"objectives": {"value": "maximise"}, "prune": {"by": "hyperband", "factor": 2}, "trials": 15}

    def __init__(self, place):
        self.run = getattr(module("sweeps/my_searches.py"), self.function)
        self.space = module("sweeps/test_kill_points.py").SPACE

    def do(self, out):
        import neuro

        neuro.tune(self.run, self.space, out=out / "tuned", on="here", progress=False, **self.words)

    def bits(self, out):
        import neuro

        table = neuro.tuned(out / "tuned")
        trials = [(each.number, each.outcome, each.point, each.values) for each in table.trials()]
        return table.csv(), trials, {key: each.steps for key, each in table.runs().outcomes().items()}


class TuningOfTwo(Tuning):
    """A search by NSGA-II for two objectives, with seeds."""

    function = "shifted"
    words = {"objectives": {"loss": "min", "cost": "min"}, "sampler": "nsga2", "trials": 20, "seeds": 2}


class Training:
    """`neuro train` of a small network with its checkpoint after each epoch."""

    def __init__(self, place):
        import torch

        import neuro
        import neuro_models
        from neuro.events import recordings, save
        from neuro_train import trainer
        from neuro_train.data import show
        from neuro_train.plan import TrainingPlan

        torch.set_num_threads(1)  # threads of this process would be none of a fork
        made = module("train/conftest.py")
        for k in range(12):
            path = place / "Train" / made.NAMES[k % 3] / f"{k}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            save(made.bars(k), path)
        small = {"height": made.SIDE, "width": made.SIDE, "hidden": 10, "classes": 3, "in_std": 0.2, "out_std": 0.4}
        self.net = neuro.load(neuro_models.path("dense"), params=small)
        plan = {"input": "pixels", "output": "out", "duration": 60.0, "epochs": 8, "batch": 6}
        self.plan = TrainingPlan(**plan, shift=1, bits=6, prune=0.4, seed=3)
        self.shown = show(self.net, recordings(place, part="Train"), self.plan, lambda *told: None)
        trainer.KEEP_S, self.trainer = 0.0, trainer

    def do(self, out):
        file = out / "model.yaml"
        checkpoint = self.trainer.begun(self.net, file, self.shown, self.plan)
        if checkpoint.path.exists() or not file.exists():
            made = self.trainer.learn(self.net, self.shown, self.plan, checkpoint)
            made.net.save(file)
            checkpoint.remove()

    def bits(self, out):
        import neuro

        assert not list(out.glob("*.training*")), "something was left behind"
        return neuro.load(out / "model.yaml")


class Drone:
    """The training of a spiking drone, with a checkpoint every 100 steps."""

    words = {"scenario": "B60", "steps": 600, "seed": 4, "settings": {"block": 100}}

    def __init__(self, place):
        from neuro_drone import model, train

        model.BLOCK, self.train = 100, train.train

    def do(self, out):
        self.train(**self.words, out=out / "model.h5")

    def bits(self, out):
        assert [path.name for path in out.iterdir()] == ["model.h5"], "something was left behind"
        return arrays(out / "model.h5")


class DroneSearch(Drone):
    """The training of a drone by random search."""

    words = {"scenario": "B60", "controller": "random-search", "steps": 600, "episode": 20, "seed": 2}


class Agent:
    """`neuro agent train`, with a checkpoint every 100 steps."""

    def __init__(self, place):
        from neuro_agent import ActorCritic, environments, training

        training.BLOCK = 100
        self.agent, self.environments = ActorCritic, environments

    def do(self, out):
        env = self.environments.make("CartPole-v1")
        agent = self.agent(env.observation_space, env.action_space, seed=4, critics=5, explore=50)
        agent.train(env, steps=1000, out=out / "agent.h5")
        self.environments.remember(out / "agent.h5", "CartPole-v1")

    def bits(self, out):
        assert [path.name for path in out.iterdir()] == ["agent.h5"], "something was left behind"
        return arrays(out / "agent.h5")


class Remus:
    """The training of ReMuS, with a checkpoint after each epoch."""

    def __init__(self, place):
        from neuro_recognise.recogniser import learn

        made = module("recognise/conftest.py")
        changed = {"epochs": 3, "size": [16, 16], "window": 10.0, "field": 7, "theta": 16.0}
        self.learn, self.shown, self.method = learn, made.shapes(), made.Remus().preset("adapted").changed(changed)

    def do(self, out):
        self.learn(self.method, self.shown, "letters", seed=1, out=out / "model.h5")

    def bits(self, out):
        assert [path.name for path in out.iterdir()] == ["model.h5"], "something was left behind"
        return arrays(out / "model.h5")


KINDS = {
    "sweep": Sweep,
    "sweep-world": SweepOfWorld,
    "sweep-cores": SweepOnCores,
    "tuning": Tuning,
    "tuning-nsga2": TuningOfTwo,
    "training": Training,
    "agent": Agent,
    "drone": Drone,
    "drone-search": DroneSearch,
    "remus": Remus,
}


def arrays(path):
    """All arrays of an HDF5 file, bit by bit."""
    import h5py

    found = {}

    def add(name, part):
        if isinstance(part, h5py.Dataset):
            found[name] = part.dtype.str, part.shape, part[()].tobytes() if part.dtype.kind != "O" else str(part[()])

    with h5py.File(path) as file:
        file.visititems(add)
    return found


def attempt(kind, out, at=None, after=None):
    """Do it in a fork; killed right before so many-th write, or after so many seconds.

    Returns:
        Whether it was killed, and how many writes there were where it was not.
    """
    said, telling = os.pipe()
    process = os.fork()
    if not process:
        os.setsid()
        count = 0

        def look(event, words):
            nonlocal count
            opened = event == "open" and isinstance(words[2], int) and words[2] & (os.O_WRONLY | os.O_RDWR)
            if (opened or event in WRITES) and str(words[0]).startswith(str(out)):
                count += 1
                if count == at:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(look)
        status = 1
        try:
            kind.do(out)
            os.write(telling, str(count).encode())
            status = 0
        finally:
            os._exit(status)
    os.close(telling)
    if after is not None:
        time.sleep(after)
        try:
            os.killpg(process, signal.SIGKILL)
        except ProcessLookupError:
            os.kill(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    writes = int(os.read(said, 20) or 0)
    os.close(said)
    if os.WIFSIGNALED(status):
        return True, writes
    assert os.WEXITSTATUS(status) == 0, "it failed by itself"
    return False, writes


def main(which, kills, seed):
    """Kill so many times, compare whatever comes to its end, and print a row.

    Columns: kind, writes of one that is not killed, kills before a write, kills at a moment, how many came to their
    end, and how many of these differ.
    """
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        (place / "of").mkdir()
        kind = KINDS[which](place / "of")
        for name in ("whole", "again"):
            (place / name).mkdir()
        kind.do(place / "whole")  # here, so that forks have all modules, and kernels are compiled
        whole = kind.bits(place / "whole")
        began = time.monotonic()
        _, writes = attempt(kind, place / "again")
        seconds = time.monotonic() - began
        assert kind.bits(place / "again") == whole, "not the same without a kill"
        done = {"write": 0, "moment": 0, "ends": 0, "differ": 0}
        while done["write"] + done["moment"] < kills or (place / "killed").exists():
            out = place / "killed"
            out.mkdir(exist_ok=True)
            how, words = "", {}
            if done["write"] + done["moment"] < kills:
                how = "write" if (done["write"] + done["moment"]) % 2 else "moment"
                at = draw.randint(1, max(1, writes // 2)) if how == "write" else None
                words = {"at": at, "after": draw.uniform(0.0, seconds) if how == "moment" else None}
            killed, _ = attempt(kind, out, **words)
            if killed:
                done[how] += 1
            else:
                done["ends"] += 1
                done["differ"] += kind.bits(out) != whole
                out.rename(place / f"done-{done['ends']}")
        print("|", " | ".join(map(str, (which, writes, *done.values()))), "|", flush=True)
        return done["differ"] > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
