"""Reads a NIR graph from a file or a `nir.NIRGraph`, and checks it."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.inputs import record_input
from neuro.core.paths import existing
from neuro.exchange.nir.graph import FIELDS, Graph, Node, Shape, package
from neuro.exchange.nir.maps import outcome

LARGEST = 2**28
"""Elements of a shape; more is taken for damage."""


def read(source: Any) -> Graph:
    """A graph from a file or a `nir.NIRGraph`.

    Raises:
        ModelError: the file is not there or damaged, it is no graph, or the graph is not consistent.
    """
    if isinstance(source, (str, PathLike)):
        path = existing(source)
        record_input(path)
        try:
            return _flat(_from_file(path), str(path))
        except ModelError as error:
            raise error.at(None, str(path)) from None
        except (TypeError, ValueError, OverflowError) as error:  # of a field that does not hold numbers
            raise ModelError(f"{path}: cannot be read as NIR: {str(error).partition(chr(10))[0]}") from None
    if not all(hasattr(source, word) for word in ("nodes", "edges")):
        found = type(source).__name__
        raise ModelError(f"from_nir: found {found}: expected a file, or a nir.NIRGraph")
    return _flat(source, "graph")


def _from_file(path: Path) -> Any:
    with path.open("rb") as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            raise ModelError(f"{path}: is no NIR file: expected HDF5")
    nir = package("from_nir")
    try:
        _check_sizes(path)
        graph = nir.read(path, type_check=False)  # `_find_shapes` reports what does not fit
    except ModelError:
        raise
    except Exception as error:  # the package and HDF5 raise many kinds on damaged files
        reason = str(error).strip().partition("\n")[0]
        raise ModelError(f"{path}: cannot be read as NIR: {reason or type(error).__name__}") from None
    if not hasattr(graph, "nodes"):
        raise ModelError(f"{path}: holds a {type(graph).__name__}: expected a graph")
    return graph


def _check_heaps(content: bytes) -> bool:
    """Whether the collections in which HDF5 keeps texts are whole: it reads on for ever in some that are not.

    Source: HDF5 File Format Specification 3.0, III.E, "Disk Format: Level 1E - Global Heap".
    """
    at = content.find(b"GCOL")
    while at >= 0:
        end = at + int.from_bytes(content[at + 8 : at + 16], "little")
        place = at + 16
        while place + 16 <= end <= len(content):
            index = int.from_bytes(content[place : place + 2], "little")
            length = int.from_bytes(content[place + 8 : place + 16], "little")
            if index == 0:  # what is free, with its head
                place += length if length else len(content)
            else:
                place += 16 + -(-length // 8) * 8
        if place > end or end > len(content):
            return False
        at = content.find(b"GCOL", at + 4)
    return True


def _check_sizes(path: Path) -> None:
    """Refuse arrays that the file cannot hold: HDF5 believes their shapes, and would read for hours.

    Raises:
        ModelError: an array is larger than what the file has of it.
    """
    import h5py

    room = path.stat().st_size
    if not _check_heaps(path.read_bytes()):
        raise ModelError(f"{path}: is damaged: its texts are not whole")

    def look(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        size = math.prod(item.shape or ())
        packed = item.compression is not None
        if size > LARGEST or item.size * item.dtype.itemsize > (room * 1100 if packed else room):
            raise ModelError(f"{path}: is damaged: array '{name}' of shape {list(item.shape)} does not fit in the file")

    with h5py.File(path, "r") as file:
        file.visititems(look)


def _flat(graph: Any, source: str) -> Graph:
    nodes: dict[str, Node] = {}
    edges: list[tuple[str, str]] = []
    _gather(graph, "", nodes, edges, depth=0)
    unknown = {end for edge in edges for end in edge} - set(nodes)
    if unknown:
        raise ModelError(f"{source}: an edge names '{min(unknown)}', which is no node")
    flat = Graph(source, nodes, list(dict.fromkeys(edges)), dict(graph.metadata or {}))
    if not any(node.kind == "Input" for node in nodes.values()):
        raise ModelError(f"{source}: has no Input node")
    _find_shapes(flat)
    for name, node in nodes.items():
        node.recurrent = any((b, name) in flat.edges for a, b in flat.edges if a == name)
    return flat


def _gather(graph: Any, prefix: str, nodes: dict[str, Node], edges: list[tuple[str, str]], depth: int) -> None:
    if depth > 16:
        raise ModelError("graph: subgraphs are nested more than 16 deep")
    ends: dict[str, tuple[str, str]] = {}
    for name, node in graph.nodes.items():
        full = prefix + str(name)
        kind = type(node).__name__
        if kind == "NIRGraph":
            _gather(node, full + ".", nodes, edges, depth + 1)
            inner = {
                each: [n for n, m in node.nodes.items() if type(m).__name__ == each] for each in ("Input", "Output")
            }
            if len(inner["Input"]) != 1 or len(inner["Output"]) != 1:
                raise ModelError(f"subgraph '{full}': expected one Input and one Output")
            ends[str(name)] = f"{full}.{inner['Input'][0]}", f"{full}.{inner['Output'][0]}"
        elif prefix and kind in ("Input", "Output"):
            nodes[full] = Node(full, "Identity", {})
        else:
            nodes[full] = Node(full, kind, {word: _plain(getattr(node, word, None)) for word in FIELDS.get(kind, ())})
            if kind == "Input":
                nodes[full].shape = _shape(next(iter((node.input_type or {}).values()), None), full)
    for a, b in graph.edges:
        edges.append((ends[a][1] if a in ends else prefix + str(a), ends[b][0] if b in ends else prefix + str(b)))


def _plain(value: Any) -> Any:
    """A field as a NumPy array; texts and nothing as they are."""
    if value is None or isinstance(value, (str, bytes)):
        return value
    return np.asarray(value.detach() if hasattr(value, "detach") else value)


def _shape(value: Any, name: str) -> Shape:
    sizes = () if value is None else tuple(int(n) for n in np.atleast_1d(value))
    if not sizes or min(sizes) < 1 or math.prod(sizes) > LARGEST:
        raise ModelError(f"node '{name}': shape {list(sizes)}: expected sizes of at least 1")
    return sizes


def _find_shapes(graph: Graph) -> None:
    pending = [n for n in graph.order() if not graph.nodes[n].shape]
    for _ in range(len(pending) + 1):
        for name in pending:
            node = graph.nodes[name]
            known = [graph.nodes[a].shape for a in graph.before(name) if graph.nodes[a].shape]
            if known and not node.shape:
                node.shape = _checked(graph, node, outcome(node, known[0]))
        left = [n for n in pending if not graph.nodes[n].shape]
        if not left or len(left) == len(pending):
            break
        pending = left
    for name in [n for n in graph.nodes if not graph.nodes[n].shape]:
        node = graph.nodes[name]
        if graph.before(name):
            raise ModelError(f"{graph.source}: node '{name}': its shape does not follow from what it receives")
        node.problem = "receives nothing", "connect it, or leave it out"
        node.shape = (1,)
    for a, b in graph.edges:
        node = graph.nodes[b]
        if node.shape != outcome(node, graph.nodes[a].shape):
            raise ModelError(
                f"{graph.source}: edge '{a}' -> '{b}': shape {list(graph.nodes[a].shape)} does not fit {node.kind}"
            )


def _checked(graph: Graph, node: Node, shape: Shape) -> Shape:
    if min(shape, default=0) < 1 or math.prod(shape) > LARGEST:
        raise ModelError(f"{graph.source}: node '{node.name}': shape {list(shape)}: expected sizes of at least 1")
    return shape
