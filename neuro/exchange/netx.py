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
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.inputs import record_input
from neuro.core.paths import existing
from neuro.exchange.verdict import EXACT, REFUSED, Verdict, Verdicts
from neuro.model.convolution import out_size, synapses_of
from neuro.model.network import Network
from neuro.model.neurons import (
    Neuron,
    graded_spike_train,
    loihi2_lif,
    sigma_decoder,
    sigma_delta,
    spike_generator,
)
from neuro.model.rules import Rule, all_to_all, grid, pairs
from neuro.model.synapses import Synapse, loihi2_convolution, loihi2_static
from neuro.program.program import Floats

LAYERS = ("input", "conv", "dense", "flatten")
EXPONENT = 6
"""Of the states and messages of SDNN neurons, and of the bias of LIF neurons."""

Ints3 = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer as it was read.

    Attributes:
        number: its place in the file.
        depth: how many layers of neurons lie before it.
        kind: one of `LAYERS`.
        shape: channels, rows and columns of its neurons; of flat ones their number.
        neuron: what the file says of its neurons, by word.
        words: numbers and arrays of the layer itself.
    """

    number: int
    depth: int
    kind: str
    shape: Ints3
    neuron: Mapping[str, Any]
    words: Mapping[str, Any] = field(default_factory=dict)

    def wrong(self, message: str, hint: str = "") -> ModelError:
        """An error that names the layer."""
        return ModelError(f"layer {self.number} ({self.kind}): {message}", hint=hint)

    def two(self, word: str) -> tuple[int, int]:
        """A word of a convolution, down and across."""
        down, across = np.broadcast_to(np.ravel(self.words.get(word, 1 if word != "padding" else 0)), 2).tolist()
        return int(down), int(across)


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
    path, layers = _layers(file)
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
    path, layers = _layers(file)
    verdicts = []
    for layer in layers:
        problems = list(_problems(layer))
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


def _layers(file: str | PathLike[str]) -> tuple[Path, list[Layer]]:
    path = existing(Path(file))
    record_input(path)
    return path, _read(path)


def _network(name: str, layers: list[Layer], reset: int, first: int) -> Network:
    """Layers that are not refused as populations."""
    net = Network(name, resolution=1.0)
    before: Layer | None = None
    for layer in layers:
        if layer.kind == "flatten":
            continue
        if layer.number >= first:
            _add(net, layer, before, reset)
        elif layer.number < first:
            _add_source(net, layer, last=_next(layers, layer).number >= first)
        before = layer
    return net


def _next(layers: list[Layer], layer: Layer) -> Layer:
    return next(each for each in layers if each.number > layer.number and each.kind != "flatten")


def _add_source(net: Network, layer: Layer, last: bool) -> None:
    if last:
        graded = layer.neuron["type"] == "SDNN"
        net.population(_name(layer), layer.shape, graded_spike_train() if graded else spike_generator())


def _name(layer: Layer) -> str:
    return "input" if layer.kind == "input" else f"{layer.kind}{layer.number}"


def _add(net: Network, layer: Layer, before: Layer | None, reset: int) -> None:
    """A layer and what connects it to the one before."""
    if layer.kind == "conv" and before is not None:
        _check_shape(layer, before)
    net.population(_name(layer), layer.shape, _neurons(layer, reset))
    if layer.kind == "input":
        return
    if before is None:
        raise layer.wrong("there is no layer before it: expected an input")
    rule, synapse, weight = _synapses(layer, before)
    net.connect(_name(before), _name(layer), rule, synapse, weight=weight, delay=1.0)


def _check_shape(layer: Layer, before: Layer) -> None:
    kernel = layer.words["weight"]
    sizes = (layer.two("stride"), layer.two("padding"), layer.two("dilation"))
    expected = (kernel.shape[0], *out_size(before.shape[1:], kernel.shape[2:4], *sizes))  # type: ignore[arg-type]
    if tuple(layer.shape) != expected or before.shape[0] != kernel.shape[1] * int(layer.words.get("groups", 1)):
        raise layer.wrong(f"shape {list(layer.shape)} from {list(before.shape)}: expected {list(expected)}")


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
        synapse, mantissas = _dense(weight.reshape(int(np.prod(layer.shape)), -1))
        return all_to_all(), synapse, mantissas.T.ravel()
    kernel, stride, padding = weight.reshape(weight.shape[:4]), layer.two("stride"), layer.two("padding")
    dilation, groups = layer.two("dilation"), int(layer.words.get("groups", 1))
    if _is_grid(layer):
        rule = grid(kernel=kernel.shape[2:], stride=stride[0], padding=padding[0], column_padding=padding[1])
        return rule, loihi2_convolution(), kernel.ravel()
    channels, rows, columns = before.shape
    pre, post, weights = synapses_of((channels, rows, columns), kernel, stride, padding, dilation, groups)
    return pairs(pre=pre, post=post), loihi2_convolution(), weights


def _is_grid(layer: Layer) -> bool:
    """Whether a rule of the language shares the kernel."""
    down, across = layer.two("stride")
    return down == across and layer.two("dilation") == (1, 1) and int(layer.words.get("groups", 1)) == 1


def _dense(weight: Floats) -> tuple[Synapse, Floats]:
    """Mantissas and the synapse that sends each weight as it is: mixed mantissas are even."""
    mode = "excitatory" if weight.min() >= 0 else "inhibitory" if weight.max() < 0 else "mixed"
    doubled = mode == "mixed" and bool(np.any(weight % 2))
    return loihi2_static(weight_exp=-1 if doubled else 0, sign_mode=mode), weight * (2.0 if doubled else 1.0)


def _problems(layer: Layer) -> Iterator[ModelError]:
    """What netx refuses or leaves out."""
    if layer.kind not in LAYERS:
        yield layer.wrong(f"netx has no layer '{layer.kind}': expected {', '.join(LAYERS)}")
        return
    if layer.kind == "flatten":
        return
    kind = layer.neuron.get("type", "")
    if kind not in ("LOIHI", "CUBA", "SDNN"):
        yield layer.wrong(f"netx has no neuron '{kind}': expected LOIHI, CUBA or SDNN")
    elif missing := [word for word in _needed(kind) if word not in layer.neuron]:
        yield layer.wrong(f"its neuron has no '{missing[0]}'")
    for word, kept in (("refDelay", (0, 1)), ("wgtExp", (0,))):
        if int(layer.neuron.get(word, kept[0])) not in kept:
            yield layer.wrong(f"{word} = {layer.neuron[word]}: netx leaves it out, and so nothing says what it does")
    if layer.neuron.get("activation", "relu") != "relu":
        yield layer.wrong(f"activation '{layer.neuron['activation']}': expected relu")
    if "delay" in layer.words:
        yield layer.wrong("it has delays, which netx leaves out", "train it without delays")
    if layer.kind != "input":
        yield from _of_weights(layer, kind)


def _needed(kind: str) -> tuple[str, ...]:
    return ("vThMant",) if kind == "SDNN" else ("vThMant", "iDecay", "vDecay")


def _of_weights(layer: Layer, kind: str) -> Iterator[ModelError]:
    weight = layer.words.get("weight")
    if weight is None:
        yield layer.wrong("it has no weights")
        return
    if not np.array_equal(weight, np.rint(weight)):
        yield layer.wrong("its weights are no whole numbers", "export the network quantised")
    low, high = float(weight.min()), float(weight.max())
    odd = layer.kind == "dense" and low < 0 <= high and bool(np.any(weight % 2))
    most = 127 if odd else 254
    if low < -most - (layer.kind == "dense") or high > most:
        yield layer.wrong(f"weights from {low:g} to {high:g}: a weight has 8 bits")


def _read(path: Path) -> list[Layer]:
    """All layers of a file."""
    try:
        with h5py.File(path, "r") as file:
            found = file.get("layer")
            if not isinstance(found, h5py.Group):
                raise ModelError(f"{path}: there is no 'layer' in it: expected a network of lava-dl")
            layers: list[Layer] = []
            for number in sorted(found, key=int):
                layers.append(_layer(int(number), sum(each.kind != "flatten" for each in layers), found[number]))
            return layers
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise ModelError(f"{path}: it cannot be read as a network of lava-dl: {error}") from None


def _layer(number: int, depth: int, group: h5py.Group) -> Layer:
    words = {word: _plain(item) for word, item in group.items() if isinstance(item, h5py.Dataset)}
    neuron = {word: _plain(item) for word, item in group["neuron"].items()} if "neuron" in group else {}
    shape = tuple(int(n) for n in np.ravel(words["shape"]))
    kind = str(words["type"])
    if kind == "dense":
        shape = (int(np.prod(shape)),)
    arrays = {word: np.asarray(words[word], dtype=np.float64) for word in ("weight", "bias") if word in words}
    return Layer(number, depth, kind, shape, neuron, {**words, **arrays})


def _plain(item: h5py.Dataset) -> Any:
    """A text, a number or an array."""
    value: NDArray[Any] | Any = item[()]
    if isinstance(value, np.ndarray) and value.dtype.kind in "SO":
        value = value.ravel()[0]
    return value.decode("ascii") if isinstance(value, bytes) else value
