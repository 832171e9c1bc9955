"""Read a NIR graph from a file or a `nir.NIRGraph`, and check it."""

from __future__ import annotations

import math
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import existing, hdf5, record_input
from neuro_exchange.nir.graph import FIELDS, Graph, Node, as_text, output_shape, package, wholes

LARGEST = 2**28
"""Largest number of elements of an array. A larger array is treated as damage of the file."""

SIZES = f"sizes >= 1 and {LARGEST:,} elements at most"


def read(source: Any) -> Graph:
    """Return the graph of a file or of a `nir.NIRGraph`, with subgraphs dissolved and all shapes computed.

    Raises:
        ModelError: the file is missing or damaged, is not a graph, or its shapes do not fit together.
    """
    if isinstance(source, (str, PathLike)):
        path = existing(source)
        record_input(path)
        name = str(path)
    else:
        path, name = None, "graph"
        if not all(hasattr(source, word) for word in ("nodes", "edges")):
            raise ModelError(f"from_nir: found {type(source).__name__}: expected a file, or a nir.NIRGraph")
    try:
        graph = source if path is None else _from_file(path)
        nodes: dict[str, Node] = {}
        edges: list[tuple[str, str]] = []
        _gather(graph, "", nodes, edges, depth=0)
        flat_graph = Graph(name, nodes, list(dict.fromkeys(edges)), dict(graph.metadata or {}))
        if not any(node.kind == "Input" for node in nodes.values()):
            raise ModelError(f"{name}: found no Input node: expected at least one")
        if bad_edges := [(a, b) for a, b in flat_graph.edges if nodes[b].kind == "Input"]:
            raise ModelError(f"{name}: edge '{bad_edges[0][0]}' -> '{bad_edges[0][1]}': an Input cannot be a target")
        _find_shapes(flat_graph)
        for node in nodes.values():
            node.recurrent = any((b, node.name) in flat_graph.edges for a, b in flat_graph.edges if a == node.name)
        return flat_graph
    except ModelError as error:
        raise (error if path is None else error.at(None, name)) from None
    except (TypeError, ValueError, OverflowError, AttributeError) as error:  # a field has an unexpected type
        raise ModelError(f"{name}: cannot be read as NIR: {str(error).partition(chr(10))[0]}") from None


def _from_file(path: Path) -> Any:
    with path.open("rb") as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            raise ModelError(f"{path}: is not a NIR file: expected HDF5")
    nir = package("from_nir")
    try:
        _check_sizes(path)
        graph = nir.read(path, type_check=False)  # `_find_shapes` checks the shapes
    except ModelError:
        raise
    except Exception as error:  # the package and HDF5 raise many kinds on damaged files
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        reason = f"has no {reason}" if isinstance(error, KeyError) else reason
        raise ModelError(f"{path}: cannot be read as NIR: {_culprit(path)}{reason}") from None
    return graph


def _culprit(path: Path) -> str:
    """Return "node 'NAME': " for the first node that the package cannot read, or "". The package's errors lack it."""
    import h5py

    nir = package("from_nir")
    with suppress(Exception), h5py.File(path, "r") as file:
        for name, node in file["node/nodes"].items():
            try:
                nir.dict2NIRNode(nir.serialization.hdf2dict(node))
            except Exception:  # the package raises many kinds
                return f"node '{name}': "
    return ""


