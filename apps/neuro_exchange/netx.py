"""Networks of lava-dl (`.net`, HDF5 as its netx reads it) as networks of Loihi 2, integer by integer.

| in the file | here |
| --- | --- |
| neuron LOIHI or CUBA | `loihi2_lif`: du = iDecay - 1, dv = vDecay, vth = vThMant, the bias times 2^6 |
| neuron SDNN | `sigma_delta`, without ReLU as input; `sigma_decoder` (`sigma_output`); exponents of 6 and 6 |
| dense | `all_to_all`, mantissas such that no bit is dropped: what netx finds by its bits and exponent |
| conv | `loihi2_convolution`; as a `grid`, or as pairs where strides differ, or with dilation or groups |
| flatten | channels, rows, columns: the order of ids |

A step is 1 ms. A spike takes one step to the next layer, as in lava. The input layer is fed by its bias, as in netx:
`sim.set("input", bias_mant=...)` of LIF neurons, `sim.set("input", bias=...)` of SDNN, where a Delta of lava sends the
same. What netx refuses (pooling, average, concatenation, transposed convolution, neurons of other types) or leaves out
(delays, refractory periods) is refused. Source: lava-dl, `src/lava/lib/dl/netx`, whose tests assert it on chips.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import prod
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro import (
    ModelError,
    Network,
    all_to_all,
    graded_spike_train,
    grid,
    loihi2_convolution,
    loihi2_lif,
    loihi2_static,
    pairs,
    sigma_decoder,
    sigma_delta,
    spike_generator,
)
from neuro.apps import existing, hdf5, is_number, record_input
from neuro.extend import Floats, Neuron, Rule, Synapse, out_size, synapses_of
from neuro_exchange.verdict import EXACT, REFUSED, Verdict, Verdicts

LAYERS = ("input", "conv", "dense", "flatten")
EXPONENT = 6
"""Of the states and messages of SDNN neurons, and of the bias of LIF neurons."""
MOST = 2**31 - 1
TEXTS = ("type", "activation")
ARRAYS = ("weight", "bias")
WHOLE = {
    **{"shape": (3, 1), "stride": (2, 1), "padding": (2, 0), "dilation": (2, 1), "groups": (1, 1)},
    **dict.fromkeys(("vThMant", "iDecay", "vDecay", "refDelay", "wgtExp"), (1, -MOST)),
}
"""Words that are whole numbers: how many at most, and the least."""
PRESENT = ("delay", "sigma_output")
"""Words of which only counts that they are there."""

Ints = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer as it was read.

    Attributes:
        number: its place in the file.
        kind: one of `LAYERS`.
        shape: channels, rows and columns of its neurons; of flat ones their number.
        neuron: what the file says of its neurons, by word.
        words: numbers and arrays of the layer itself.
        before: the layer of neurons before it, None of the first.
    """

    number: int
    kind: str
    shape: Ints
    neuron: Mapping[str, Any]
    words: Mapping[str, Any] = field(default_factory=dict)
    before: Layer | None = None

    @property
    def depth(self) -> int:
        """How many layers of neurons lie before it."""
        return 0 if self.before is None else self.before.depth + 1

    @property
    def size(self) -> int:
        """The number of its neurons."""
        return prod(self.shape)

    def wrong(self, message: str, hint: str = "") -> ModelError:
        """An error that names the layer."""
        return ModelError(f"layer {self.number} ({self.kind}): {message}", hint=hint)

    def two(self, word: str) -> tuple[int, int]:
        """A word of a convolution, down and across."""
        numbers: Ints = self.words.get(word, (0 if word == "padding" else 1,))
        return numbers[0], numbers[-1]

    @property
    def groups(self) -> int:
        """Of a convolution."""
        return int(self.words.get("groups", 1))


def from_netx(file: str | PathLike[str], *, reset: int = 0, first: int = 0) -> Network:
    """The network of a file of lava-dl.

    Args:
        file: ends in `.net`.
        reset: steps between two resets of u and v, of the i-th layer of neurons from 0 in the steps i + 1,
            i + 1 + reset, ...; 0: none.
        first: the first layer that is taken; the one before it is then a generator without spikes.

    Raises:
        ModelError: the file is no such network, or has what is refused; all of that at once.
    """
    path, layers = _layers(file, reset)
    if not _is_whole(first, range(layers[-1].number + 1)):
        raise ModelError(f"first = {first!r}: expected the number of a layer, 0 to {layers[-1].number}")
    problems = [problem for layer in layers for problem in _problems(layer)]
    if problems:
        raise problems[0].at(None, str(path)).but(others=tuple(problems[1:]))
    return _network(path.stem, layers, reset, first)


