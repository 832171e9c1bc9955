"""A NIR graph from a `Network`, scaled for the tool that reads it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError, Network, cuba_lif, dc_generator, iaf_psc_delta, iaf_psc_exp
from neuro.apps import NEVER, Kind, Quantity, check, compile_network, hdf5, output, some
from neuro.extend import Grid, Population, Program, Projection, from_constant
from neuro_exchange.nir.cells import BY_GRAPH_EXECUTOR, Unsupported
from neuro_exchange.nir.graph import Floats, package, same_in_each_map, shorten
from neuro_exchange.nir.judging import LACKS, STEP, judge
from neuro_exchange.nir.measured import measure
from neuro_exchange.nir.nodes import READOUT, Scaled, neuron_of
from neuro_exchange.verdict import APPROXIMATE, EXACT, REFUSED, Verdict, Verdicts


@dataclass(slots=True)
class Written:
    """A graph under construction.

    Attributes:
        nir: the package.
        program: the network, resolved.
        tool: the convention.
        nodes, edges: of the graph.
        neurons: by population, what it is.
        shapes: of their nodes, by population.
        sheets: populations that a convolution may lead to, whose shapes have an axis of channels.
        lines: those with one row, which are (channels, columns) in the graph.
        depths: by population, by how many steps its spikes are later here than in a tool without delays.
        verdicts: of each part of the network.
    """

    nir: Any
    program: Program
    tool: str
    nodes: dict[str, Any] = field(default_factory=dict)
    edges: list[tuple[str, str]] = field(default_factory=list)
    neurons: dict[int, Scaled] = field(default_factory=dict)
    shapes: dict[int, tuple[int, ...]] = field(default_factory=dict)
    sheets: set[int] = field(default_factory=set)
    lines: set[int] = field(default_factory=set)
    depths: dict[int, int] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)

    @property
    def step(self) -> float:
        """Seconds."""
        return self.program.resolution / 1e3

    def says(self, part: Population | Projection, verdict: str, how: str, way_out: str = "") -> None:
        """The verdict of a part."""
        kind = part.said if isinstance(part, Population) else part.synapse.name
        self.verdicts.append(Verdict(part.name, kind, verdict, how, way_out))


def find_sheets(out: Written, spiking: Sequence[Projection]) -> None:
    """Find the populations between which a grid is a convolution.

    What reaches neurons otherwise than by a convolution has no axis of channels, so that they are no sheet.
    """
    grids = [p for p in spiking if p.grid is not None]
    out.sheets = {index for p in grids for index in (p.source, p.target)}
    for _ in range(len(out.sheets)):
        out.sheets -= {p.target for p in spiking if p.grid is None or p.source not in out.sheets}
    between = [p for p in grids if on_sheets(out, p)]
    in_rows = [
        p
        for p in between
        if p.grid is not None
        and (p.grid.height == p.grid.rows == 1 and p.grid.top < p.grid.kernel_height)
        and _pool(out, p) is None
    ]
    out.lines = {index for p in in_rows for index in (p.source, p.target)}
    for _ in range(len(out.lines)):
        others = [p for p in between if p not in in_rows or not {p.source, p.target} <= out.lines]
        out.lines -= {index for p in others for index in (p.source, p.target)}


def on_sheets(out: Written, part: Projection) -> bool:
    """Whether a projection is a convolution in the graph."""
    return part.grid is not None and {part.source, part.target} <= out.sheets


def shape_of(out: Written, index: int) -> tuple[int, ...]:
    """The shape of a population's node: of a sheet with an axis of channels, of other neurons flat."""
    part = out.program.populations[index]
    if index not in out.sheets:
        return (part.size,) if index in out.neurons else part.shape
    channels, rows, columns = part.shape if len(part.shape) == 3 else (1, *part.shape)
    return (channels, columns) if index in out.lines else (channels, rows, columns)