def _check_sizes(path: Path) -> None:
    """Check that the arrays fit in the file. HDF5 trusts a damaged shape, and would read for hours.

    Raises:
        ModelError: an array is larger than the file allows.
    """
    import h5py

    file_size, texts = path.stat().st_size, hdf5.Texts(path.read_bytes())
    if not texts.whole:
        raise ModelError(f"{path}: is damaged: its texts are incomplete")

    def check_item(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        size = math.prod(item.shape or ())
        most_bytes = file_size if item.compression is None else file_size * 1100  # deflate packs 1032 to 1 at most
        if size > LARGEST or item.size * item.dtype.itemsize > most_bytes:
            raise ModelError(f"{path}: is damaged: array '{name}' of shape {list(item.shape)} does not fit in the file")
        if item.dtype.kind == "O" and not texts.has(item):
            raise ModelError(f"{path}: is damaged: the texts of '{name}' are not in the file")

    with h5py.File(path, "r") as file:
        hdf5.check_tree(file, several_names=True)
        file.visititems(check_item)
        kind = file["node/type"][()].decode() if "node/type" in file else "no node"
        if kind != "NIRGraph":
            raise ModelError(f"{path}: found {kind}: expected a graph, NIRGraph")


def _gather(graph: Any, prefix: str, nodes: dict[str, Node], edges: list[tuple[str, str]], depth: int) -> None:
    """Add the nodes and edges of a graph and its subgraphs. Input and Output of a subgraph become Identity nodes."""
    if depth > 16:
        raise ModelError("graph: subgraphs are nested more than 16 deep")
    ends: dict[str, tuple[str, str]] = {}
    for name, node in graph.nodes.items():
        full_name = prefix + str(name)
        kind = type(node).__name__
        if full_name in nodes:
            raise ModelError(f"node '{full_name}': found twice, in a subgraph and beside it: expected different names")
        if kind == "NIRGraph":
            _gather(node, full_name + ".", nodes, edges, depth + 1)
            inner_names = {
                end: [n for n, m in node.nodes.items() if type(m).__name__ == end] for end in ("Input", "Output")
            }
            if len(inner_names["Input"]) != 1 or len(inner_names["Output"]) != 1:
                raise ModelError(f"subgraph '{full_name}': expected one Input and one Output")
            ends[str(name)] = f"{full_name}.{inner_names['Input'][0]}", f"{full_name}.{inner_names['Output'][0]}"
        elif prefix and kind in ("Input", "Output"):
            nodes[full_name] = Node(full_name, "Identity", {})
        else:
            fields = {word: _plain(getattr(node, word, None), full_name, word) for word in FIELDS.get(kind, ())}
            nodes[full_name] = Node(full_name, kind, fields)
            if kind == "Input":
                value = next(iter((node.input_type or {}).values()), None)
                sizes = () if value is None else tuple(wholes(value))
                if not sizes or min(sizes) < 1 or math.prod(sizes) > LARGEST:
                    raise ModelError(f"node '{full_name}': shape {as_text(value)}: expected {SIZES}")
                nodes[full_name].shape = sizes
    names = {str(name) for name in graph.nodes}
    for a, b in ((str(a), str(b)) for a, b in graph.edges):
        if unknown_names := [end for end in (a, b) if end not in names]:
            raise ModelError(f"edge '{prefix}{a}' -> '{prefix}{b}': there is no node '{prefix}{unknown_names[0]}'")
        edges.append((ends[a][1] if a in ends else prefix + a, ends[b][0] if b in ends else prefix + b))


def _plain(value: Any, name: str, word: str) -> Any:
    """Return a field as a NumPy array of real numbers. None, and a padding that is a word, are returned unchanged.

    Raises:
        ModelError: the field holds anything but real numbers.
    """
    if value is None or (word == "padding" and isinstance(value, (str, bytes))):
        return value
    try:
        array = np.asarray(value.detach() if hasattr(value, "detach") else value)
    except (TypeError, ValueError) as error:
        raise ModelError(f"node '{name}': {word}: expected numbers: {error!s:.100}") from None
    is_word = word == "padding" and array.size == 1 and array.dtype.kind in "SUO"
    if array.dtype.kind not in "fiub" and not is_word:
        raise ModelError(f"node '{name}': {word}: found {array.dtype}: expected real numbers")
    return array


def _find_shapes(graph: Graph) -> None:
    """Compute the shapes of all nodes from those of the Inputs, and check the edges.

    Nodes that no Input reaches get a `problem`, which their verdicts report.

    Raises:
        ModelError: a shape is too large, or shapes at an edge do not fit.
    """
    pending_names = [n for n in graph.order() if not graph.nodes[n].shape]
    for _ in range(len(pending_names) + 1):
        for name in pending_names:
            node = graph.nodes[name]
            input_shapes = [graph.nodes[a].shape for a in graph.before(name) if graph.nodes[a].shape]
            if input_shapes and not node.shape:
                shape = output_shape(node, input_shapes[0])
                if min(shape, default=0) < 1 or math.prod(shape) > LARGEST:
                    raise ModelError(f"{graph.source}: node '{node.name}': shape {list(shape)}: expected {SIZES}")
                node.shape = shape
        unresolved_names = [n for n in pending_names if not graph.nodes[n].shape]
        if not unresolved_names or len(unresolved_names) == len(pending_names):
            break
        pending_names = unresolved_names
    for node in graph.nodes.values():
        if not node.shape:
            reason = "is not reached from an Input" if graph.before(node.name) else "receives nothing"
            node.problem = reason, "connect it, or leave it out"
            node.shape = (1,)
    for a, b in graph.edges:
        node = graph.nodes[b]
        if node.problem[0] or graph.nodes[a].problem[0]:
            continue
        if node.shape != output_shape(node, graph.nodes[a].shape):
            raise ModelError(
                f"{graph.source}: edge '{a}' -> '{b}': shape {list(graph.nodes[a].shape)} does not fit {node.kind}"
            )