def examine_netx(file: str | PathLike[str], *, reset: int = 0) -> tuple[Network | None, Verdicts]:
    """The network of a file of lava-dl, None if a layer is refused, and a verdict for each layer.

    `file` and `reset` are those of `from_netx`.

    Raises:
        ModelError: the file is no such network.
    """
    path, layers = _layers(file, reset)
    verdicts = []
    for layer in layers:
        problems = _problems(layer)
        kind = ", ".join(filter(None, (layer.kind, layer.neuron.get("type", ""))))
        how = "; ".join(problem.message.partition(": ")[2] for problem in problems) or _becomes(layer, reset)
        way_out = "; ".join(dict.fromkeys(filter(None, (problem.hint for problem in problems))))
        verdicts.append(Verdict(_name(layer), kind, REFUSED if problems else EXACT, how, way_out))
    table = Verdicts(f"'{path.stem}' of lava-dl, by the rules of lava's netx", tuple(verdicts))
    return None if table.refused else _network(path.stem, layers, reset, 0), table


def _becomes(layer: Layer, reset: int) -> str:
    """What a layer is here."""
    if layer.kind == "flatten":
        return "ids are in its order: channels, rows, columns"
    cells = _neurons(layer, reset)
    if layer.kind == "input":
        return f"{cells.name}, fed by its bias"
    weights = layer.words["weight"]
    if layer.kind == "dense":
        return f"{cells.name}, {weights.size:,} weights, none of which loses a bit"
    rule = "a shared kernel" if _is_grid(layer) else "its synapses one by one"
    return f"{cells.name}, {rule} of {weights.size:,} weights"


def _is_whole(value: Any, allowed: range) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed


def _layers(file: str | PathLike[str], reset: int) -> tuple[Path, list[Layer]]:
    path = existing(file)
    if not _is_whole(reset, range(MOST + 1)):
        raise ModelError(f"reset = {reset!r}: expected a whole number >= 0 and <= {MOST}")
    record_input(path)
    return path, _read(path)


def _network(name: str, layers: list[Layer], reset: int, first: int) -> Network:
    """Layers that are not refused as populations."""
    net = Network(name, resolution=1.0)
    taken = [layer for layer in layers if layer.kind != "flatten" and layer.number >= first]
    for layer in taken:
        if layer is taken[0] and layer.before:
            graded = layer.before.neuron["type"] == "SDNN"
            source = graded_spike_train() if graded else spike_generator()
            net.population(_name(layer.before), layer.before.shape, source)
        # A layer and what connects it to the one before.
        net.population(_name(layer), layer.shape, _neurons(layer, reset))
        if layer.before:
            rule, synapse, weight = _synapses(layer, layer.before)
            net.connect(_name(layer.before), _name(layer), rule, synapse, weight=weight, delay=1.0)
    return net


def _name(layer: Layer) -> str:
    return "input" if layer.kind == "input" else f"{layer.kind}{layer.number}"


def _neurons(layer: Layer, reset: int) -> Neuron:
    said = layer.neuron
    bias = layer.words.get("bias", np.zeros(1)) if layer.kind != "input" else np.zeros(1)
    each: Any = np.broadcast_to(bias.reshape(-1, *(1,) * (len(layer.shape) - 1)), layer.shape).copy()
    each = each if bias.any() else 0.0
    if said["type"] == "SDNN":
        exponents: dict[str, Any] = {"spike_exp": EXPONENT, "state_exp": EXPONENT}
        if layer.kind == "input":
            return sigma_delta(vth=float(said["vThMant"]), relu=False, **exponents)
        if "sigma_output" in said:
            return sigma_decoder()
        return sigma_delta(vth=float(said["vThMant"]), bias=each, **exponents)
    words = {"du": int(said["iDecay"]) - 1, "dv": int(said["vDecay"]), "vth": int(said["vThMant"])}
    offset = (layer.depth + 1) % reset if reset else 0
    return loihi2_lif(**words, bias_mant=each, bias_exp=EXPONENT, reset_interval=reset, reset_offset=offset)