def even(g: Grid) -> bool:
    """Whether the border is as wide after the sheet as before it."""
    rows = (g.height + 2 * g.top - g.kernel_height) // g.stride + 1
    return (g.rows, g.columns) == (rows, (g.width + 2 * g.left - g.kernel_width) // g.stride + 1)


def differing(out: Written, part: Projection, bias: Floats | None) -> str:
    """Name what differs between the neurons of a map, which share the kernel and the bias of a convolution."""
    shape = out.program.populations[part.target].shape
    if same_in_each_map(out.neurons[part.target].factor.reshape(shape)) is None:
        return "the scale of weights"
    return "" if bias is None or same_in_each_map(bias.reshape(shape)) is not None else "the constant current"


def _kernel(out: Written, part: Projection) -> Floats:
    """The weights of a grid in the scale of the tool, (maps, channels / groups, height, width)."""
    assert part.grid is not None
    factor = out.neurons[part.target].factor.reshape(part.grid.maps, -1)[:, 0]
    kernel: Floats = np.broadcast_to(part.weight, part.size).reshape(part.grid.kernels) * factor[:, None, None, None]
    return kernel


def _pool(out: Written, part: Projection) -> tuple[str, Floats] | None:
    """The pool that a grid is, and the factor of each map behind it; None where the tool has none such."""
    g = part.grid
    if g is None or part.target not in out.neurons or not (g.depthwise and g.maps == g.channels and even(g)):
        return None
    factor = same_in_each_map(_kernel(out, part))
    if factor is None:
        return None
    area, lacks = g.kernel_height * g.kernel_width, LACKS.get(out.tool, ())
    kinds = {"SumPool2d": factor, "AvgPool2d": factor * area}
    plain = [kind for kind, left in kinds.items() if kind not in lacks and np.allclose(left, 1.0, rtol=1e-12)]
    if plain and (out.tool == "nir" or not (g.top or g.left)):  # the tools differ in what they do with a padding
        return plain[0], np.ones(g.maps)
    return None if "Scale" in lacks else ("SumPool2d", factor)


def convolution(out: Written, part: Projection, bias: Floats | None) -> tuple[dict[str, Any], str]:
    """The nodes of a grid, and what they are."""
    nir, g = out.nir, part.grid
    assert g is not None
    pool = _pool(out, part) if bias is None else None
    if pool is not None:
        kind, factor = pool
        size, stride = np.array([g.kernel_height, g.kernel_width]), np.array([g.stride, g.stride])
        chain = {part.name: getattr(nir, kind)(size, stride, np.array([g.top, g.left]))}
        if np.any(factor != 1.0):
            scale = np.broadcast_to(factor[:, None, None], (g.maps, g.rows, g.columns)).copy()
            chain[f"{part.name}.scale"] = nir.Scale(scale)
        return chain, kind + (" and Scale" if len(chain) > 1 else "")
    kernel, line = _kernel(out, part), part.source in out.lines
    groups = g.channels if g.depthwise else 1
    bias = np.zeros(g.maps) if bias is None else bias.reshape(g.maps, -1)[:, 0].copy()
    if line:
        padding = g.left if even(g) else "same"
        node = nir.Conv1d(g.width, kernel[:, :, g.top].copy(), g.stride, padding, 1, groups, bias)
    else:
        border = (g.top, g.left) if even(g) else "same"
        node = nir.Conv2d((g.height, g.width), kernel, g.stride, border, 1, groups, bias)
    how = type(node).__name__
    fits = np.array_equal(node.input_type["input"], out.shapes[part.source])
    if not (fits and np.array_equal(node.output_type["output"], out.shapes[part.target])):
        how += "; the package nir works out its shape wrongly: nir.read opens the graph with type_check=False only"
    return {part.name: node}, how


READERS = ("norse", "snntorch", "sinabs", "spikingjelly", "nir")
"""The tools for which graphs are scaled."""

FOR = Quantity(doc="the tool that reads it", kind="word", words=READERS, optional=True)
DT = Quantity(unit="ms", doc="length of a step; that of the network if not given", above=0, optional=True)
CONVENTION = "neuro_convention"
"""The word of a graph's metadata that says the convention in which it was written."""


def _is_ours(path: Path) -> bool:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return CONVENTION in file.get("node/metadata", ())
    except OSError:
        return False


KIND = Kind("a NIR file of neuro", _is_ours)


def to_nir(net: Network, dt: float | None = None, for_: str | None = None) -> Any:
    """A NIR graph of a network.

    Spikes of the network are those of the graph in the convention of the tool, except that layers of a graph fire in
    the same step: the spikes of a population d layers behind the input come d steps earlier there.

    Args:
        net: the network. What is drawn at random is drawn with seed 0.
        dt: length of a step, ms: the network's resolution, if not given.
        for_: the tool that reads the graph: "norse", "snntorch", "sinabs" or "spikingjelly"; the equations of NIR if
            not given. No convention serves all.

    Returns:
        A `nir.NIRGraph`, for `nir.write`. Its metadata holds the convention, and the verdicts as JSON.

    Raises:
        ModelError: a part has no counterpart; all of them, each with the way out. Or the package nir is missing.
    """
    graph, table = written(net, dt, for_)
    table.check()
    return graph


def written(net: Network, dt: float | None, for_: str | None) -> tuple[Any, Verdicts]:
    """The graph of a network, None where a part is refused, and the verdicts."""
    if not isinstance(net, Network):
        raise ModelError(f"to_nir: found {net!r:.60}: expected a Network")
    tool = check(FOR, for_, "for_", ("for_",)) or "nir"
    step = check(DT, dt, "dt", ("dt",))
    if step is not None and not math.isclose(step, net.resolution):
        message = f"dt = {step:g} ms: expected {net.resolution:g} ms, the resolution of the network"
        raise ModelError(message, hint=f"neuro.Network(..., resolution={step:g})", path=("dt",))
    out = Written(package("to_nir"), compile_network(net, seed=0), tool)
    for index, part in enumerate(out.program.populations):
        _scale(out, index, part)
    _find_depths(out)
    find_sheets(out, _spiking(out))
    for index, part in enumerate(out.program.populations):
        _add_population(out, index, part)
    for projection in out.program.projections:
        _add_projection(out, projection)
    sending = {p.source for p in _spiking(out) if p.source != p.target}
    probed = {probe.population for probe in out.program.probes}
    ends = [k for k in out.neurons if k not in sending] or [k for k in out.neurons if k in probed] or list(out.neurons)
    for index in ends:
        population = out.program.populations[index]
        name = "output" if "output" not in out.nodes else f"{population.name}_output"
        if out.neurons[index].kind == READOUT:
            name = population.name
        out.nodes[name] = out.nir.Output({"output": np.array(out.shapes[index])})
        if name != population.name:
            out.edges.append((population.name, name))
    table = Verdicts(f"{net.name}: for {tool}, steps of {net.resolution:g} ms", tuple(out.verdicts))
    if table.refused:
        return None, table
    try:
        # The package works out the size of some convolutions wrongly; `_add_projection` has made sure that all fit.
        # The nodes, for a tool in the single precision in which it computes.
        for node in out.nodes.values() if out.tool != "nir" else ():
            for word, value in vars(node).items():
                if isinstance(value, np.ndarray) and value.dtype == np.float64:
                    setattr(node, word, value.astype(np.float32))
        graph = out.nir.NIRGraph(out.nodes, out.edges, type_check=False)
    except Exception as error:  # the package raises many kinds
        raise ModelError(f"to_nir: the package nir refuses the graph: {error}") from None
    if not table.exact:
        measured = _measured(out, net, graph)
        parts = (replace(each, measured=measured) if each.verdict == APPROXIMATE else each for each in table)
        table = replace(table, nodes=tuple(parts))
    graph.metadata = {CONVENTION: tool, STEP: net.resolution, "neuro_verdicts": table.to_json()}
    return graph, table


def _measured(out: Written, net: Network, graph: Any) -> str:
    """By how much the graph differs in the tool, with all that is approximate."""
    found = judge(graph, net.resolution, out.tool)
    if found.table().refused:
        return "not measured: the graph does not come in again"
    parts = {part.name: index for index, part in enumerate(out.program.populations) if part.name in graph.nodes}
    depths = {name: out.depths[index] for name, index in parts.items()}
    differing = [each.node for each in found.table() if each.verdict == APPROXIMATE]
    return measure(found, net, {name: name for name in parts}, depths, differing)


def save_nir(net: Network, path: str | PathLike[str], dt: float | None = None, for_: str | None = None) -> Verdicts:
    """Write a network as a NIR file; other arguments as of `to_nir`.

    Returns:
        The verdicts.

    Raises:
        ModelError: as of `to_nir`, or the file cannot be written.
    """
    graph, table = written(net, dt, for_)
    table.check()
    with output(path, KIND) as part, hdf5.disk(part) as file:
        package("to_nir").write(file, graph)
    return table


def _scale(out: Written, index: int, part: Population) -> None:
    """What the neurons of a population are; generators, and a neuron that fires in every step, are none of them."""
    if part.kind != "neuron" or _ticks(out, index):
        return
    try:
        out.neurons[index] = neuron_of(part, out.tool, out.program.resolution)
    except Unsupported as error:
        out.says(part, REFUSED, error.why, error.way_out)


def _ticks(out: Written, index: int) -> bool:
    """Whether a population is one neuron that fires in every step, whose weights are biases."""
    part = out.program.populations[index]
    heard = any(p.target == index for p in out.program.projections)
    if type(part.model) is not iaf_psc_delta or part.size != 1 or heard:
        return False
    p = {word: float(values[0]) for word, values in part.parameters.items()}
    push: float = p["I_e"] * from_constant(p["tau_m"], p["C_m"], out.program.resolution)  # type: ignore[no-untyped-call]
    return p["t_ref"] == 0.0 and p["V_reset"] == p["E_L"] and p["E_L"] + push >= p["V_th"]


def _constant(out: Written, index: int) -> bool:
    """Whether a population gives constant currents, which are biases."""
    part = out.program.populations[index]
    return isinstance(part.model, dc_generator) and part.stop >= NEVER


def _add_population(out: Written, index: int, part: Population) -> None:
    if part.model.graded:
        out.says(part, REFUSED, "its spikes carry payloads, and those of NIR carry none", "leave it out")
    elif part.kind in ("listed", "poisson", "generator"):
        out.shapes[index] = shape_of(out, index)
        out.nodes[part.name] = out.nir.Input({"input": np.array(out.shapes[index])})
        listed = part.spike_steps.size or part.kind != "listed"
        out.says(part, EXACT, "an Input" + ("; its spikes stay here" if listed else ""))
    elif part.kind == "current":
        if not _constant(out, index):
            out.says(part, REFUSED, "is a current that changes", "leave it out, or give the neurons I_e")
        else:
            out.says(part, EXACT, "the bias of the nodes that it drives")
    elif _ticks(out, index):
        out.says(part, EXACT, "the bias of the nodes that it drives")
    elif index in out.neurons:
        made = out.neurons[index]
        out.shapes[index] = shape_of(out, index)
        if made.kind != READOUT:
            fields = {word: values.reshape(out.shapes[index]) for word, values in made.fields.items()}
            out.nodes[part.name] = getattr(out.nir, made.kind)(**fields)
        depth = out.depths[index]
        if not any(p.target == index for p in _spiking(out)):
            out.says(part, REFUSED, "receives no spikes: a graph has no such node", "connect it, or leave it out")
        elif made.bias.any() and depth:
            how = f"{made.how}; its constant current begins {some(depth, 'step')} later there"
            out.says(part, APPROXIMATE, how, "send the current by a dc_generator with that delay")
        else:
            out.says(part, EXACT, f"{made.how}; {some(depth, 'step')} later here")


def _layer(out: Written, part: Projection) -> int:
    """Steps that a spike takes until it acts on V_m, with the shortest delay."""
    model = out.program.populations[part.target].model
    return 2 if isinstance(model, iaf_psc_exp) and not isinstance(model, cuba_lif) else 1


def _spiking(out: Written) -> list[Projection]:
    """Projections of spikes among generators and neurons, but those that are biases."""
    found = [p for p in out.program.projections if p.carries == "spikes" and p.target in out.neurons]
    return [p for p in found if not _ticks(out, p.source)]


def _find_depths(out: Written) -> None:
    """Choose by how many steps the spikes of each population are later here.

    A population is one layer behind the source of a connection without extra delay, and so many layers behind the
    generators as its shortest way from them has. Its constant current begins with its layer. Steps beyond those of
    the layers become Delay nodes, e.g. delays of 6 and 1 steps onto two populations of the first layer: 5 and 0.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count = len(out.program.populations)
    forward = [p for p in _spiking(out) if p.source != p.target]
    layers = [(p.source, p.target, _layer(out, p)) for p in forward]
    hops = [math.inf if k in out.neurons else 0.0 for k in range(count)]
    shorten(hops, layers)
    depths = [0 if hop == math.inf else hop for hop in hops]
    for target in out.neurons:
        begins = [_begin(out, p) for p in _constants(out, target)]
        depths[target] = max(depths[target], min(begins, default=1) - 1)
    ends = [p.source for p in forward], [p.target for p in forward]
    loop = connected_components(csr_array((np.ones(len(forward)), ends), shape=(count, count)), connection="strong")[1]
    direct = [
        (source, target, steps)
        for part, (source, target, steps) in zip(forward, layers, strict=True)
        if part.delay_span[0] == 1 and (loop[source] != loop[target] or (hops[source], source) < (hops[target], target))
    ]
    for _ in range(count):
        for source, target, steps in direct:
            depths[target] = max(depths[target], depths[source] + steps)
    shorten(
        depths, [(p.source, p.target, (int(p.delay_span[0]) - 1 + _layer(out, p))) for p in forward]
    )  # no Delay is negative
    out.depths.update((k, int(depth)) for k, depth in enumerate(depths))


def _constants(out: Written, target: int) -> list[Projection]:
    """Projections that give a population a constant input."""
    onto = [p for p in out.program.projections if p.target == target]
    return [p for p in onto if _constant(out, p.source) or _ticks(out, p.source)]


def _begin(out: Written, part: Projection) -> int:
    """The step, from 1, in which a constant input begins."""
    start = 2 + out.program.populations[part.source].start if part.carries == "current" else 1
    return int(part.delay_span[0]) + start


def _steps_of_delay(out: Written, part: Projection) -> NDArray[np.int64] | None:
    """Steps of the Delay behind each neuron of the source; None where the synapses of a neuron have several."""
    back = 1 if part.source == part.target else 0
    beyond = _layer(out, part) - 1 + out.depths[part.source] - out.depths[part.target] - back
    size = out.program.populations[part.source].size
    if part.delay_span[0] == part.delay_span[1]:
        return np.full(size, beyond + part.delay_span[0], dtype=np.int64)
    pre, _, slot = out.program.synapses(out.program.projections.index(part))
    steps = np.broadcast_to(part.delay, part.size)[slot].astype(np.int64)
    of_source = np.full(size, part.delay_span[0], dtype=np.int64)
    of_source[pre] = steps
    return of_source + beyond if np.all(of_source[pre] == steps) else None


def _add_projection(out: Written, part: Projection) -> None:
    if part not in _spiking(out) or part.source not in out.shapes:
        return
    source, target = out.program.populations[part.source], out.program.populations[part.target]
    if part.synapse.learns:
        out.says(part, REFUSED, f"{part.synapse.name} learns", "freeze it: give a static synapse the learnt weights")
        return
    back = part.source == part.target
    lags = _steps_of_delay(out, part)
    if lags is None:
        out.says(part, REFUSED, "has several delays from one neuron", "give each delay a projection of its own")
        return
    bias = _bias_of(out, part)
    slides = on_sheets(out, part)
    if slides and (what := differing(out, part, bias)):
        out.says(part, REFUSED, f"{what} differs within a map of '{target.name}'", "give a map equal neurons")
        return
    if slides and part.grid and not even(part.grid) and (part.grid.stride > 1 or out.tool == "sinabs"):
        out.says(part, REFUSED, "has an uneven border, which a Conv2d has not", "give the grid a padding in numbers")
        return
    chain = {}
    if lags.any():
        chain[f"{part.name}.delay"] = out.nir.Delay(lags.reshape(out.shapes[part.source]) * out.step)
    if not slides and len(out.shapes[part.source]) > 1:
        chain[f"{part.name}.flatten"] = out.nir.Flatten({"input": np.array(out.shapes[part.source])}, 0, -1)
    weights, how = convolution(out, part, bias) if slides else _weights(out, part, bias)
    chain |= weights
    out.nodes |= chain
    out.edges += pairwise((source.name, *chain, target.name))
    if getattr(chain[part.name], "groups", 1) > 1 and out.tool == "spikingjelly":
        out.says(part, REFUSED, "spikingjelly reads no convolution in groups", "use a grid that is not depthwise")
        return
    if lags.any() and "Delay" in LACKS.get(out.tool, ()):
        why = f"a delay of {some(int(lags.max()), 'step')} beyond one a layer: {out.tool} has no Delay"
        out.says(part, REFUSED, why, f"give it a delay of {out.program.resolution:g} ms")
    elif back and out.tool == "snntorch":
        how += "; where snnTorch 1.0's importer does not fail with nirtorch 2.6, it sends the input through it, too"
        out.says(part, APPROXIMATE, how)
    else:
        out.says(part, EXACT, how)


def _weights(out: Written, part: Projection, bias: Floats | None) -> tuple[dict[str, Any], str]:
    """The node of a projection that is no convolution, and what it is."""
    source, target = out.program.populations[part.source], out.program.populations[part.target]
    index = out.program.projections.index(part)
    pre, post, slot = out.program.synapses(index)
    matrix = np.zeros((target.size, source.size))
    np.add.at(matrix, (post, pre), np.broadcast_to(part.weight, part.size)[slot])
    matrix *= out.neurons[part.target].factor.reshape(-1, 1)
    if bias is None:
        return {part.name: out.nir.Linear(weight=matrix)}, "Linear"
    return {part.name: out.nir.Affine(weight=matrix, bias=bias)}, "Affine, with the constant current as its bias"


def _bias_of(out: Written, part: Projection) -> Floats | None:
    """The constant input of the target, for the first projection onto it.

    What begins a step late is that of recurrent weights, where a tool begins them a step late.
    """
    onto = [p for p in _spiking(out) if p.target == part.target]
    first = next((p for p in onto if p.source != p.target), onto[0])
    back = next((p for p in onto if p.source == p.target), None) if out.tool in BY_GRAPH_EXECUTOR else None
    made = out.neurons[part.target]
    total = made.bias * (part is first)
    for other in _constants(out, part.target):
        source = out.program.populations[other.source]
        late = _begin(out, other) - out.depths[part.target] - 1
        of = back if back is not None and late == 1 else first
        if part is not of:
            continue
        pre, post, slot = out.program.synapses(out.program.projections.index(other))
        values = np.broadcast_to(other.weight, other.size)[slot]
        if other.carries == "current" and made.per_pa is not None:
            values = values * np.broadcast_to(source.parameters["amplitude"], source.size)[pre] * made.per_pa[post]
        elif other.carries == "current":
            out.says(other, REFUSED, "goes past the synapse of a CubaLIF, and no bias does", "leave it out")
        else:
            values = values * made.factor[post]
        np.add.at(total, post, values)
        if late - (of is back):
            out.says(other, APPROXIMATE, f"begins {some(abs(late), 'step')} {'later' if late > 0 else 'earlier'} here")
    return total if total.any() else None
