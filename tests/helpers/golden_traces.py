"""Golden traces: results that our own run gave when it was compared with other simulators, `tests/golden`.

| folder | reference | form |
| --- | --- | --- |
| nest, nest-models, loihi, loihi2, spinnaker, spinnaker-learning | traces of NEST and of chips | `neuro verify` |
| networks | networks of lava-dl on Loihi 2, the neuron of the NIR paper | arrays; `unpacked` makes their networks |

`pytest --renew-golden tests/test_golden_traces.py` runs the cases of ../shared/reference anew and writes what came out,
if it is that of the reference. `digests.json` names the files of the reference with their SHA-256 digests.
"""

import hashlib
import json
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import neuro
from neuro.testing import nest_traces
from neuro.testing.chip_traces import FOLLOWED, chip_of
from neuro.testing.golden import Golden
from neuro.testing.verify import _read

GOLDEN = Path(__file__).parents[1] / "golden"
DIGESTS = GOLDEN / "digests.json"
TRACES = ("nest", "nest-models", "loihi", "spinnaker", "spinnaker-learning", "loihi2")
EVERY = 3
"""Of the rows that NEST recorded, so many apart are compared."""
_DESCRIPTION = {
    *("resolution_ms", "t_sim_ms", "neuron", "inputs", "recorded", "synapse", "dopa", "set_n"),
    *("in_weight_pA", "in_delay_ms", "cases", "params"),
}


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


class _Read(dict):
    """Arrays by name, and which of them were read."""

    def __init__(self, arrays: Mapping[str, Any]) -> None:
        super().__init__(arrays)
        self.names: dict[str, None] = {}

    def __getitem__(self, name: str) -> Any:
        self.names[name] = None
        return super().__getitem__(name)

    def items(self) -> Any:
        self.names |= dict.fromkeys(self)
        return super().items()


def write(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays as `np.savez_compressed` does, in less room."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as file:
        for name, values in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_LZMA
            with file.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)


def rows_of(facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> tuple[str, Any]:
    """The array of NEST's times of rows and which rows are kept; those of dopamine only where NEST is up to date."""
    if "dopa" in facts:
        grid = round(facts["dopa"]["min_delay_ms"] * facts["dopa"]["deliver_interval"] / facts["resolution_ms"])
        steps = np.rint(arrays["trace"][:, 0] / facts["resolution_ms"]).astype(int)
        return "trace", np.flatnonzero(steps % grid == 0)[::EVERY]
    return "times_ms", np.arange(len(arrays.get("times_ms", ())))[::EVERY]


def thinned(golden: Golden) -> dict[str, Any]:
    """Copies of the arrays of a case, with some of NEST's rows, and those of the emulator that is followed."""
    arrays = {name: values.copy() for name, values in golden.arrays.items()}
    times, rows = rows_of(golden.facts, arrays)
    length = len(arrays.get(times, ()))
    for name, values in golden.arrays.items():
        if len(values.shape) and len(values) == length and times in arrays and "spikes" not in name:
            arrays[name] = values[rows]
        if name.endswith(f"__{FOLLOWED}"):
            arrays[name.removesuffix(f"__{FOLLOWED}")] = arrays.pop(name)
    return arrays


def renew(file: Path) -> None:
    """Run a case of a reference, and write what came out if nothing differs."""
    golden = _read(file)
    arrays = _Read(thinned(golden))
    chip = chip_of(golden.facts)
    facts = golden.facts
    if chip != "loihi2":
        described = {word: value for word, value in facts.items() if word in _DESCRIPTION}
        facts = {"reference": f"{file.parent.name}/{file.stem}", **described}

    def close(quantity: str, found: Any, expected: Any, *limit: float) -> Any:
        result = compare(quantity, found, expected, *limit)
        column = {"w": 1, "c": 2, "n": 3, "Kplus": 4}.get(quantity) if "dopa" in facts else None
        own = dict.__getitem__(arrays, "trace")[:, column] if column else expected
        own[...] = found
        return result

    compare = nest_traces.close
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nest_traces, "close", close)
        results = nest_traces.compare(Golden(facts, arrays), chip or "event")
    wrong = [f"{each.case} {each.quantity}: {each.message}" for each in results if not each.ok]
    assert wrong == [], f"{file}: the run differs from the reference"
    out = GOLDEN / file.parent.name / file.name
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(facts, separators=(",", ":")) + "\n")
    write(out.with_suffix(".npz"), {name: dict.__getitem__(arrays, name) for name in arrays.names})


