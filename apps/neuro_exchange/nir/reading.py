"""Reads a NIR graph from a file or a `nir.NIRGraph`, and checks it."""

from __future__ import annotations

import math
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import existing, hdf5, record_input
from neuro_exchange.nir.graph import FIELDS, Graph, Node, outcome, package, shown, wholes

LARGEST = 2**28
"""Elements of a shape; more is taken for damage."""

SIZES = f"whole sizes of at least 1, of {LARGEST:,} elements at most"


def read(source: Any) -> Graph:
    """A graph from a file or a `nir.NIRGraph`.

    Raises:
        ModelError: the file is not there or damaged, it is no graph, or the graph is not consistent.
    """
    if isinstance(source, (str, PathLike)):
        path = existing(source)
        record_input(path)
        named = str(path)
    else:
        path, named = None, "graph"
        if not all(hasattr(source, word) for word in ("nodes", "edges")):
            found = type(source).__name__
            raise ModelError(f"from_nir: found {found}: expected a file, or a nir.NIRGraph")
    try:
        graph = source if path is None else _from_file(path)
        nodes: dict[str, Node] = {}
        edges: list[tuple[str, str]] = []
        _gather(graph, "", nodes, edges, depth=0)
        flat = Graph(named, nodes, list(dict.fromkeys(edges)), dict(graph.metadata or {}))
        if not any(node.kind == "Input" for node in nodes.values()):
            raise ModelError(f"{named}: has no Input node")
        if into := [(a, b) for a, b in flat.edges if nodes[b].kind == "Input"]:
            raise ModelError(f"{named}: edge '{into[0][0]}' -> '{into[0][1]}': an Input receives nothing")
        _find_shapes(flat)
        for name, node in nodes.items():
            node.recurrent = any((b, name) in flat.edges for a, b in flat.edges if a == name)
        return flat
    except ModelError as error:
        raise (error if path is None else error.at(None, named)) from None
    except (TypeError, ValueError, OverflowError, AttributeError) as error:  # of a field that is something else
        raise ModelError(f"{named}: cannot be read as NIR: {str(error).partition(chr(10))[0]}") from None


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
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        reason = f"has no {reason}" if isinstance(error, KeyError) else reason
        raise ModelError(f"{path}: cannot be read as NIR: {_culprit(path)}{reason}") from None
    return graph


def _culprit(path: Path) -> str:
    """The first node that the package cannot read, for a message that says what is wrong but not where."""
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
    """Refuse arrays that the file cannot hold: HDF5 believes their shapes, and would read for hours.

    Raises:
        ModelError: an array is larger than what the file has of it.
    """
    import h5py

    room, texts = path.stat().st_size, hdf5.Texts(path.read_bytes())
    if not texts.whole:
        raise ModelError(f"{path}: is damaged: its texts are not whole")

    def look(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        size = math.prod(item.shape or ())
        packed = item.compression is not None
        if size > LARGEST or item.size * item.dtype.itemsize > (room * 1100 if packed else room):
            raise ModelError(f"{path}: is damaged: array '{name}' of shape {list(item.shape)} does not fit in the file")
        if item.dtype.kind == "O" and not texts.has(item):
            raise ModelError(f"{path}: is damaged: the texts of '{name}' are not in the file")

    with h5py.File(path, "r") as file:
        hdf5.check_tree(file, several_names=True)
        file.visititems(look)
        kind = file["node/type"][()].decode() if "node/type" in file else "no node"
        if kind != "NIRGraph":
            raise ModelError(f"{path}: holds {kind}: expected a graph, NIRGraph")


def _gather(graph: Any, prefix: str, nodes: dict[str, Node], edges: list[tuple[str, str]], depth: int) -> None:
    if depth > 16:
        raise ModelError("graph: subgraphs are nested more than 16 deep")
    ends: dict[str, tuple[str, str]] = {}
    for name, node in graph.nodes.items():
        full = prefix + str(name)
        kind = type(node).__name__
        if full in nodes:
            raise ModelError(f"node '{full}': is there twice, in a subgraph and beside it: expected different names")
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
            fields = {word: _plain(getattr(node, word, None), full, word) for word in FIELDS.get(kind, ())}
            nodes[full] = Node(full, kind, fields)
            if kind == "Input":
                value = next(iter((node.input_type or {}).values()), None)
                sizes = () if value is None else tuple(wholes(value))
                if not sizes or min(sizes) < 1 or math.prod(sizes) > LARGEST:
                    raise ModelError(f"node '{full}': shape {shown(value)}: expected {SIZES}")
                nodes[full].shape = sizes
    known = {str(name) for name in graph.nodes}
    for a, b in ((str(a), str(b)) for a, b in graph.edges):
        if lost := [end for end in (a, b) if end not in known]:
            raise ModelError(f"an edge names '{prefix}{lost[0]}', which is no node")
        edges.append((ends[a][1] if a in ends else prefix + a, ends[b][0] if b in ends else prefix + b))


def _plain(value: Any, name: str, word: str) -> Any:
    """A field as a NumPy array of real numbers; nothing as it is, and the word that a padding may be.

    Raises:
        ModelError: it holds something else.
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
    pending = [n for n in graph.order() if not graph.nodes[n].shape]
    for _ in range(len(pending) + 1):
        for name in pending:
            node = graph.nodes[name]
            known = [graph.nodes[a].shape for a in graph.before(name) if graph.nodes[a].shape]
            if known and not node.shape:
                shape = outcome(node, known[0])
                if min(shape, default=0) < 1 or math.prod(shape) > LARGEST:
                    raise ModelError(f"{graph.source}: node '{node.name}': shape {list(shape)}: expected {SIZES}")
                node.shape = shape
        left = [n for n in pending if not graph.nodes[n].shape]
        if not left or len(left) == len(pending):
            break
        pending = left
    for node in graph.nodes.values():
        if not node.shape:
            why = "receives what comes from no Input" if graph.before(node.name) else "receives nothing"
            node.problem = why, "connect it, or leave it out"
            node.shape = (1,)
    for a, b in graph.edges:
        node = graph.nodes[b]
        if node.problem[0] or graph.nodes[a].problem[0]:
            continue
        if node.shape != outcome(node, graph.nodes[a].shape):
            raise ModelError(
                f"{graph.source}: edge '{a}' -> '{b}': shape {list(graph.nodes[a].shape)} does not fit {node.kind}"
            )
