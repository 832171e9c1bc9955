"""Convert a `Network` to a NIR graph, scaled for the tool that reads it."""

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
from neuro_exchange.nir.nodes import READOUT, ScaledNode, neuron_of
from neuro_exchange.verdict import APPROXIMATE, EXACT, REFUSED, Verdict, Verdicts


@dataclass(slots=True)
class Export:
    """A graph under construction.

    Attributes:
        nir: the package `nir`.
        program: the compiled network.
        tool: the convention.
        nodes: nodes by name.
        edges: (source, target) of each edge.
        neurons: node and scales of each population of neurons, by its index.
        shapes: shape of the node of each population, by its index.
        sheets: indices of the populations that a convolution may lead to. Their shapes have an axis of channels.
        lines: indices of the sheets with a single row, whose shape is (channels, columns) in the graph.
        depths: number of steps by which the spikes of each population are later here than in the tool, by its index.
        verdicts: verdicts of all parts of the network.
    """

    nir: Any
    program: Program
    tool: str
    nodes: dict[str, Any] = field(default_factory=dict)
    edges: list[tuple[str, str]] = field(default_factory=list)
    neurons: dict[int, ScaledNode] = field(default_factory=dict)
    shapes: dict[int, tuple[int, ...]] = field(default_factory=dict)
    sheets: set[int] = field(default_factory=set)
    lines: set[int] = field(default_factory=set)
    depths: dict[int, int] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)

    @property
    def step(self) -> float:
        """Length of a step in seconds."""
        return self.program.resolution / 1e3

    def add_verdict(self, part: Population | Projection, verdict: str, how: str, way_out: str = "") -> None:
        """Add the verdict of a part."""
        kind = part.model_name if isinstance(part, Population) else part.synapse.name
        self.verdicts.append(Verdict(part.name, kind, verdict, how, way_out))


def find_sheets(export: Export, spiking: Sequence[Projection]) -> None:
    """Find the populations between which a grid is a convolution, and set `sheets` and `lines`.

    The node of a sheet has an axis of channels. A population is no sheet if any of its inputs is not a convolution from
    a sheet, since only convolutions have channels.
    """
    grids = [p for p in spiking if p.grid is not None]
    export.sheets = {index for p in grids for index in (p.source, p.target)}
    for _ in range(len(export.sheets)):
        export.sheets -= {p.target for p in spiking if p.grid is None or p.source not in export.sheets}
    convolutions = [p for p in grids if is_convolution(export, p)]
    row_convolutions = [
        p
        for p in convolutions
        if p.grid is not None
        and (p.grid.height == p.grid.rows == 1 and p.grid.top < p.grid.kernel_height)
        and _pool(export, p) is None
    ]
    export.lines = {index for p in row_convolutions for index in (p.source, p.target)}
    for _ in range(len(export.lines)):
        others = [p for p in convolutions if p not in row_convolutions or not {p.source, p.target} <= export.lines]
        export.lines -= {index for p in others for index in (p.source, p.target)}


def is_convolution(export: Export, part: Projection) -> bool:
    """Return whether a projection is a convolution in the graph."""
    return part.grid is not None and {part.source, part.target} <= export.sheets


def shape_of(export: Export, index: int) -> tuple[int, ...]:
    """Return the shape of a population's node: with an axis of channels for sheets, flat for all other neurons."""
    part = export.program.populations[index]
    if index not in export.sheets:
        return (part.size,) if index in export.neurons else part.shape
    channels, rows, columns = part.shape if len(part.shape) == 3 else (1, *part.shape)
    return (channels, columns) if index in export.lines else (channels, rows, columns)


