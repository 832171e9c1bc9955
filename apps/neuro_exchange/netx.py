"""Read networks of lava-dl (`.net`, HDF5) as networks of Loihi 2, with the integers of lava's netx.

| in the file | here |
| --- | --- |
| neuron LOIHI or CUBA | `loihi2_lif`: du = iDecay - 1, dv = vDecay, vth = vThMant, the bias times 2^6 |
| neuron SDNN | `sigma_delta`, in the input without ReLU; `sigma_decoder` for `sigma_output`; both exponents are 6 |
| dense | `all_to_all`; the mantissas keep all bits of the integers that netx computes from bits and exponent |
| conv | `loihi2_convolution`; as a `grid`, or as pairs for unequal strides, dilation or groups |
| flatten | channels, rows, columns: the order of ids |

A step is 1 ms. A spike takes one step to the next layer, as in lava. The bias drives the input layer, as in netx. Set
the bias by `sim.set("input", bias_mant=...)` for LIF neurons, and by `sim.set("input", bias=...)` for SDNN. The input
layer of SDNN sends the same messages as a Delta of lava. What netx refuses (pooling, average, concatenation, transposed
convolution, other types of neurons) or ignores (delays, refractory periods) is refused. Source: lava-dl,
`src/lava/lib/dl/netx`; its tests compare netx with chips.
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
"""Exponent of the states and messages of SDNN neurons, and of the bias of LIF neurons."""
MOST = 2**31 - 1
"""Largest whole number of a file."""
TEXTS = ("type", "activation")
ARRAYS = ("weight", "bias")
WHOLE = {
    **{"shape": (3, 1), "stride": (2, 1), "padding": (2, 0), "dilation": (2, 1), "groups": (1, 1)},
    **dict.fromkeys(("vThMant", "iDecay", "vDecay", "refDelay", "wgtExp"), (1, -MOST)),
}
"""Fields that hold whole numbers: their largest count, and their lower bound."""
PRESENT = ("delay", "sigma_output")
"""Fields whose presence counts, and whose value is ignored."""

Ints = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer of a file.

    Attributes:
        number: index in the file, from 0.
        kind: one of `LAYERS`.
        shape: (channels, rows, columns), or (neurons,) for flat layers.
        neuron: fields of the neurons by name.
        words: fields of the layer by name.
        before: the layer of neurons that sends to this layer; None for the first.
    """

    number: int
    kind: str
    shape: Ints
    neuron: Mapping[str, Any]
    words: Mapping[str, Any] = field(default_factory=dict)
    before: Layer | None = None

    @property
    def depth(self) -> int:
        """The number of layers of neurons before the layer."""
        return 0 if self.before is None else self.before.depth + 1

    @property
    def size(self) -> int:
        """The number of neurons."""
        return prod(self.shape)

    def wrong(self, message: str, hint: str = "") -> ModelError:
        """Return an error that names the layer."""
        return ModelError(f"layer {self.number} ({self.kind}): {message}", hint=hint)

    def two(self, word: str) -> tuple[int, int]:
        """Return a field of a convolution for rows and columns, e.g. its stride."""
        numbers: Ints = self.words.get(word, (0 if word == "padding" else 1,))
        return numbers[0], numbers[-1]

    @property
    def groups(self) -> int:
        """The number of groups of a convolution."""
        return int(self.words.get("groups", 1))


def from_netx(file: str | PathLike[str], *, reset: int = 0, first: int = 0) -> Network:
    """Return the network of a file of lava-dl.

    Args:
        file: name of the file, which ends in `.net`.
        reset: steps between two resets of u and v. The i-th layer of neurons, from 0, is reset in the steps
            i + 1, i + 1 + reset, ...; 0 for no resets.
        first: number of the first layer to read. The layer before becomes a generator without spikes.

    Raises:
        ModelError: the file is not such a network, or layers are refused. The error lists all refused layers.
    """
    path, layers = _layers(file, reset)
    if not _is_whole(first, range(layers[-1].number + 1)):
        raise ModelError(f"first = {first!r}: expected the number of a layer, 0 to {layers[-1].number}")
    problems = [problem for layer in layers for problem in _problems(layer)]
    if problems:
        raise problems[0].at(None, str(path)).but(others=tuple(problems[1:]))
    return _network(path.stem, layers, reset, first)