def _synapses(layer: Layer, before: Layer) -> tuple[Rule, Synapse, Floats]:
    weight = layer.words["weight"]
    if layer.kind == "dense":
        synapse, mantissas = _dense(weight.reshape(layer.size, -1))
        return all_to_all(), synapse, mantissas.T.ravel()
    kernel, stride, padding = weight.reshape(weight.shape[:4]), layer.two("stride"), layer.two("padding")
    dilation = layer.two("dilation")
    if _is_grid(layer):
        rule = grid(kernel=kernel.shape[2:], stride=stride[0], padding=padding[0], column_padding=padding[1])
        return rule, loihi2_convolution(), kernel.ravel()
    channels, rows, columns = before.shape
    pre, post, weights = synapses_of((channels, rows, columns), kernel, stride, padding, dilation, layer.groups)
    return pairs(pre=pre, post=post), loihi2_convolution(), weights


def _is_grid(layer: Layer) -> bool:
    """Whether a rule of the language shares the kernel."""
    down, across = layer.two("stride")
    return down == across and layer.two("dilation") == (1, 1) and layer.groups == 1


def _dense(weight: Floats) -> tuple[Synapse, Floats]:
    """Mantissas and the synapse that sends each weight as it is: mixed mantissas are even."""
    mode = "excitatory" if weight.min() >= 0 else "inhibitory" if weight.max() < 0 else "mixed"
    doubled = mode == "mixed" and bool(np.any(weight % 2))
    return loihi2_static(weight_exp=-1 if doubled else 0, sign_mode=mode), weight * (2.0 if doubled else 1.0)


def _problems(layer: Layer) -> list[ModelError]:
    """Why a layer is refused."""
    problems = list(_refused(layer))
    if not problems and layer.kind != "flatten":
        try:
            _neurons(layer, 0)
        except ModelError as error:
            problems = [layer.wrong(error.message, error.hint)]
    return problems


def _refused(layer: Layer) -> Iterator[ModelError]:
    """What netx refuses or leaves out."""
    if layer.kind not in LAYERS:
        yield layer.wrong(f"netx has no layer '{layer.kind}': expected {', '.join(LAYERS)}")
        return
    if layer.kind == "flatten":
        return
    kind = layer.neuron.get("type", "")
    if kind not in ("LOIHI", "CUBA", "SDNN"):
        yield layer.wrong(f"netx has no neuron '{kind}': expected LOIHI, CUBA or SDNN")
    elif missing := [
        word
        for word in (("vThMant",) if kind == "SDNN" else ("vThMant", "iDecay", "vDecay"))
        if word not in layer.neuron
    ]:
        yield layer.wrong(f"its neuron has no '{missing[0]}'")
    for word, kept in (("refDelay", (0, 1)), ("wgtExp", (0,))):
        if layer.neuron.get(word, kept[0]) not in kept:
            yield layer.wrong(f"{word} = {layer.neuron[word]}: netx leaves it out, and so nothing says what it does")
    if layer.neuron.get("activation", "relu") != "relu":
        yield layer.wrong(f"activation '{layer.neuron['activation']}': expected relu")
    if "delay" in layer.words:
        yield layer.wrong("it has delays, which netx leaves out", "train it without delays")
    if (layer.kind == "input") == bool(layer.before):
        yield layer.wrong("expected the input as first layer, and only there")
    elif layer.before:
        yield from _of_weights(layer, layer.before)


def _of_weights(layer: Layer, before: Layer) -> Iterator[ModelError]:
    weight = layer.words.get("weight", np.zeros(0))
    if not weight.size:
        yield layer.wrong("it has no weights")
        return
    if wrong := _of_convolution(layer, before) if layer.kind == "conv" else _of_dense(layer, before):
        yield layer.wrong(wrong)
    if (biases := layer.words.get("bias", np.zeros(1)).size) not in (1, layer.shape[0]):
        yield layer.wrong(f"{biases:,} biases: expected 1 or {layer.shape[0]:,}")
    if not np.array_equal(weight, np.rint(weight)):
        yield layer.wrong("its weights are no whole numbers", "export the network quantised")
    low, high = float(weight.min()), float(weight.max())
    odd = layer.kind == "dense" and low < 0 <= high and bool(np.any(weight % 2))
    most = 127 if odd else 254
    if low < -most - (layer.kind == "dense") or high > most:
        yield layer.wrong(f"weights from {low:g} to {high:g}: a weight has 8 bits")


