"""Networks as C: every spike and every state of the emulated chip in every step, on this computer and on a Cortex-M4.

Few networks here; `make test-c` has 500, and compiles them by clang, too.
"""

import ctypes
import dataclasses
import os
import re
import resource
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
from golden_traces import stored, unpacked
from neuro.chips import chip as known_chip, quantise
from neuro.cli.commands import app
from neuro.program.backend import Trial
from neuro_exchange.c_code.export import _digest
from neuro_exchange.c_code.source import source_of
from random_c import STEPS, random_deferred, random_learner, random_network
from refused import mistakes_of, refused


def pair(before: int, after: int, rule=None, weight: float = 8.0, delay: float = 1.0, **words) -> neuro.Network:
    """Inputs, and neurons that sum what comes from them."""
    net = neuro.Network("pair", resolution=1.0)
    net.population("in", before, neuro.spike_generator())
    words = {"E_L": 0.0, "V_reset": 0.0, "V_th": 1.0, "t_ref": 0.0} | words
    net.population("out", after, neuro.iaf_psc_delta(**words))
    net.connect("in", "out", rule or neuro.all_to_all(), weight=weight, delay=delay)
    return net


TEXTS = {name: Path(__file__).with_name(f"{name}.c").read_text() for name in ("uart", "fuzz")}
"""A main function for a microcontroller of AVR that prints what MAIN returns, and one that sends any events."""