def examine_netx(file: str | PathLike[str], *, reset: int = 0) -> tuple[Network | None, Verdicts]:
    """Return the network of a file of lava-dl, or None if a layer is refused, and a verdict for each layer.

    The arguments are those of `from_netx`.

    Raises:
        ModelError: the file is not such a network.
    """
    path, layers = _layers(file, reset)
    verdicts = []
    for layer in layers:
        problems = _problems(layer)
        kind = ", ".join(filter(None, (layer.kind, layer.neuron.get("type", ""))))
        note = "; ".join(problem.message.partition(": ")[2] for problem in problems) or _counterpart(layer, reset)
        way_out = "; ".join(dict.fromkeys(filter(None, (problem.hint for problem in problems))))
        verdicts.append(Verdict(_name(layer), kind, REFUSED if problems else EXACT, note, way_out))
    table = Verdicts(f"'{path.stem}' of lava-dl, by the rules of lava's netx", tuple(verdicts))
    return None if table.refused else _network(path.stem, layers, reset, 0), table


def _counterpart(layer: Layer, reset: int) -> str:
    """Describe the counterpart of a layer, for its verdict."""
    if layer.kind == "flatten":
        return "the order of ids: channels, rows, columns"
    neurons = _neurons(layer, reset)
    if layer.kind == "input":
        return f"{neurons.name}, driven by its bias"
    weights = layer.words["weight"]
    if layer.kind == "dense":
        return f"{neurons.name}, {weights.size:,} weights without loss of bits"
    rule = "a shared kernel" if _is_grid(layer) else "single synapses"
    return f"{neurons.name}, {rule} of {weights.size:,} weights"


def _is_whole(value: Any, allowed: range) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed


def _layers(file: str | PathLike[str], reset: int) -> tuple[Path, list[Layer]]:
    path = existing(file)
    if not _is_whole(reset, range(MOST + 1)):
        raise ModelError(f"reset = {reset!r}: expected a whole number >= 0 and <= {MOST}")
    record_input(path)
    return path, _read(path)


def _network(name: str, layers: list[Layer], reset: int, first: int) -> Network:
    """Build the network of layers that are not refused, from layer `first` on."""
    net = Network(name, resolution=1.0)
    populations = [layer for layer in layers if layer.kind != "flatten" and layer.number >= first]
    for layer in populations:
        if layer is populations[0] and layer.before:
            graded = layer.before.neuron["type"] == "SDNN"
            source = graded_spike_train() if graded else spike_generator()
            net.population(_name(layer.before), layer.before.shape, source)
        net.population(_name(layer), layer.shape, _neurons(layer, reset))
        if layer.before:
            rule, synapse, weight = _synapses(layer, layer.before)
            net.connect(_name(layer.before), _name(layer), rule, synapse, weight=weight, delay=1.0)
    return net


def _name(layer: Layer) -> str:
    return "input" if layer.kind == "input" else f"{layer.kind}{layer.number}"


def _neurons(layer: Layer, reset: int) -> Neuron:
    fields = layer.neuron
    layer_bias = layer.words.get("bias", np.zeros(1)) if layer.kind != "input" else np.zeros(1)
    bias: Any = np.broadcast_to(layer_bias.reshape(-1, *(1,) * (len(layer.shape) - 1)), layer.shape).copy()
    bias = bias if layer_bias.any() else 0.0
    if fields["type"] == "SDNN":
        exponents: dict[str, Any] = {"spike_exp": EXPONENT, "state_exp": EXPONENT}
        if layer.kind == "input":
            return sigma_delta(vth=float(fields["vThMant"]), relu=False, **exponents)
        if "sigma_output" in fields:
            return sigma_decoder()
        return sigma_delta(vth=float(fields["vThMant"]), bias=bias, **exponents)
    parameters = {"du": int(fields["iDecay"]) - 1, "dv": int(fields["vDecay"]), "vth": int(fields["vThMant"])}
    offset = (layer.depth + 1) % reset if reset else 0
    return loihi2_lif(**parameters, bias_mant=bias, bias_exp=EXPONENT, reset_interval=reset, reset_offset=offset)