def _of_dense(layer: Layer, before: Layer) -> str:
    """What is wrong with the number of weights."""
    expected, found = layer.size * before.size, layer.words["weight"].size
    if found == expected:
        return ""
    return f"{found:,} weights from {before.size:,} neurons to {layer.size:,}: expected {expected:,}"


def _of_convolution(layer: Layer, before: Layer) -> str:
    """What is wrong with the shapes of a convolution and of its kernel."""
    kernel = layer.words["weight"]
    shapes = f"shape {list(layer.shape)} from {list(before.shape)}"
    if len(layer.shape) != 3 or len(before.shape) != 3:
        return f"{shapes}: expected 3 numbers each"
    if kernel.ndim < 4 or prod(kernel.shape[4:]) != 1:
        return f"weights of shape {list(kernel.shape)}: expected maps, channels, height, width"
    maps, depth, *size = kernel.shape[:4]
    if maps % layer.groups:
        return f"groups = {layer.groups}: expected one that divides {maps} maps"
    sizes = (layer.two("stride"), layer.two("padding"), layer.two("dilation"))
    expected = [maps, *out_size(before.shape[1:], tuple(size), *sizes)]
    source = [depth * layer.groups, *before.shape[1:]]
    if list(layer.shape) == expected and list(before.shape) == source:
        return ""
    return f"{shapes}: expected {expected} from {source}"


def _read(path: Path) -> list[Layer]:
    """All layers of a file."""
    try:
        with h5py.File(path, "r") as file:
            hdf5.check_tree(file, several_names=True)
            found = file.get("layer")
            if not isinstance(found, h5py.Group):
                raise ModelError("there is no 'layer' in it: expected a network of lava-dl")
            layers: list[Layer] = []
            before = None
            for number in sorted(found, key=int):
                layers.append(_layer(int(number), found[number], before))
                before = before if layers[-1].kind == "flatten" else layers[-1]
            if before is None:
                raise ModelError("there is no layer in it")
            return layers
    except ModelError as error:
        raise error.at(None, str(path)) from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{path}: it cannot be read as a network of lava-dl: {error}") from None


def _layer(number: int, group: h5py.Group, before: Layer | None) -> Layer:
    where = f"layer {number}"
    words = _words(group, where)
    neuron = _words(group["neuron"], f"{where}: its neuron") if "neuron" in group else {}
    for needed in ("type", "shape"):
        if needed not in words:
            raise ModelError(f"{where} has no '{needed}'")
    kind, shape = words["type"], words["shape"]
    return Layer(number, kind, (prod(shape),) if kind == "dense" else shape, neuron, words, before)


def _words(group: h5py.Group, where: str) -> dict[str, Any]:
    """What a layer or its neuron says that is used here."""
    if not isinstance(group, h5py.Group):
        raise ModelError(f"{where} is no group of words")
    known = (*TEXTS, *ARRAYS, *WHOLE, *PRESENT)
    return {word: _value(group[word], word, where.partition(":")[0]) for word in group if word in known}


def _value(item: h5py.Dataset, word: str, where: str) -> Any:
    """A text, an array, a whole number or several."""
    most, least = WHOLE.get(word, (1, 0))
    several = ("a whole number", "1 or 2 whole numbers", "1 to 3 whole numbers")[most - 1]
    several += "" if least == -MOST else f" >= {least}"
    expected = "a word" if word in TEXTS else "numbers" if word in ARRAYS else several
    if not isinstance(item, h5py.Dataset):
        raise ModelError(f"{where}: {word} has no value: expected {expected}")
    value: NDArray[Any] = np.asarray(item[()])
    listed: list[Any] = [
        each.decode("ascii") if isinstance(each, bytes) else each for each in value.ravel()[:20].tolist()
    ]
    if word in PRESENT:
        return True
    if word in TEXTS and len(listed) == 1 and isinstance(listed[0], str):
        return listed[0]
    if word in ARRAYS and value.dtype.kind in "iuf":
        return value.astype(np.float64)
    are_whole = all(is_number(each) and least <= each <= MOST and each == int(each) for each in listed)
    if word in WHOLE and 1 <= len(listed) <= most and are_whole:
        return int(listed[0]) if most == 1 else tuple(map(int, listed))
    found = listed if value.shape else listed[0]
    raise ModelError(f"{where}: {word} = {found!r:.60}: expected {expected}")
