"""Networks as C: every spike and every state of the emulated chip in every step, on this computer and on a Cortex-M4.

Few networks here; `make test-c` has 200, and compiles them by clang, too.
"""

import ctypes
import os
import re
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
from neuro.chips import chip as known_chip, quantise
from neuro.cli.commands import app
from neuro.exchange.c_code.recorded import _digest, without_learning
from neuro.exchange.c_code.source import source_of
from neuro.program.backend import Trial
from random_c import STEPS, random_network

NETWORKS = int(os.environ.get("NEURO_C_NETWORKS", "3"))
"""Random networks of each chip."""
WHOLE = "NEURO_C_NETWORKS" in os.environ
CHIPS = ("loihi", "spinnaker")
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
    """Random networks of both chips."""
    place = tmp_path_factory.mktemp("c")
    numbered = [(k, chip) for k in range(NETWORKS) for chip in CHIPS]
    words = {"duration": float(STEPS)}
    return [
        save(random_network(k, chip), place / f"{chip}{k}", chip=chip, name=f"{chip}{k}", seed=k, **words)
        for k, chip in numbered
    ]


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
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=600)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


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
    for each in written[:4] if not WHOLE else written:
        built = str(tmp_path / "net.o")
        run("arm-none-eabi-gcc", *M4, "-c", str(each.folder / f"{each.name}.c"), "-o", built)
        text, data, bss = map(int, run("arm-none-eabi-size", built).splitlines()[1].split()[:3])
        assert data == 0
        assert each.flash < text <= each.flash + each.code
        assert each.ram <= bss <= each.ram + 64  # gaps between arrays


def test_random_networks_do_fire(written: list[neuro.CCode]):
    assert sum(each.output_spikes > 10 for each in written) > len(written) / 2


SHIPPED = ["conv", *(["demo_digits", "remus", "dense", "recurrent", "learnt_delays", "drone"] if WHOLE else [])]


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> list[neuro.CCode]:
    place, models = tmp_path_factory.mktemp("shipped"), Path(neuro.__file__).parents[1] / "models" / "neuro_models"
    nets = {name: neuro.load(models / f"{name}.yaml") for name in SHIPPED}
    pairs = [(name, chip, f"{name}_{chip}") for name in SHIPPED for chip in CHIPS]
    return [save(nets[name], place / as_, name=as_, chip=chip, frozen=True) for name, chip, as_ in pairs]


def test_shipped_networks_equal_the_emulator(shipped: list[neuro.CCode], tmp_path: Path):
    for compiler in ("gcc", "clang") if WHOLE else ("gcc",):
        needs(compiler)
        assert run(str(build([compiler, *SANITIZERS], shipped, tmp_path))).count("steps equal") == len(shipped)
    assert all(each.output_spikes for each in shipped)


def test_shipped_networks_equal_the_emulator_on_a_cortex_m4(shipped: list[neuro.CCode], tmp_path: Path):
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    program = build(["arm-none-eabi-gcc", *M4], shipped, tmp_path, *board(shipped))
    assert run(*QEMU, str(program)).count("steps equal") == len(shipped)


def test_the_folder_tests_itself_and_counts_instructions(tmp_path: Path):
    needs("gcc", "make")
    digits = Path(neuro.__file__).parents[1] / "models" / "neuro_models" / "demo_digits.yaml"
    result = CliRunner().invoke(app, ["convert", str(digits), str(tmp_path / "out"), "--to", "c", "--ram", "1K"])
    assert result.exit_code == 0, result.output
    assert "bytes: tables 111,456, code at most" in result.output
    assert "RAM    762 bytes" in result.output
    assert "100 steps equal" in run("make", "-s", "-C", str(tmp_path / "out"), "test")
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    told = run("make", "-s", "-C", str(tmp_path / "out"), "m4")
    assert (counted := re.search(r"(\d+) instructions a step", told)), told
    assert 30_000 < int(counted[1]) < 60_000


class Loaded:
    """A network in C, called from here."""

    def __init__(self, code: neuro.CCode) -> None:
        library = code.folder / "net.so"
        source = str(code.folder / f"{code.name}.c")
        run("gcc", "-std=c99", "-O1", "-fPIC", "-shared", "-DNEURO_DIGEST", source, "-o", str(library))
        self._library = ctypes.CDLL(str(library))
        self._library.net_digest.restype = ctypes.c_uint64
        self._out = np.zeros((4096, 2), dtype=np.uint16)
        self.init()

    def init(self) -> None:
        self._library.net_init()

    def step(self, *events: tuple[int, int]) -> list[tuple[int, int]]:
        sent = np.array(events, dtype=np.uint16).reshape(-1, 2)
        n = self._library.net_step(
            sent.ctypes.data_as(ctypes.c_void_p), len(sent), self._out.ctypes.data_as(ctypes.c_void_p)
        )
        return [tuple(row) for row in self._out[:n].tolist()]

    def trial(self) -> None:
        self._library.net_trial()

    def digest(self) -> int:
        return self._library.net_digest(ctypes.byref(ctypes.c_uint64()))

    def voltage(self, neuron: int) -> int:
        return self._library.net_voltage(neuron)


def one(chip: str, tmp_path: Path) -> Loaded:
    net = neuro.Network("one", resolution=1.0)
    net.population("in", 3, neuro.spike_generator())
    net.population("cell", 1, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=20.0, tau_m=float("inf"), t_ref=0.0))
    net.connect("in", "cell", neuro.all_to_all(), weight=4.0, delay=1.0)
    return Loaded(save(net, tmp_path / chip, chip=chip))