def _synapses(layer: Layer, source: Layer) -> tuple[Rule, Synapse, Floats]:
    weight = layer.words["weight"]
    if layer.kind == "dense":
        synapse, mantissas = _dense(weight.reshape(layer.size, -1))
        return all_to_all(), synapse, mantissas.T.ravel()
    kernel, stride, padding = weight.reshape(weight.shape[:4]), layer.two("stride"), layer.two("padding")
    dilation = layer.two("dilation")
    if _is_grid(layer):
        rule = grid(kernel=kernel.shape[2:], stride=stride[0], padding=padding[0], column_padding=padding[1])
        return rule, loihi2_convolution(), kernel.ravel()
    channels, rows, columns = source.shape
    pre, post, weights = synapses_of((channels, rows, columns), kernel, stride, padding, dilation, layer.groups)
    return pairs(pre=pre, post=post), loihi2_convolution(), weights


def _is_grid(layer: Layer) -> bool:
    """Return whether the connection rule `grid` can express a convolution."""
    row_stride, column_stride = layer.two("stride")
    return row_stride == column_stride and layer.two("dilation") == (1, 1) and layer.groups == 1


def _dense(weight: Floats) -> tuple[Synapse, Floats]:
    """Return the synapse and the mantissas with which each weight keeps its value.

    Mantissas of mixed signs must be even. So odd weights of mixed signs are doubled, with an exponent of -1.
    """
    mode = "excitatory" if weight.min() >= 0 else "inhibitory" if weight.max() < 0 else "mixed"
    doubled = mode == "mixed" and bool(np.any(weight % 2))
    return loihi2_static(weight_exp=-1 if doubled else 0, sign_mode=mode), weight * (2.0 if doubled else 1.0)


def _problems(layer: Layer) -> list[ModelError]:
    """Return the reasons why a layer is refused."""
    problems = list(_refusals(layer))
    if not problems and layer.kind != "flatten":
        try:
            _neurons(layer, 0)
        except ModelError as error:
            problems = [layer.wrong(error.message, error.hint)]
    return problems


def _refusals(layer: Layer) -> Iterator[ModelError]:
    """Yield an error for each property that netx refuses or ignores."""
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
    for word, allowed in (("refDelay", (0, 1)), ("wgtExp", (0,))):
        if layer.neuron.get(word, allowed[0]) not in allowed:
            expected = " or ".join(map(str, allowed))
            yield layer.wrong(f"{word} = {layer.neuron[word]}: expected {expected}, since netx ignores {word}")
    if layer.neuron.get("activation", "relu") != "relu":
        yield layer.wrong(f"activation '{layer.neuron['activation']}': expected relu")
    if "delay" in layer.words:
        yield layer.wrong("its delays are ignored by netx", "train the network without delays")
    if (layer.kind == "input") == bool(layer.before):
        yield layer.wrong("expected one input layer, as the first")
    elif layer.before:
        yield from _weight_errors(layer, layer.before)


def _weight_errors(layer: Layer, source: Layer) -> Iterator[ModelError]:
    weight = layer.words.get("weight", np.zeros(0))
    if not weight.size:
        yield layer.wrong("its weights are missing")
        return
    if error := _convolution_error(layer, source) if layer.kind == "conv" else _dense_error(layer, source):
        yield layer.wrong(error)
    if (biases := layer.words.get("bias", np.zeros(1)).size) not in (1, layer.shape[0]):
        yield layer.wrong(f"{biases:,} biases: expected 1 or {layer.shape[0]:,}")
    if not np.array_equal(weight, np.rint(weight)):
        yield layer.wrong("its weights are not whole numbers", "export the network quantised")
    low, high = float(weight.min()), float(weight.max())
    is_doubled = layer.kind == "dense" and low < 0 <= high and bool(np.any(weight % 2))  # see `_dense`
    largest = 127 if is_doubled else 254
    if low < -largest - (layer.kind == "dense") or high > largest:
        yield layer.wrong(f"weights from {low:g} to {high:g}: a weight has 8 bits")


def _dense_error(layer: Layer, source: Layer) -> str:
    """Return the error in the number of weights, or ""."""
    expected, size = layer.size * source.size, layer.words["weight"].size
    if size == expected:
        return ""
    return f"{size:,} weights from {source.size:,} neurons to {layer.size:,}: expected {expected:,}"