# networks


def smallest(values: Any) -> np.ndarray:
    """Whole numbers as integers of as few bits as hold them."""
    values = np.asarray(values)
    whole = values.dtype.kind == "f" and np.isfinite(values).all() and (values == np.rint(values)).all()
    if values.dtype.kind not in "iu" and not whole:
        return values
    kinds = (np.int8, np.int16, np.int32)
    fits = (
        kind
        for kind in kinds
        if not values.size or np.iinfo(kind).min <= values.min() <= values.max() <= np.iinfo(kind).max
    )
    return values.astype(next(fits, np.int64))


def packed(net: neuro.Network, folder: Path, name: str = "net") -> dict[str, np.ndarray]:
    """A network as arrays: its YAML, and the arrays that this names."""
    net.save(folder / f"{name}.yaml")
    found = {f"{name}.yaml": np.frombuffer((folder / f"{name}.yaml").read_bytes(), np.uint8)}
    with h5py.File(folder / f"{name}.h5", "r") as file:
        file.visititems(
            lambda key, part: found.update({f"{name}.h5/{key}": smallest(part[()])}) if hasattr(part, "shape") else None
        )
    return found


def unpacked(arrays: Mapping[str, np.ndarray], folder: Path, name: str = "net") -> neuro.Network:
    """The network that was packed."""
    (folder / f"{name}.yaml").write_bytes(arrays[f"{name}.yaml"].tobytes())
    with h5py.File(folder / f"{name}.h5", "w") as file:
        for key in arrays:
            if key.startswith(f"{name}.h5/"):
                values = arrays[key]
                file[key.removeprefix(f"{name}.h5/")] = values.astype(float) if values.dtype.kind == "i" else values
    return neuro.load(folder / f"{name}.yaml")


def stored(name: str) -> dict[str, np.ndarray]:
    """The arrays of a golden case of networks."""
    with np.load(GOLDEN / "networks" / f"{name}.npz") as arrays:
        return {key: arrays[key] for key in arrays.files}


def sent(sim: neuro.Simulation, population: str) -> np.ndarray:
    """Payloads or spikes by step, from 0, and neuron."""
    part = next(p for p in sim.program.populations if p.name == population)
    times, ids, numbers = sim.payloads(population) if part.model.graded else (*sim.spikes(population), 1)
    found = np.zeros((round(sim.time) + 1, part.size), dtype=np.int64)
    found[np.rint(times).astype(int), ids] = numbers
    return found


def run_sdnn(net: neuro.Network, image: np.ndarray, steps: int) -> np.ndarray:
    """What PilotNet of sigma-delta neurons says about an image, by step."""
    sim = neuro.compile(net, "loihi2")
    sim.set("input", bias=image.ravel().astype(float))
    sim.run(float(steps))
    return sent(sim, "dense9")[1:, 0]


def run_tinynet(net: neuro.Network, bias: np.ndarray) -> np.ndarray:
    """Spikes of the last layer by step and neuron, from the third step."""
    sim = neuro.compile(net, "loihi2")
    sim.set("input", bias_mant=bias.ravel().astype(float))
    sim.run(17.0)
    return sent(sim, "conv2")[3:18]