def has_even_border(g: Grid) -> bool:
    """Return whether the border after the last row and column is as wide as before the first."""
    rows = (g.height + 2 * g.top - g.kernel_height) // g.stride + 1
    return (g.rows, g.columns) == (rows, (g.width + 2 * g.left - g.kernel_width) // g.stride + 1)


def difference_within_map(export: Export, part: Projection, bias: Floats | None) -> str:
    """Name the parameter that differs between neurons of a map, which share a kernel and a bias; "" if none does."""
    shape = export.program.populations[part.target].shape
    if same_in_each_map(export.neurons[part.target].factor.reshape(shape)) is None:
        return "the scale of weights"
    return "" if bias is None or same_in_each_map(bias.reshape(shape)) is not None else "the constant current"


def _kernel(export: Export, part: Projection) -> Floats:
    """Return the weights of a grid in the scale of the tool, shape (maps, channels / groups, height, width)."""
    assert part.grid is not None
    factor = export.neurons[part.target].factor.reshape(part.grid.maps, -1)[:, 0]
    kernel: Floats = np.broadcast_to(part.weight, part.size).reshape(part.grid.kernels) * factor[:, None, None, None]
    return kernel


def _pool(export: Export, part: Projection) -> tuple[str, Floats] | None:
    """Return the type of the pool that equals a grid, and the factor of each map behind the pool.

    Returns None if the grid is not a pool, or if the tool has no such pool.
    """
    g = part.grid
    if (
        g is None
        or part.target not in export.neurons
        or not (g.depthwise and g.maps == g.channels and has_even_border(g))
    ):
        return None
    factor = same_in_each_map(_kernel(export, part))
    if factor is None:
        return None
    area, lacks = g.kernel_height * g.kernel_width, LACKS.get(export.tool, ())
    kinds = {"SumPool2d": factor, "AvgPool2d": factor * area}
    unscaled_kinds = [kind for kind, gain in kinds.items() if kind not in lacks and np.allclose(gain, 1.0, rtol=1e-12)]
    if unscaled_kinds and (export.tool == "nir" or not (g.top or g.left)):  # the tools treat a padding differently
        return unscaled_kinds[0], np.ones(g.maps)
    return None if "Scale" in lacks else ("SumPool2d", factor)


def convolution(export: Export, part: Projection, bias: Floats | None) -> tuple[dict[str, Any], str]:
    """Return the nodes of a grid by name, and their description for the verdict."""
    nir, g = export.nir, part.grid
    assert g is not None
    pool = _pool(export, part) if bias is None else None
    if pool is not None:
        kind, factor = pool
        size, stride = np.array([g.kernel_height, g.kernel_width]), np.array([g.stride, g.stride])
        chain = {part.name: getattr(nir, kind)(size, stride, np.array([g.top, g.left]))}
        if np.any(factor != 1.0):
            scale = np.broadcast_to(factor[:, None, None], (g.maps, g.rows, g.columns)).copy()
            chain[f"{part.name}.scale"] = nir.Scale(scale)
        return chain, kind + (" and Scale" if len(chain) > 1 else "")
    kernel, line = _kernel(export, part), part.source in export.lines
    groups = g.channels if g.depthwise else 1
    bias = np.zeros(g.maps) if bias is None else bias.reshape(g.maps, -1)[:, 0].copy()
    if line:
        padding = g.left if has_even_border(g) else "same"
        node = nir.Conv1d(g.width, kernel[:, :, g.top].copy(), g.stride, padding, 1, groups, bias)
    else:
        border = (g.top, g.left) if has_even_border(g) else "same"
        node = nir.Conv2d((g.height, g.width), kernel, g.stride, border, 1, groups, bias)
    description = type(node).__name__
    has_valid_shape = np.array_equal(node.input_type["input"], export.shapes[part.source])
    if not (has_valid_shape and np.array_equal(node.output_type["output"], export.shapes[part.target])):
        description += "; the package nir computes a wrong shape: nir.read opens the graph with type_check=False only"
    return {part.name: node}, description


READERS = ("norse", "snntorch", "sinabs", "spikingjelly", "nir")
"""Tools for which graphs are scaled."""

FOR = Quantity(doc="the tool that reads it", kind="word", words=READERS, optional=True)
DT = Quantity(unit="ms", doc="length of a step; that of the network if not given", above=0, optional=True)
CONVENTION = "neuro_convention"
"""Key of a graph's metadata for its convention."""


def _is_ours(path: Path) -> bool:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return CONVENTION in file.get("node/metadata", ())
    except OSError:
        return False


KIND = Kind("a NIR file of neuro", _is_ours)


def to_nir(net: Network, dt: float | None = None, for_: str | None = None) -> Any:
    """Return a NIR graph with the spikes of a network.

    All layers of a graph fire in the same step in the tools. So the spikes of a population d layers behind the input
    come d steps earlier in the tool than here, and are otherwise equal.

    Args:
        net: the network. Random parameters and connections are drawn with seed 0.
        dt: length of a step in ms; default and only valid value: the network's resolution.
        for_: the tool that reads the graph: "norse", "snntorch", "sinabs" or "spikingjelly"; default: the equations of
            NIR. No convention serves all tools.

    Returns:
        A `nir.NIRGraph` for `nir.write`. Its metadata holds the convention, and the verdicts as JSON.

    Raises:
        ModelError: parts have no counterpart in NIR, or the package nir is not installed. The error lists every refused
            part with the way out.
    """
    graph, table = export_graph(net, dt, for_)
    table.check()
    return graph


def export_graph(net: Network, dt: float | None, for_: str | None) -> tuple[Any, Verdicts]:
    """Return the graph of a network, or None if a part is refused, and the verdicts."""
    if not isinstance(net, Network):
        raise ModelError(f"to_nir: found {net!r:.60}: expected a Network")
    tool = check(FOR, for_, "for_", ("for_",)) or "nir"
    step = check(DT, dt, "dt", ("dt",))
    if step is not None and not math.isclose(step, net.resolution):
        message = f"dt = {step:g} ms: expected {net.resolution:g} ms, the resolution of the network"
        raise ModelError(message, hint=f"neuro.Network(..., resolution={step:g})", path=("dt",))
    export = Export(package("to_nir"), compile_network(net, seed=0), tool)
    for index, part in enumerate(export.program.populations):
        _scale(export, index, part)
    _find_depths(export)
    find_sheets(export, _spiking(export))
    for index, part in enumerate(export.program.populations):
        _add_population(export, index, part)
    for projection in export.program.projections:
        _add_projection(export, projection)
    sending_populations = {p.source for p in _spiking(export) if p.source != p.target}
    probed_populations = {probe.population for probe in export.program.probes}
    outputs = (
        [k for k in export.neurons if k not in sending_populations]
        or [k for k in export.neurons if k in probed_populations]
        or list(export.neurons)
    )
    for index in outputs:
        population = export.program.populations[index]
        name = "output" if "output" not in export.nodes else f"{population.name}_output"
        if export.neurons[index].kind == READOUT:
            name = population.name
        export.nodes[name] = export.nir.Output({"output": np.array(export.shapes[index])})
        if name != population.name:
            export.edges.append((population.name, name))
    table = Verdicts(f"{net.name}: for {tool}, steps of {net.resolution:g} ms", tuple(export.verdicts))
    if table.refused:
        return None, table
    try:
        # The tools compute in single precision.
        for node in export.nodes.values() if export.tool != "nir" else ():
            for word, value in vars(node).items():
                if isinstance(value, np.ndarray) and value.dtype == np.float64:
                    setattr(node, word, value.astype(np.float32))
        # `_add_projection` has checked the shapes. The package's own check computes some convolutions wrongly.
        graph = export.nir.NIRGraph(export.nodes, export.edges, type_check=False)
    except Exception as error:  # the package raises many kinds
        raise ModelError(f"to_nir: the package nir rejects the graph: {error}") from None
    if not table.exact:
        measured = _measure(export, net, graph)
        parts = (replace(v, measured=measured) if v.verdict == APPROXIMATE else v for v in table)
        table = replace(table, nodes=tuple(parts))
    graph.metadata = {CONVENTION: tool, STEP: net.resolution, "neuro_verdicts": table.to_json()}
    return graph, table


def _measure(export: Export, net: Network, graph: Any) -> str:
    """Return the difference in spikes between the network and its graph in the tool, as a phrase."""
    analysis = judge(graph, net.resolution, export.tool)
    if analysis.table().refused:
        return "not measured: the graph cannot be read back"
    parts = {part.name: index for index, part in enumerate(export.program.populations) if part.name in graph.nodes}
    depths = {name: export.depths[index] for name, index in parts.items()}
    differing = [verdict.node for verdict in analysis.table() if verdict.verdict == APPROXIMATE]
    return measure(analysis, net, {name: name for name in parts}, depths, differing)


def save_nir(net: Network, path: str | PathLike[str], dt: float | None = None, for_: str | None = None) -> Verdicts:
    """Write a network to a NIR file. All arguments but `path` are those of `to_nir`.

    Returns:
        The verdicts.

    Raises:
        ModelError: see `to_nir`; or the file cannot be written.
    """
    graph, table = export_graph(net, dt, for_)
    table.check()
    with output(path, KIND) as part, hdf5.disk(part) as file:
        package("to_nir").write(file, graph)
    return table


def _scale(export: Export, index: int, part: Population) -> None:
    """Choose the node of a population of neurons. A neuron that fires in every step becomes a bias and has no node."""
    if part.kind != "neuron" or _fires_every_step(export, index):
        return
    try:
        export.neurons[index] = neuron_of(part, export.tool, export.program.resolution)
    except Unsupported as error:
        export.add_verdict(part, REFUSED, error.why, error.way_out)


def _fires_every_step(export: Export, index: int) -> bool:
    """Return whether a population is one neuron that fires in every step. Its weights are biases in the graph."""
    part = export.program.populations[index]
    has_input = any(p.target == index for p in export.program.projections)
    if type(part.model) is not iaf_psc_delta or part.size != 1 or has_input:
        return False
    p = {word: float(values[0]) for word, values in part.parameters.items()}
    push: float = p["I_e"] * from_constant(p["tau_m"], p["C_m"], export.program.resolution)  # type: ignore[no-untyped-call]
    return p["t_ref"] == 0.0 and p["V_reset"] == p["E_L"] and p["E_L"] + push >= p["V_th"]


def _is_constant_current(export: Export, index: int) -> bool:
    """Return whether a population sends constant currents, which are biases in the graph."""
    part = export.program.populations[index]
    return isinstance(part.model, dc_generator) and part.stop >= NEVER


def _add_population(export: Export, index: int, part: Population) -> None:
    if part.model.graded:
        export.add_verdict(part, REFUSED, "its spikes have payloads, which NIR lacks", "leave it out")
    elif part.kind in ("listed", "poisson", "generator"):
        export.shapes[index] = shape_of(export, index)
        export.nodes[part.name] = export.nir.Input({"input": np.array(export.shapes[index])})
        has_spikes = part.spike_steps.size or part.kind != "listed"
        export.add_verdict(part, EXACT, "an Input" + ("; its spikes are not part of the graph" if has_spikes else ""))
    elif part.kind == "current":
        if not _is_constant_current(export, index):
            export.add_verdict(part, REFUSED, "its current is not constant", "leave it out, or set I_e of the neurons")
        else:
            export.add_verdict(part, EXACT, "the bias of the nodes that it drives")
    elif _fires_every_step(export, index):
        export.add_verdict(part, EXACT, "the bias of the nodes that it drives")
    elif index in export.neurons:
        node = export.neurons[index]
        export.shapes[index] = shape_of(export, index)
        if node.kind != READOUT:
            fields = {word: values.reshape(export.shapes[index]) for word, values in node.fields.items()}
            export.nodes[part.name] = getattr(export.nir, node.kind)(**fields)
        depth = export.depths[index]
        if not any(p.target == index for p in _spiking(export)):
            export.add_verdict(
                part, REFUSED, "receives no spikes: a graph has no such node", "connect it, or leave it out"
            )
        elif node.bias.any() and depth:
            note = f"{node.how}; its constant current begins {some(depth, 'step')} later in the tool"
            export.add_verdict(part, APPROXIMATE, note, "send the current by a dc_generator with that delay")
        else:
            export.add_verdict(part, EXACT, f"{node.how}; {some(depth, 'step')} later here")


def _layer(export: Export, part: Projection) -> int:
    """Return the number of steps from a spike to its effect on V_m, for the shortest delay."""
    model = export.program.populations[part.target].model
    return 2 if isinstance(model, iaf_psc_exp) and not isinstance(model, cuba_lif) else 1


def _spiking(export: Export) -> list[Projection]:
    """Return the projections that send spikes to neurons, without those that are biases in the graph."""
    spiking = [p for p in export.program.projections if p.carries == "spikes" and p.target in export.neurons]
    return [p for p in spiking if not _fires_every_step(export, p.source)]


def _find_depths(export: Export) -> None:
    """Compute `depths`: the steps by which the spikes of each population are later here than in the tool.

    A population is one layer behind the source of a connection with the shortest delay. Otherwise its depth is the
    number of layers on the shortest path from the generators. The depth of a population with constant inputs is at
    least the number of steps before the first input begins. The part of a delay that exceeds the difference of the
    depths becomes a Delay node, e.g. delays of 6 and 1 steps from the input to two populations become 5 and 0.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count = len(export.program.populations)
    forward = [p for p in _spiking(export) if p.source != p.target]
    layers = [(p.source, p.target, _layer(export, p)) for p in forward]
    hops = [math.inf if k in export.neurons else 0.0 for k in range(count)]
    shorten(hops, layers)
    depths = [0 if hop == math.inf else hop for hop in hops]
    for target in export.neurons:
        begins = [_begin(export, p) for p in _constants(export, target)]
        depths[target] = max(depths[target], min(begins, default=1) - 1)
    ends = [p.source for p in forward], [p.target for p in forward]
    loop = connected_components(csr_array((np.ones(len(forward)), ends), shape=(count, count)), connection="strong")[1]
    direct_edges = [
        (source, target, steps)
        for part, (source, target, steps) in zip(forward, layers, strict=True)
        if part.delay_span[0] == 1
        # Within a loop, only connections away from the input count.
        and (loop[source] != loop[target] or (hops[source], source) < (hops[target], target))
    ]
    for _ in range(count):
        for source, target, steps in direct_edges:
            depths[target] = max(depths[target], depths[source] + steps)
    # A Delay cannot be negative.
    shorten(depths, [(p.source, p.target, (int(p.delay_span[0]) - 1 + _layer(export, p))) for p in forward])
    export.depths.update((k, int(depth)) for k, depth in enumerate(depths))


def _constants(export: Export, target: int) -> list[Projection]:
    """Return the projections that give a population a constant input."""
    projections = [p for p in export.program.projections if p.target == target]
    return [p for p in projections if _is_constant_current(export, p.source) or _fires_every_step(export, p.source)]


def _begin(export: Export, part: Projection) -> int:
    """Return the first step, counted from 1, of a constant input."""
    start = 2 + export.program.populations[part.source].start if part.carries == "current" else 1
    return int(part.delay_span[0]) + start


def _steps_of_delay(export: Export, part: Projection) -> NDArray[np.int64] | None:
    """Return the steps of the Delay behind each source neuron, or None if the synapses of a neuron have several."""
    is_recurrent = part.source == part.target
    extra_steps = _layer(export, part) - 1 + export.depths[part.source] - export.depths[part.target] - is_recurrent
    size = export.program.populations[part.source].size
    if part.delay_span[0] == part.delay_span[1]:
        return np.full(size, extra_steps + part.delay_span[0], dtype=np.int64)
    pre, _, slot = export.program.synapses(export.program.projections.index(part))
    steps = np.broadcast_to(part.delay, part.size)[slot].astype(np.int64)
    source_steps = np.full(size, part.delay_span[0], dtype=np.int64)
    source_steps[pre] = steps
    return source_steps + extra_steps if np.all(source_steps[pre] == steps) else None


def _add_projection(export: Export, part: Projection) -> None:
    if part not in _spiking(export) or part.source not in export.shapes:
        return
    source, target = export.program.populations[part.source], export.program.populations[part.target]
    if part.synapse.learns:
        export.add_verdict(
            part, REFUSED, f"{part.synapse.name} learns", "freeze it: give a static synapse the learnt weights"
        )
        return
    lags = _steps_of_delay(export, part)
    if lags is None:
        export.add_verdict(
            part, REFUSED, "has several delays from one neuron", "give each delay a projection of its own"
        )
        return
    bias = _bias_of(export, part)
    convolves = is_convolution(export, part)
    if convolves and (word := difference_within_map(export, part, bias)):
        export.add_verdict(part, REFUSED, f"{word} differs within a map of '{target.name}'", "give a map equal neurons")
        return
    if convolves and part.grid and not has_even_border(part.grid) and (part.grid.stride > 1 or export.tool == "sinabs"):
        export.add_verdict(
            part, REFUSED, "has an uneven border, which Conv2d lacks", "give the grid a padding in numbers"
        )
        return
    chain = {}
    if lags.any():
        chain[f"{part.name}.delay"] = export.nir.Delay(lags.reshape(export.shapes[part.source]) * export.step)
    if not convolves and len(export.shapes[part.source]) > 1:
        chain[f"{part.name}.flatten"] = export.nir.Flatten({"input": np.array(export.shapes[part.source])}, 0, -1)
    weights, note = convolution(export, part, bias) if convolves else _weights(export, part, bias)
    chain |= weights
    export.nodes |= chain
    export.edges += pairwise((source.name, *chain, target.name))
    if getattr(chain[part.name], "groups", 1) > 1 and export.tool == "spikingjelly":
        export.add_verdict(
            part, REFUSED, "spikingjelly reads no convolution in groups", "use a grid that is not depthwise"
        )
        return
    if lags.any() and "Delay" in LACKS.get(export.tool, ()):
        reason = f"its delay exceeds one step per layer by {some(int(lags.max()), 'step')}: {export.tool} has no Delay"
        export.add_verdict(part, REFUSED, reason, f"give it a delay of {export.program.resolution:g} ms")
    elif part.source == part.target and export.tool == "snntorch":
        note += "; snnTorch 1.0's importer fails with nirtorch 2.6, or sends the input through it, too"
        export.add_verdict(part, APPROXIMATE, note)
    else:
        export.add_verdict(part, EXACT, note)


def _weights(export: Export, part: Projection, bias: Floats | None) -> tuple[dict[str, Any], str]:
    """Return the node of a projection that is not a convolution, and its description for the verdict."""
    source, target = export.program.populations[part.source], export.program.populations[part.target]
    index = export.program.projections.index(part)
    pre, post, slot = export.program.synapses(index)
    matrix = np.zeros((target.size, source.size))
    np.add.at(matrix, (post, pre), np.broadcast_to(part.weight, part.size)[slot])
    matrix *= export.neurons[part.target].factor.reshape(-1, 1)
    if bias is None:
        return {part.name: export.nir.Linear(weight=matrix)}, "Linear"
    return {part.name: export.nir.Affine(weight=matrix, bias=bias)}, "Affine, with the constant current as its bias"


def _bias_of(export: Export, part: Projection) -> Floats | None:
    """Return the bias of a projection, or None if all its elements are 0.

    The first projection to a population carries all of the population's constant input. An input that begins one step
    late is the bias of the recurrent projection in tools whose recurrent weights act from the second step on.
    """
    incoming = [p for p in _spiking(export) if p.target == part.target]
    first = next((p for p in incoming if p.source != p.target), incoming[0])
    recurrent = next((p for p in incoming if p.source == p.target), None) if export.tool in BY_GRAPH_EXECUTOR else None
    node = export.neurons[part.target]
    total = node.bias * (part is first)
    for constant in _constants(export, part.target):
        source = export.program.populations[constant.source]
        steps_late = _begin(export, constant) - export.depths[part.target] - 1
        carrier = recurrent if recurrent is not None and steps_late == 1 else first
        if part is not carrier:
            continue
        pre, post, slot = export.program.synapses(export.program.projections.index(constant))
        values = np.broadcast_to(constant.weight, constant.size)[slot]
        if constant.carries == "current" and node.per_pa is not None:
            values = values * np.broadcast_to(source.parameters["amplitude"], source.size)[pre] * node.per_pa[post]
        elif constant.carries == "current":
            export.add_verdict(
                constant, REFUSED, "acts behind the synapse of a CubaLIF, and a bias before it", "leave it out"
            )
        else:
            values = values * node.factor[post]
        np.add.at(total, post, values)
        if steps_late - (carrier is recurrent):
            order = "later" if steps_late > 0 else "earlier"
            export.add_verdict(constant, APPROXIMATE, f"begins {some(abs(steps_late), 'step')} {order} here")
    return total if total.any() else None