def _convolution_error(layer: Layer, source_layer: Layer) -> str:
    """Return the error in the shapes of a convolution and its kernel, or ""."""
    kernel = layer.words["weight"]
    shapes = f"shape {list(layer.shape)} from {list(source_layer.shape)}"
    if len(layer.shape) != 3 or len(source_layer.shape) != 3:
        return f"{shapes}: expected 3 numbers each"
    if kernel.ndim < 4 or prod(kernel.shape[4:]) != 1:
        return f"weights of shape {list(kernel.shape)}: expected maps, channels, height, width"
    maps, depth, *size = kernel.shape[:4]
    if maps % layer.groups:
        return f"groups = {layer.groups}: expected a divisor of {maps} maps"
    sizes = (layer.two("stride"), layer.two("padding"), layer.two("dilation"))
    expected = [maps, *out_size(source_layer.shape[1:], tuple(size), *sizes)]
    expected_source = [depth * layer.groups, *source_layer.shape[1:]]
    if list(layer.shape) == expected and list(source_layer.shape) == expected_source:
        return ""
    return f"{shapes}: expected {expected} from {expected_source}"


def _read(path: Path) -> list[Layer]:
    """Read all layers of a file, in order."""
    try:
        with h5py.File(path, "r") as file:
            hdf5.check_tree(file, several_names=True)
            groups = file.get("layer")
            if not isinstance(groups, h5py.Group):
                raise ModelError("found no group 'layer': expected a network of lava-dl")
            layers: list[Layer] = []
            source = None
            for number in sorted(groups, key=int):
                layers.append(_layer(int(number), groups[number], source))
                source = source if layers[-1].kind == "flatten" else layers[-1]
            if source is None:
                raise ModelError("found no layers: expected at least one")
            return layers
    except ModelError as error:
        raise error.at(None, str(path)) from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{path}: cannot be read as a network of lava-dl: {error}") from None


def _layer(number: int, group: h5py.Group, source: Layer | None) -> Layer:
    place = f"layer {number}"
    fields = _fields(group, place)
    neuron = _fields(group["neuron"], f"{place}: its neuron") if "neuron" in group else {}
    for word in ("type", "shape"):
        if word not in fields:
            raise ModelError(f"{place} has no '{word}'")
    kind, shape = fields["type"], fields["shape"]
    return Layer(number, kind, (prod(shape),) if kind == "dense" else shape, neuron, fields, source)


def _fields(group: h5py.Group, place: str) -> dict[str, Any]:
    """Return the fields of a layer or of its neurons that are used here."""
    if not isinstance(group, h5py.Group):
        raise ModelError(f"{place} is not a group")
    names = (*TEXTS, *ARRAYS, *WHOLE, *PRESENT)
    return {word: _value(group[word], word, place.partition(":")[0]) for word in group if word in names}


def _value(item: h5py.Dataset, word: str, place: str) -> Any:
    """Return the value of a field: a text, an array, a whole number, a tuple of whole numbers, or True if present."""
    max_count, low = WHOLE.get(word, (1, 0))
    kind = ("a whole number", "1 or 2 whole numbers", "1 to 3 whole numbers")[max_count - 1]
    kind += "" if low == -MOST else f" >= {low}"
    expected = "a word" if word in TEXTS else "numbers" if word in ARRAYS else kind
    if not isinstance(item, h5py.Dataset):
        raise ModelError(f"{place}: {word} has no value: expected {expected}")
    value: NDArray[Any] = np.asarray(item[()])
    elements: list[Any] = [
        element.decode("ascii") if isinstance(element, bytes) else element for element in value.ravel()[:20].tolist()
    ]
    if word in PRESENT:
        return True
    if word in TEXTS and len(elements) == 1 and isinstance(elements[0], str):
        return elements[0]
    if word in ARRAYS and value.dtype.kind in "iuf":
        return value.astype(np.float64)
    are_whole = all(is_number(element) and low <= element <= MOST and element == int(element) for element in elements)
    if word in WHOLE and 1 <= len(elements) <= max_count and are_whole:
        return int(elements[0]) if max_count == 1 else tuple(map(int, elements))
    raise ModelError(f"{place}: {word} = {elements if value.shape else elements[0]!r:.60}: expected {expected}")