def run_pair(net: neuro.Network, spikes: np.ndarray) -> dict[str, np.ndarray]:
    """Spikes, u and v of the second layer of a network whose first is given, by step and neuron."""
    before, after = list(net.populations)[:2]
    for state in ("u", "v"):
        net.probe(state, after, state)
    sim = neuro.compile(net, "loihi2")
    steps, ids = np.nonzero(spikes)
    sim.inject(before, steps + 1.0, ids)
    sim.run(24.0)
    found = {
        "s": sent(sim, after)[1:],
        "u": sim.trace("u")[1].astype(np.int64),
        "v": sim.trace("v")[1].astype(np.int64),
    }
    found["v"][found["s"] > 0] = 128  # what the chip's register reads then
    return found


PAIRS = {"conv-1": (2, "conv-0"), "fc-0": (7, "conv-4")}
"""Layers of PilotNet of spiking neurons: the number of the layer before in its file, and the name of what this sent."""


def _flat(file: Path) -> np.ndarray:
    """An array of width, height, channels, time by step and neuron."""
    array = np.load(file)
    return array.T.reshape(array.shape[-1], -1).astype(np.int64)


def _tinynet(folder: Path, place: Path) -> dict[str, np.ndarray]:
    net = neuro.from_netx(folder / "tiny.net", reset=17)
    bias = np.load(folder / "gts_tinynet_input_bias.npy").transpose(2, 1, 0)
    found = run_tinynet(net, bias)
    assert np.array_equal(found.T, np.load(folder / "gts_tinynet_output.npy")[0, :, 0, 0, 1:])
    return packed(net, place) | {"bias": bias, "s": found}


def _sdnn(folder: Path, place: Path) -> dict[str, np.ndarray]:
    net = neuro.from_netx(folder / "gts_pilotnet_sdnn_network.net")
    image = np.load(folder / "gts_pilotnet_sdnn_input.npy")[..., 0].transpose(2, 1, 0)
    truth = np.load(folder / "gts_pilotnet_sdnn_output.npy").ravel()
    found = run_sdnn(net, image, truth.size)
    assert np.array_equal(found, truth)
    return packed(net, place) | {"image": image, "s": found}


def _lif(folder: Path, place: Path) -> dict[str, np.ndarray]:
    traces = folder / "pilotnet_lif"
    net = neuro.from_netx(traces / "network.net", reset=17, first=1)
    arrays = packed(net, place) | {"input": _flat(traces / "input.npy") > 0}
    for target, (first, source) in PAIRS.items():
        net = neuro.from_netx(traces / "network.net", reset=17, first=first)
        two = list(net.populations)[:2]
        net.populations = {name: net.populations[name] for name in two}
        net.projections = {name: part for name, part in net.projections.items() if {part.source, part.target} <= {*two}}
        arrays |= packed(net, place, target)  # without the probes of the run
        spikes = _flat(traces / f"{source}.npy")
        found = run_pair(net, spikes)
        assert np.array_equal(found["s"], _flat(traces / f"{target}.npy"))
        for state in ("u", "v"):
            if (traces / f"{target}-{state}.npy").exists():
                assert np.array_equal(found[state], _flat(traces / f"{target}-{state}.npy"))
        arrays[f"{target}/input"] = spikes > 0
        arrays |= {f"{target}/{name}": values for name, values in summary(found).items()}
    return arrays