NETWORKS = int(os.environ.get("NEURO_C_NETWORKS", "2"))
"""Random networks of each chip."""
WHOLE = "NEURO_C_NETWORKS" in os.environ
CHIPS = ("loihi", "loihi2", "spinnaker")
each_chip = pytest.mark.parametrize("chip", CHIPS)
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-DNEURO_DIGEST", "-DNEURO_NO_MAIN"]
SANITIZERS = ["-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
M4 = ["-mcpu=cortex-m4", "-mthumb", "-O2", "--specs=rdimon.specs"]
QEMU = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
QEMU += ["-semihosting-config", "enable=on,target=native", "-kernel"]


def needs(*programs: str) -> None:
    """Skip without a program of Debian."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def save(net: neuro.Network, folder: Path, **words) -> neuro.CCode:
    with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):
        return neuro.save_c(net, folder, **words)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> list[neuro.CCode]:
    """Random networks of all chips, those of Loihi that learn by dopamine, and those of SpiNNaker that learn."""
    place = tmp_path_factory.mktemp("c")
    nets = [(f"{chip}_{k}", chip, k, random_network(k, chip)) for k in range(NETWORKS) for chip in CHIPS]
    nets += [(f"learner_{k}", "loihi", k, random_learner(k)) for k in range(2 * NETWORKS)]
    nets += [(f"deferred_{k}", "spinnaker", k, random_deferred(k)) for k in range(2 * NETWORKS)]
    words = {"duration": float(STEPS)}
    return [save(net, place / name, chip=chip, name=name, seed=k, **words) for name, chip, k, net in nets]


def build(compiler: list[str], written: list[neuro.CCode], place: Path, *more: str) -> Path:
    """One program that runs the tests of all networks."""
    calls = "\n".join(f"    failed += {each.name}_test();" for each in written)
    heads = "\n".join(f"int {each.name}_test(void);" for each in written)
    main = place / "all.c"
    main.write_text(f"{heads}\nint main(void)\n{{\n    int failed = 0;\n{calls}\n    return failed;\n}}\n")
    files = [str(each.folder / f"{each.name}{end}") for each in written for end in (".c", "_test.c")]
    run(*compiler, *STRICT, *files, str(main), *more, "-o", str(place / "all"))
    return place / "all"


def board(written: list[neuro.CCode]) -> list[str]:
    """What starts a program on the board that QEMU emulates."""
    folder = written[0].folder
    return [str(folder / "m4.c"), "-T", str(folder / "m4.ld")]


def run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=3600)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout + done.stderr


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_random_networks_equal_the_emulator(written: list[neuro.CCode], compiler: str, tmp_path: Path):
    needs(compiler)
    if compiler == "clang" and not WHOLE:
        pytest.skip("make test-c compiles by clang, too")
    told = run(str(build([compiler, *SANITIZERS], written, tmp_path)))
    assert told.count("steps equal") == len(written)


def test_random_networks_equal_the_emulator_on_a_cortex_m4(written: list[neuro.CCode], tmp_path: Path):
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    told = run(*QEMU, str(build(["arm-none-eabi-gcc", *M4], written, tmp_path, *board(written))))
    assert told.count("steps equal") == len(written)


def test_the_sizes_that_are_told_are_those_of_a_cortex_m4(written: list[neuro.CCode], tmp_path: Path):
    needs("arm-none-eabi-gcc", "arm-none-eabi-size")
    for each in written if WHOLE else [*written[:4], *written[-2:]]:
        built = str(tmp_path / "net.o")
        run("arm-none-eabi-gcc", *M4, "-c", str(each.folder / f"{each.name}.c"), "-o", built)
        text, data, bss = map(int, run("arm-none-eabi-size", built).splitlines()[1].split()[:3])
        assert data == 0
        assert each.flash < text <= each.flash + each.code
        assert each.ram - 3 * each.ram // 4 < bss <= each.ram


def test_random_networks_do_fire(written: list[neuro.CCode]):
    assert sum(each.output_spikes > 10 for each in written) > len(written) / 2


SLOW = ["demo_digits", "remus", "dense", "recurrent", "learnt_delays", "drone", "sigma"]
SHIPPED = ["conv", *(SLOW if WHOLE else [])]
NOT_ON = {("drone", "loihi2"), ("sigma", "loihi"), ("sigma", "spinnaker")}
"""No refractory period on Loihi 2, graded spikes on no other chip."""


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> list[neuro.CCode]:
    place, models = tmp_path_factory.mktemp("shipped"), Path(neuro.__file__).parents[1] / "models" / "neuro_models"
    nets = {name: neuro.load(models / f"{name}.yaml") for name in SHIPPED}
    pairs = [(name, chip, f"{name}_{chip}") for name in SHIPPED for chip in CHIPS if (name, chip) not in NOT_ON]
    return [save(nets[name], place / as_, name=as_, chip=chip, frozen=True) for name, chip, as_ in pairs]


def test_shipped_networks_equal_the_emulator(shipped: list[neuro.CCode], tmp_path: Path):
    for compiler in ("gcc", "clang") if WHOLE else ("gcc",):
        needs(compiler)
        assert run(str(build([compiler, *SANITIZERS], shipped, tmp_path))).count("steps equal") == len(shipped)
    assert all(each.output_spikes for each in shipped)


def test_shipped_networks_equal_the_emulator_on_a_cortex_m4(shipped: list[neuro.CCode], tmp_path: Path):
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    for chip in CHIPS:  # the board's flash does not hold all
        some = [each for each in shipped if each.name.endswith(f"_{chip}")]
        program = build(["arm-none-eabi-gcc", *M4], some, tmp_path, *board(some))
        assert run(*QEMU, str(program)).count("steps equal") == len(some)


def test_the_folder_tests_itself_and_counts_instructions(tmp_path: Path):
    needs("gcc", "make")
    digits = Path(neuro.__file__).parents[1] / "models" / "neuro_models" / "demo_digits.yaml"
    result = CliRunner().invoke(app, ["convert", str(digits), str(tmp_path / "out"), "--to", "c", "--ram", "1K"])
    assert result.exit_code == 0, result.output
    assert "bytes: tables 111,456, code at most" in result.output
    assert "RAM    at most 788 bytes" in result.output
    assert "100 steps equal" in run("make", "-s", "-C", str(tmp_path / "out"), "test")
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    told = run("make", "-s", "-C", str(tmp_path / "out"), "m4")
    assert (counted := re.search(r"(\d+) instructions per step", told)), told
    assert 30_000 < int(counted[1]) < 60_000


class Loaded:
    """A network in C, called from here."""

    def __init__(self, code: neuro.CCode) -> None:
        library = code.folder / "net.so"
        source = code.folder / f"{code.name}.c"
        run("gcc", "-std=c99", "-O1", "-fPIC", "-shared", "-DNEURO_DIGEST", str(source), "-o", str(library))
        self._library = ctypes.CDLL(str(library))
        self._library.net_digest.restype = ctypes.c_uint64
        neuron = np.uint16 if "typedef uint16_t net_neuron" in source.with_suffix(".h").read_text() else np.uint32
        fields = [("neuron", neuron), ("number", np.int32 if "Loihi 2" in code.chip else np.uint16)]
        self._event = np.dtype(fields, align=True)
        self._out = np.zeros(4096, self._event)
        self.init()

    def init(self) -> None:
        self._library.net_init()

    def step(self, *events: tuple[int, int]) -> list[tuple[int, int]]:
        sent = np.array(list(events), self._event)
        n = self._library.net_step(
            sent.ctypes.data_as(ctypes.c_void_p), len(sent), self._out.ctypes.data_as(ctypes.c_void_p)
        )
        return self._out[:n].tolist()

    def reward(self, values: np.ndarray, of: str = "") -> None:
        getattr(self._library, f"net_reward{of}")(values.astype(np.int32).ctypes.data_as(ctypes.c_void_p))

    def weights(self, size: int, of: str = "") -> np.ndarray:
        call = getattr(self._library, f"net_weights{of}")
        call.restype = ctypes.POINTER(ctypes.c_int16)
        return np.ctypeslib.as_array(call(), (size,))

    def trial(self) -> None:
        self._library.net_trial()

    def digest(self) -> int:
        return self._library.net_digest(ctypes.byref(ctypes.c_uint64()))

    def voltage(self, neuron: int) -> int:
        return self._library.net_voltage(neuron)


def one(chip: str, tmp_path: Path) -> Loaded:
    return Loaded(save(pair(3, 1, weight=4.0, V_th=20.0, tau_m=float("inf")), tmp_path / chip, chip=chip))


def of_winners() -> neuro.Network:
    net = small()
    net.population("maps", (2, 3, 3), neuro.iaf_psc_exp(tau_syn_ex=5.0, tau_syn_in=5.0))
    net.group("choice", neuro.local_winners(of="maps", radius=1))
    return net


def probed(of: str, record: str) -> neuro.Network:
    net = small()
    net.probe("seen", of, record)
    return net


def test_an_input_that_comes_twice_in_a_step_is_one_spike_where_spikes_are_bits(tmp_path: Path):
    needs("gcc")
    for chip, times in (("loihi", 1), ("loihi2", 2), ("spinnaker", 2)):
        net, voltages = one(chip, tmp_path), []
        for events in ([(1, 1)], [(1, 1), (1, 1)], [(1, 2)], [(3, 1), (4, 1), (65535, 1), (0, 0)]):
            net.init()
            net.step(*events)
            net.step()
            voltages.append(net.voltage(3))
        assert voltages[0] > 0
        assert voltages[1:] == [times * voltages[0]] * 2 + [0]
        assert net.voltage(70000) == 0


@each_chip
def test_trials_begin_as_on_the_emulator(chip: str, tmp_path: Path):
    """A trial begins while spikes are under way, neurons are refractory and the group is closed."""
    needs("gcc")
    models = Path(neuro.__file__).parents[1] / "models" / "neuro_models"
    net = neuro.load(models / "remus.yaml").frozen()
    code = Loaded(save(net, tmp_path, chip=chip))
    with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):
        sim = neuro.compile(net, chip)
    engine, source = sim._engine, source_of(quantise(sim.program, known_chip(chip)), "net", ("s2",))
    draws, sizes = np.random.default_rng(1), [part.size for part in sim.program.populations]
    fired = 0
    for _ in range(6):
        ticks, ids = np.nonzero(draws.random((12, sizes[0])) < 0.05)
        engine._trials._began = engine.step  # as `present` does, which runs a whole trial
        engine._trials._begin(Trial(ticks, ids, np.zeros(sim.program.trials.maps, dtype=bool)))
        code.trial()
        for tick in range(12):
            engine.run(1)
            fired += len(code.step(*((int(k), 1) for k in ids[ticks == tick])))
            assert code.digest() == int(_digest(sim, source))
    assert fired > 3


def small(**words) -> neuro.Network:
    net = neuro.Network("small", resolution=1.0)
    net.population("in", 3, neuro.spike_generator())
    net.population("cells", 2, neuro.iaf_psc_exp(tau_syn_ex=5.0, tau_syn_in=5.0, **words))
    net.connect("in", "cells", neuro.all_to_all(), weight=400.0, delay=1.0, name="wires")
    return net


def with_current() -> neuro.Network:
    net = small()
    net.population("drive", 1, neuro.dc_generator(amplitude=100.0))
    net.connect("drive", "cells", neuro.all_to_all(), weight=1.0, delay=1.0)
    return net


def that_learns(**words) -> neuro.Network:
    net = small()
    if words:
        net.signal("reward", to="cells", values=words.pop("values", None))
    rule = neuro.stdp_dopa(signal="reward", Wmax=400.0, **words) if words else neuro.stddp(d_max=9.0)
    net.connect("in", "cells", neuro.all_to_all(), rule, weight=200.0, delay=1.0, name="learns")
    return net


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("chip", ["loihi", "spinnaker"])
def test_rewards_change_weights_as_on_the_emulator(chip: str, tmp_path: Path):
    """Values of all sizes: each is rounded to the unit of the trace, or to the level, of the emulator."""
    needs("gcc")
    words = {"loihi": {"A_plus": 20.0, "A_minus": 10.0}, "spinnaker": {"A_plus": 0.3, "A_minus": 0.13, "c_min": 0.0}}
    net = that_learns(**words[chip], tau_c=50.0)
    other = neuro.stdp_dopa(signal="reward", Wmax=90.0, A_plus=9.0)
    other = other if chip == "loihi" else net.projections["learns"].synapse  # a population has one rule there
    net.connect("cells", "cells", neuro.all_to_all(), other, weight=50.0, delay=6.0)
    largest = {} if chip == "loihi" else {"signals": {"learns": 1.0, "cells_cells": 1.0}}
    code = Loaded(save(net, tmp_path, chip=chip, **largest))
    with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):
        sim = neuro.compile(net, chip, **largest)
    # Whole numbers of 1/ms are as near to two levels where this unit is even.
    assert chip == "loihi" or "static const tie" in (tmp_path / "net.c").read_text()
    one = int(re.search(r"NET_REWARD_ONE (\d+)", (tmp_path / "net.h").read_text())[1])
    draws, names = np.random.default_rng(5), {"learns": "_learns", "cells_cells": "_cells_cells"}
    first = {name: sim.get(name, "weight", raw=True) for name in names}
    often = 3 if chip == "loihi" else 17  # SpiNNaker's weights do not move between events of less than 4 ticks
    for step in range(400):
        if step % often == 0:
            values = np.rint(one * draws.choice([-1.0, 1.0], 2) * 10.0 ** draws.uniform(-4.0, 1.0, 2))
            values = values if step % 2 else one * draws.integers(-2, 3, 2)
            values = values if step else np.array([-(2.0**31), 2.0**31 - 1.0])
            code.reward(values)
            sim.signal("reward", values / one)
        ids = np.flatnonzero(draws.random(3) < 0.2)
        sim.inject("in", np.full(ids.size, step + 1.0), ids)
        sim.run(1.0)
        code.step(*((int(k), 1) for k in ids))
        for name, of in names.items():
            weights = code.weights(first[name].size, of).view(np.uint16)
            assert np.array_equal(weights, sim.get(name, "weight", raw=True)), step
    for name, of in names.items():
        assert (code.weights(first[name].size, of).view(np.uint16) != first[name]).all()


def test_the_program_of_the_page_learns_on_a_cortex_m4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    needs("arm-none-eabi-gcc", "qemu-system-arm", "make")
    monkeypatch.chdir(tmp_path)
    page = (Path(neuro.__file__).parents[1] / "docs" / "how-to" / "run-on-a-microcontroller.md").read_text()
    section = page.split("## Learn from rewards\n")[1].split("\n## ")[0]
    blocks = dict(re.findall(r"^```(\w+)\n(.*?)^```$", section, re.M | re.S))
    Path("steer.yaml").write_text(blocks["yaml"])
    exec(blocks["python"], {"neuro": neuro, "warnings": warnings})
    Path("steer/main.c").write_text(blocks["c"])
    printed = run("make", "-s", "-C", "steer", "m4", "TEST=main.c")
    assert printed == blocks["console"].split("main.c\n")[1]


@pytest.mark.filterwarnings("ignore::neuro.OverflowWarning")
def test_the_drone_learns_from_a_flight_as_on_the_emulator(tmp_path: Path):
    """A run whose rates and rewards change every 50 ms, recorded, is shown to the program in C."""
    needs("gcc")
    net = neuro.load(Path(neuro.__file__).parents[1] / "models" / "neuro_models" / "drone.yaml")
    net.probe("flown", "cells", "spikes")
    words, draws, flight = {"signals": {"cells_motors": 0.1}}, np.random.default_rng(2), 50 * np.arange(30)
    with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):
        sim = neuro.compile(net, "loihi", **words)
    rewards = np.rint(2.0**16 * draws.uniform(-0.1, 0.1, (flight.size, 4))) / 2.0**16
    for reward in rewards:
        sim.set("cells", rate=draws.uniform(0.0, 100.0, 64))
        sim.signal("dopamine", reward)
        sim.run(50.0)
    given = {"cells": sim.spikes("cells"), "dopamine": (flight, rewards)}
    code = save(net, tmp_path, given=given, duration=1500.0, **words)
    assert code.input_spikes == given["cells"][0].size
    assert "1500 steps equal" in run("make", "-s", "-C", str(tmp_path), "test")
    replayed, at = Loaded(code), given["cells"][0].astype(int)
    for step in range(1500):
        if step % 50 == 0:
            replayed.reward(2.0**16 * rewards[step // 50])
        replayed.step(*((int(k), 1) for k in given["cells"][1][at == step + 1]))
    learnt = sim.get("cells_motors", "weight", raw=True)
    assert np.array_equal(replayed.weights(256), learnt)
    assert (learnt != learnt[0]).any()


def test_what_is_learnt_outlives_a_beginning(tmp_path: Path):
    needs("gcc")
    code = Loaded(save(that_learns(A_plus=20.0), tmp_path))
    weights = code.weights(6)
    learnt = weights - 20
    weights[:] = learnt
    code.init()
    assert (weights != learnt).all()
    weights[:] = learnt
    code.step((0, 1))
    assert (weights == learnt).all()


def test_what_sets_a_signal_is_left_to_the_caller(tmp_path: Path):
    """The unit of dopamine is that of the values in the description."""
    net = that_learns(tau_n=200.0, values=neuro.schedule(times=[3.0], values=[0.5]))
    given = {"reward": ([0, 7], [[0.5, -0.1], [0.25, 0.0]]), "in": ([1], [0])}
    code = save(net, tmp_path / "described", given=given, duration=20.0)
    told = save(that_learns(tau_n=200.0), tmp_path / "told", given=given, duration=20.0, signals={"learns": 0.5})
    assert code.rewards == told.rewards == 2
    texts = [(each.folder / "net.c").read_text().split("\n", 1)[1] for each in (code, told)]
    assert texts[0] == texts[1]
    needs("gcc", "make")
    assert "20 steps equal" in run("make", "-s", "-C", str(code.folder), "test")


def test_a_rule_that_is_left_out_leaves_the_weights(tmp_path: Path):
    net = that_learns(tau_n=200.0)
    assert save(net, tmp_path, frozen=True).ram == save(small(), tmp_path / "static").ram
    assert net.projections["learns"].synapse.learns


def test_what_cannot_be_is_refused(tmp_path: Path, messages):
    out = tmp_path / "out"
    messages.calls(globals() | locals())
    assert not out.exists()


def test_files_of_others_and_edited_ones_stay(tmp_path: Path):
    save(small(), tmp_path)
    save(small(t_ref=3.0), tmp_path)
    with (tmp_path / "net.c").open("a") as code:
        code.write("/* mine */\n")
    before = (tmp_path / "net.h").read_bytes()
    with pytest.raises(neuro.ModelError, match="exists and is not a file of C of neuro, as it was written"):
        save(small(), tmp_path)
    assert (tmp_path / "net.h").read_bytes() == before


def test_the_files_are_replaced_together(tmp_path: Path):
    save(small(), tmp_path)
    complete = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(complete["net_run.h"]) - 1, before[1]))
    try:
        with pytest.raises(neuro.ModelError, match=r"net_run\.h: cannot be written: File too large$"):
            save(small(tau_m=30.0), tmp_path, duration=2000.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == complete


def test_options_of_the_command(answer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages):
    monkeypatch.chdir(tmp_path)
    small().save("net.yaml")
    messages(mistakes_of(answer, messages.cases))


def test_a_recording_is_the_input_of_the_test(tmp_path: Path):
    t, x, y, p = np.array([[0, 900, 2500], [0, 1, 1], [0, 0, 1], [0, 1, 1]])
    events = neuro.events.Events(t, x, y, p, (2, 2))
    neuro.events.save(events, tmp_path / "small.npz")
    net = neuro.Network("seen", resolution=1.0)
    net.population("pixels", (2, 2, 2), neuro.spike_generator())
    net.population("out", 1, neuro.iaf_psc_delta())
    net.connect("pixels", "out", neuro.all_to_all(), weight=30.0, delay=1.0)
    net.save(tmp_path / "net.yaml")
    words = ["--to", "c", "--recording", str(tmp_path / "small.npz"), "--for", "9"]
    result = CliRunner().invoke(app, ["convert", str(tmp_path / "net.yaml"), str(tmp_path / "out"), *words])
    assert result.exit_code == 0, result.output
    assert "9 steps: 3 input spikes" in result.output


def digits(**words) -> neuro.Network:
    net = neuro.Network("digits", resolution=1.0)
    for name in words.pop("names", ("in", "out")):
        net.population(name, 2, neuro.spike_generator() if not net.populations else neuro.iaf_psc_delta(t_ref=0.0))
    first, *others = net.populations
    for name in others:
        net.connect(first, name, neuro.all_to_all(), weight=9.0, delay=1.0)
    return net


def compiles(code: neuro.CCode, *more: str, compiler: str = "gcc") -> None:
    files = [f"{code.name}.c", f"{code.name}_test.c"]
    run(compiler, *STRICT, *more, "-fsyntax-only", *(str(code.folder / file) for file in files))


def test_names_that_mean_something_to_compilers(tmp_path: Path):
    needs("gcc")
    for name in ("int", "neuro", "neuro_loihi", "neuro_integers", "neuro_digest", "class", "errno", "e"):
        compiles(save(digits(), tmp_path / name, name=name))


def test_names_of_populations_that_are_equal_in_capitals(tmp_path: Path):
    needs("gcc")
    code = save(digits(names=("in", "a_2", "a", "A", "ä", "int", "while", "a.b", "h")), tmp_path)
    compiles(code)
    words = re.findall(r"NET_FIRST_(\w+)", (tmp_path / "net.h").read_text())
    assert len(set(words)) == len(words) == 9


@each_chip
def test_limits_of_memory_are_those_of_the_report(chip: str, tmp_path: Path):
    code = save(digits(), tmp_path, chip=chip)
    flash = code.flash + code.code
    assert save(digits(), tmp_path, chip=chip, ram=code.ram, flash=flash).ram == code.ram
    with pytest.raises(neuro.ModelError, match="RAM: "):
        save(digits(), tmp_path, chip=chip, ram=code.ram - 1)
    with pytest.raises(neuro.ModelError, match="flash: "):
        save(digits(), tmp_path, chip=chip, flash=flash - 1)


def test_files_of_two_networks_do_not_compile(tmp_path: Path):
    """As they lie there when writing was interrupted, or one of them was copied into firmware."""
    needs("gcc")
    code, other = save(digits(), tmp_path / "one"), save(small(), tmp_path / "two")
    for file in ("net.c", "net_run.h"):
        before = (code.folder / file).read_bytes()
        (code.folder / file).write_bytes((other.folder / file).read_bytes())
        with pytest.raises(AssertionError, match=r"net\.h is of another network"):
            compiles(code)
        (code.folder / file).write_bytes(before)
    compiles(code)


def test_the_length_of_a_step_is_not_rounded_to_microseconds(tmp_path: Path):
    net = digits()
    net.resolution = 0.0625
    net.projections["in_out"] = dataclasses.replace(net.projections["in_out"], delay=0.125)
    save(net, tmp_path)
    assert "#define NET_STEP_NS 62500u" in (tmp_path / "net.h").read_text()


def test_steps_are_counted_beyond_32_bits(tmp_path: Path):
    needs("gcc")
    net = neuro.Network("reset", resolution=1.0)
    net.population("out", 1, neuro.loihi2_lif(du=4095, dv=0, bias_mant=1, reset_interval=7, reset_offset=2))
    save(net, tmp_path, chip="loihi2")
    steps = 2**32 + 100
    main = f'#include "net.c"\nint main(void) {{ net_event out[1]; net_init(); now = UINT64_C({steps // 7 * 7 + 1});'
    main += "for (int k = 0; k < 14; k++) { net_step(NULL, 0, out); if (net_voltage(0) != k % 7 + 1) return 1; }"
    main += " return 0; }"
    (tmp_path / "main.c").write_text(main)
    run("gcc", "-std=c99", str(tmp_path / "main.c"), "-o", str(tmp_path / "main"))
    run(str(tmp_path / "main"))


@each_chip
def test_more_neurons_than_16_bits_count(chip: str, tmp_path: Path):
    needs("gcc")
    written = save(pair(70_000, 70_000, neuro.one_to_one()), tmp_path, chip=chip, duration=3.0)
    compiles(written)
    code = Loaded(written)
    code.step((69_999, 1), (0, 1), (66_000, 1), (2**32 - 1, 1))
    assert code.step() == [(70_000, 1), (136_000, 1), (139_999, 1)]


@pytest.mark.parametrize(("chip", "longest"), [("loihi", 63.0), ("loihi2", 64.0), ("spinnaker", 144.0)])
def test_the_longest_delay(chip: str, longest: float, tmp_path: Path):
    needs("gcc")
    code = Loaded(save(pair(1, 1, delay=longest), tmp_path, chip=chip))
    code.step((0, 1))
    assert [k for k in range(1, 300) if code.step()] == [int(longest)]


@pytest.mark.parametrize("level", ["-O2", "-O3"])
@pytest.mark.parametrize("choice", [neuro.lateral_reset(of="out"), neuro.winner_take_all(of="out")])
def test_a_neuron_without_rivals(choice, level: str, tmp_path: Path):
    needs("gcc")
    net = digits()
    net.population("alone", 1, neuro.iaf_psc_delta(t_ref=2.0))
    net.connect("in", "alone", neuro.all_to_all(), weight=9.0, delay=1.0)
    net.group("choice", dataclasses.replace(choice, of="alone"))
    code = save(net, tmp_path)
    assert code.output_spikes
    files = [str(tmp_path / file) for file in ("net.c", "net_test.c")]
    run("gcc", *STRICT[:-1], level, *files, "-o", str(tmp_path / "net"))
    assert "steps equal" in run(str(tmp_path / "net"))


def test_headers_and_programs_in_cpp(tmp_path: Path):
    needs("g++")
    save(digits(), tmp_path, chip="loihi2")
    (tmp_path / "main.cpp").write_text('#include "net.h"\nint main() { net_init(); return (int)net_voltage(0); }\n')
    run("g++", "-std=c++98", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", str(tmp_path / "main.cpp"))


WARNINGS = ["-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wcast-qual", "-Wundef", "-Wmissing-prototypes", "-O2"]


def test_strict_compilers_find_nothing(written: list[neuro.CCode]):
    needs("gcc")
    for each in written:
        compiles(each, *WARNINGS)


@pytest.mark.parametrize("level", ["-O0", "-O2", "-O3", "-Os"])
def test_any_optimisation_is_equal(written: list[neuro.CCode], level: str, tmp_path: Path):
    needs("gcc")
    if level == "-O0" or WHOLE:
        assert run(str(build(["gcc", level], written, tmp_path))).count("steps equal") == len(written)


def test_a_network_that_begins_with_neurons_and_has_no_inputs(tmp_path: Path):
    needs("gcc")
    net = neuro.Network("driven", resolution=1.0)
    net.population("out", 3, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=5.0, t_ref=0.0, I_e=500.0))
    code = save(net, tmp_path)
    compiles(code)
    assert code.output_spikes > 9


@each_chip
def test_more_synapses_than_16_bits_count(chip: str, tmp_path: Path):
    needs("gcc")
    net = pair(80, 900, neuro.fixed_indegree(75), V_th=50.0)
    compiles(save(net, tmp_path, chip=chip, duration=9.0), *WARNINGS)


def biased(net: neuro.Network, **bias: np.ndarray) -> neuro.Network:
    """A network of lava-dl with an input, which it takes as the bias of its first layer."""
    first = net.populations["input"]
    net.populations["input"] = dataclasses.replace(first, model=dataclasses.replace(first.model, **bias))
    return net


def test_pilotnet_sdnn_in_c_is_that_of_intels_test(tmp_path: Path):
    needs("gcc")
    if not WHOLE:
        pytest.skip("make test-c compiles its 9 MB")
    golden = stored("pilotnet_sdnn")
    net = biased(unpacked(golden, tmp_path), bias=golden["image"].astype(float))
    code = Loaded(save(net, tmp_path, chip="loihi2", duration=float(golden["s"].size)))
    assert [sum(payload for _, payload in code.step()) for _ in golden["s"]] == golden["s"].tolist()
    assert run("make", "-s", "-C", str(tmp_path), "test").count("9 steps equal")


def test_tinynet_in_c_is_that_of_intels_test(tmp_path: Path):
    needs("gcc")
    golden = stored("tinynet")
    net = biased(unpacked(golden, tmp_path), bias_mant=golden["bias"].astype(float))
    code, first = Loaded(save(net, tmp_path, chip="loihi2", duration=17.0)), 768 + 864
    found = np.zeros((17, golden["s"].shape[1]), dtype=np.int64)
    for step in range(17):
        for neuron, payload in code.step():
            found[step, neuron - first] = payload
    assert np.array_equal(found[2:], golden["s"])


def test_a_network_is_equal_where_an_int_has_16_bits(tmp_path: Path):
    needs("avr-gcc", "simavr")
    net = pair(40, 40, neuro.fixed_indegree(20), V_th=20.0)
    net.connect("out", "out", neuro.fixed_indegree(2), weight=-9.0, delay=neuro.uniform(low=1.0, high=5.0))
    for chip in CHIPS:
        code = save(net, tmp_path / chip, chip=chip, name="net", duration=60.0)
        (code.folder / "main.c").write_text(TEXTS["uart"].replace("MAIN", "net_test"))
        files = [str(code.folder / file) for file in ("net.c", "net_test.c", "main.c")]
        clock = ["-mmcu=atmega1284p", "-DF_CPU=16000000", "-O2"]
        run("avr-gcc", *STRICT, *WARNINGS[:2], *clock, *files[:1], "-c", "-o", str(code.folder / "net.o"))
        run("avr-gcc", "-std=c99", *STRICT[5:], *clock, *files, "-o", str(code.folder / "net.elf"))
        assert "60 steps equal" in run("simavr", "-m", "atmega1284p", "-f", "16000000", str(code.folder / "net.elf"))


def test_random_networks_equal_the_emulator_where_large_ends_come_first(written: list[neuro.CCode], tmp_path: Path):
    needs("s390x-linux-gnu-gcc", "qemu-s390x")
    if not WHOLE:
        pytest.skip("make test-c runs them there")
    told = run("qemu-s390x", str(build(["s390x-linux-gnu-gcc", "-O2", "-static"], written, tmp_path)))
    assert told.count("steps equal") == len(written)


def test_any_events_are_taken(written: list[neuro.CCode], tmp_path: Path):
    """Neurons of no input, several events of one, in any order, none at all."""
    needs("gcc")
    written = written if WHOLE else written[3:6]
    for each in written:
        field = "payload" if "Loihi 2" in each.chip else "times"
        text = TEXTS["fuzz"].replace("NAME", each.name).replace("UPPER", each.name.upper()).replace("FIELD", field)
        (each.folder / "fuzz.c").write_text(text)
    calls = "".join(f"int {each.name}_fuzz(void);\n" for each in written)
    calls += "int main(void) { return " + " + ".join(f"{each.name}_fuzz()" for each in written) + "; }\n"
    (tmp_path / "main.c").write_text(calls)
    files = [str(each.folder / file) for each in written for file in ("fuzz.c", f"{each.name}.c")]
    run("gcc", *STRICT, *SANITIZERS, *files, str(tmp_path / "main.c"), "-o", str(tmp_path / "fuzz"))
    run(str(tmp_path / "fuzz"))


@each_chip
def test_the_order_of_events_makes_no_difference(chip: str, tmp_path: Path):
    needs("gcc")
    code = Loaded(save(random_network(0, chip), tmp_path, chip=chip, duration=9.0))
    digests: list[list[int]] = [[], []]
    for order, turned in zip((slice(None), slice(None, None, -1)), digests, strict=True):
        code.init()
        draws = np.random.default_rng(3)
        for _ in range(40):
            code.step(*[(int(k), 1) for k in draws.integers(0, 16, 12)][order])
            turned.append(code.digest())
    assert digests[0] == digests[1]


def test_learning_of_loihi_2_is_refused_or_left_out(tmp_path: Path):
    needs("gcc")
    for out, factor in ((neuro.loihi2_lif(du=4095, dv=400, vth=200), 64), (neuro.sigma_decoder(), 1)):
        net = neuro.Network("learns", resolution=1.0)
        net.population("in", 3, neuro.spike_generator())
        net.population("out", 2, out)
        rule = neuro.loihi2_learning(dw="2^-2*x1*y0", x1_impulse=60, x1_tau=4, weight_exp=3)
        net.connect("in", "out", neuro.all_to_all(), rule, weight=12.0, delay=1.0)
        assert "learning of loihi2 is not supported in C" in refused(save, net, tmp_path / "learns", chip="loihi2")
        code = Loaded(save(net, tmp_path / out.name, chip="loihi2", name="net", frozen=True))
        code.step((0, 1))
        code.step()
        assert code.voltage(3) == (12 << 3) * factor