@pytest.mark.parametrize(("chip", "times"), [("loihi", 1), ("spinnaker", 2)])
def test_an_input_that_comes_twice_in_a_step_is_one_spike_where_spikes_are_bits(chip: str, times: int, tmp_path: Path):
    needs("gcc")
    net = one(chip, tmp_path)
    found = []
    for events in ([(1, 1)], [(1, 1), (1, 1)], [(1, 2)]):
        net.init()
        net.step(*events)
        net.step()
        found.append(net.voltage(3))
    assert found[0] > 0
    assert found[1:] == [times * found[0]] * 2


@pytest.mark.parametrize("chip", CHIPS)
def test_events_of_no_input_are_passed_over(chip: str, tmp_path: Path):
    needs("gcc")
    net = one(chip, tmp_path)
    net.step((3, 1), (4, 1), (65535, 1), (0, 0))
    net.step()
    assert net.voltage(3) == 0
    assert net.voltage(70000) == 0


@pytest.mark.parametrize("chip", CHIPS)
def test_trials_begin_as_on_the_emulator(chip: str, tmp_path: Path):
    """A trial begins while spikes are under way, neurons are refractory and the group is closed."""
    needs("gcc")
    models = Path(neuro.__file__).parents[1] / "models" / "neuro_models"
    net = without_learning(neuro.load(models / "remus.yaml"))
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
        net.signal("reward", to="cells")
    rule = neuro.stdp_dopa(signal="reward", Wmax=400.0) if words else neuro.stddp(d_max=9.0)
    net.connect("in", "cells", neuro.all_to_all(), rule, weight=200.0, delay=1.0, name="learns")
    return net


def with_winners() -> neuro.Network:
    net = small()
    net.population("maps", (2, 3, 3), neuro.iaf_psc_exp(tau_syn_ex=5.0, tau_syn_in=5.0))
    net.group("choice", neuro.local_winners(of="maps", radius=1))
    return net


def with_probes(record: str, of: str) -> neuro.Network:
    net = small()
    net.probe("seen", of, record)
    return net


REFUSED = [
    (with_current, "population 'drive': dc_generator: the host writes its current", "I_e"),
    (
        lambda: that_learns(by="dopamine"),
        "projection 'learns': stdp_dopa: the program in C has no dopamine",
        "--frozen",
    ),
    (that_learns, "projection 'learns': stddp: the host applies the rule", "--frozen"),
    (with_winners, "group 'choice': competition is not written as C", "use winner_take_all"),
    (lambda: with_probes("I_syn_ex", "cells"), "probe 'seen': I_syn_ex: the program in C keeps no record", "spikes"),
    (lambda: with_probes("weight", "wires"), "probe 'seen': weight: the program in C keeps no record", "spikes"),
]


@pytest.mark.parametrize(("make", "message", "hint"), REFUSED)
def test_what_cannot_be_written_is_refused(make, message: str, hint: str, tmp_path: Path):
    with pytest.raises(neuro.ModelError) as found:
        save(make(), tmp_path / "out")
    assert "network 'small' cannot be written as C (1 problem)" in str(found.value)
    assert message in str(found.value)
    assert hint in found.value.others[0].hint
    assert not (tmp_path / "out").exists()


def test_a_rule_that_is_left_out_leaves_the_weights(tmp_path: Path):
    net = that_learns(by="dopamine")
    assert save(net, tmp_path, frozen=True).ram == save(small(), tmp_path / "static").ram
    assert net.projections["learns"].synapse.learns


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"chip": "cpu"}, "chip 'cpu' cannot be written as C: expected the arithmetic of loihi or spinnaker"),
        ({"chip": "lohi"}, "lohi"),
        ({"name": "Net"}, "name = 'Net': expected small letters, digits and _, as in 'net'"),
        ({"ram": 20}, "RAM: network 'small' takes 39 bytes: expected at most 20"),
        ({"flash": 20}, "flash: network 'small' takes "),
        ({"ram": -1}, "ram = -1"),
        ({"duration": 0.5}, "duration = 0.5 ms: expected a multiple of the resolution, 1 ms"),
        ({"given": {"inn": (np.ones(1), np.zeros(1))}}, "unknown input 'inn'\n  hint: did you mean 'in'?"),
    ],
)
def test_what_cannot_be_is_refused(words, message: str, tmp_path: Path):
    with pytest.raises(neuro.ModelError, match=re.escape(message)):
        save(small(), tmp_path / "out", **words)
    assert not (tmp_path / "out").exists()


def test_files_of_others_and_edited_ones_stay(tmp_path: Path):
    save(small(), tmp_path)
    save(small(t_ref=3.0), tmp_path)
    with (tmp_path / "net.c").open("a") as code:
        code.write("/* mine */\n")
    before = (tmp_path / "net.h").read_bytes()
    with pytest.raises(neuro.ModelError, match="exists and is not a file of C of neuro, as it was written"):
        save(small(), tmp_path)
    assert (tmp_path / "net.h").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["out", "--to", "d"], "--to d: expected c"),
        (["out.yaml", "--ram", "64K"], "--ram: has no use from net.yaml to out.yaml: expected --to c"),
        (["out", "--to", "c", "--ram", "64Q"], "'64Q': expected a number of bytes"),
        (["out", "--to", "c", "--resolution", "1"], "--resolution: has no use from net.yaml to out"),
        (["out"], "out: cannot be written: expected a name ending in .json, .nir, .py, .yaml, .yml"),
    ],
)
def test_options_of_the_command(words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    small().save("net.yaml")
    result = CliRunner().invoke(app, ["convert", "net.yaml", *words])
    assert result.exit_code != 0
    assert message in f"{result.output}{result.exception}"


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
    assert "9 steps: 3 spikes of inputs" in result.output