def summary(registers: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Spikes, a few of the other registers, and the digest of all of those."""
    whole = b"".join(registers[state].astype("<i8").tobytes() for state in ("u", "v"))
    few = {state: registers[state][:, ::32] for state in ("u", "v")}
    return {"s": registers["s"] > 0, **few, "digest": np.frombuffer(hashlib.sha256(whole).digest(), np.uint8)}


LIF = {
    "norse": "norse",
    "snntorch": "snntorch",
    "sinabs": "sinabs",
    "spyx": "spyx",
    "rockpool": "rockpool",
    "exact": "nir",
    "nengo": "nir",
    "lava_loihi_fixed": "norse",
}
"""Platforms that ran the neuron of the NIR paper, and the tool whose time is taken."""


def run_lif(graph: Path, arriving: np.ndarray, platform: str) -> np.ndarray:
    """Steps of the spikes of the neuron of the NIR paper, in the time of a platform."""
    on_chip = "loihi" in platform
    net = neuro.from_nir(graph, dt=0.1, from_=LIF[platform])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "loihi" if on_chip else "event")
    sim.inject("input", (arriving + 1) * 0.1)
    sim.run(101.0)
    later = int(net.verdicts["1"].how.rpartition("; ")[2].split()[0])
    # Lava's neurons see a spike one step after it was sent, as ours do, whose time is counted without that step.
    return np.rint(sim.spikes("1")[0] / 0.1).astype(int) - 1 - later + on_chip


def lif_graph(path: Path, numbers: Mapping[str, Any]) -> Path:
    """A file of NIR with one neuron."""
    import nir

    words = ("tau", "r", "v_leak", "v_threshold", "v_reset")
    nodes = {
        "input": nir.Input({"input": np.array([1])}),
        "0": nir.Affine(numbers["weight"], numbers["bias"]),
        "1": nir.LIF(**{word: numbers[word] for word in words}),
        "output": nir.Output({"output": np.array([1])}),
    }
    nir.write(path, nir.NIRGraph(nodes, [("input", "0"), ("0", "1"), ("1", "output")]))
    return path


def _neuron(folder: Path, place: Path) -> dict[str, np.ndarray]:
    import nir

    nodes = nir.read(folder / "lif_norse.nir").nodes
    arrays = {word: getattr(nodes["0"], word) for word in ("weight", "bias")}
    arrays |= {word: getattr(nodes["1"], word) for word in ("tau", "r", "v_leak", "v_threshold", "v_reset")}
    arrays["input"] = np.flatnonzero(np.genfromtxt(folder / "lif_norse.csv", delimiter=",")[:, 0])
    graph = lif_graph(place / "lif.nir", arrays)
    for platform in LIF:
        arrays[platform] = run_lif(graph, arrays["input"], platform)
        truth = np.flatnonzero(np.genfromtxt(folder / f"lif_{platform}.csv", delimiter=",")[:, 2])
        assert np.array_equal(arrays[platform], truth), platform
    return arrays


NETWORKS: dict[str, tuple[str, Callable[[Path, Path], dict[str, np.ndarray]]]] = {
    "tinynet": ("loihi2", _tinynet),
    "pilotnet_sdnn": ("loihi2", _sdnn),
    "pilotnet_lif": ("loihi2", _lif),
    "nir_lif": ("nir", _neuron),
}
"""Golden cases of networks: the folder of the reference, and what runs them and returns their arrays."""


def sources(reference: Path) -> dict[str, Path]:
    """The files of the reference that golden cases are equal to, by name."""
    files = [
        file
        for folder in TRACES
        for file in sorted((reference / folder).glob("*.*"))
        if file.suffix in (".json", ".npz")
    ]
    files += sorted(file for file in (reference / "loihi2").rglob("*.n*") if file not in files)
    files += [reference / "nir" / name for name in ("lif_norse.nir", *(f"lif_{platform}.csv" for platform in LIF))]
    return {str(file.relative_to(reference)): file for file in files}


def renew_all(reference: Path, place: Path) -> None:
    """Run all cases and write what came out."""
    for folder in TRACES:
        for file in sorted((reference / folder).glob("*.json")):
            renew(file)
    (GOLDEN / "networks").mkdir(exist_ok=True)
    for name, (folder, run) in NETWORKS.items():
        arrays = {key: smallest(values) for key, values in run(reference / folder, place).items()}
        write(GOLDEN / "networks" / f"{name}.npz", arrays)
    digests = {name: digest(file) for name, file in sources(reference).items()}
    DIGESTS.write_text(json.dumps(digests, indent=0) + "\n")
