"""The state of a net as named arrays, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro_reference.net import Net

Arrays = Mapping[str, NDArray[Any]]

AT_ONCE = "at_once"
"""Present where what generators emitted in the last step has set out; up to version 0.1.0 it waited for the next."""


def take(net: Net) -> dict[str, NDArray[Any]]:
    """Copies of everything that changes while a net runs."""
    arrays = {AT_ONCE: np.array(True)}
    for path, part in _parts(net):
        for name in part.kept:
            arrays[f"{path}/{name}"] = np.array(getattr(part, name))
    for index, cells in enumerate(net.cells):
        arrays[f"emitted/{index}/ids"] = net.ids[index].copy()
        arrays[f"emitted/{index}/multiplicity"] = net.multiplicity[index].copy()
        for name, values in cells.parameters.items():
            arrays[f"parameter/{index}/{name}"] = values.copy()
    for index, rule in net.rules.items():
        arrays[f"rule/{index}"] = rule.copy()
    return arrays


def put(net: Net, arrays: Arrays) -> None:
    """Set a net of the same program to what `take` gave."""
    arrays = {**arrays, **_first_version(net, arrays)}
    for path, part in _parts(net):
        for name in part.kept:
            value = arrays[f"{path}/{name}"]
            now = getattr(part, name)
            setattr(part, name, value.copy() if isinstance(now, np.ndarray) else type(now)(value.tolist()))
    for index, cells in enumerate(net.cells):
        net.ids[index] = arrays[f"emitted/{index}/ids"].copy()
        net.multiplicity[index] = arrays[f"emitted/{index}/multiplicity"].copy()
        cells.parameters = {name: arrays[f"parameter/{index}/{name}"].copy() for name in cells.parameters}
        cells.refresh()
    net.rules = {index: arrays[f"rule/{index}"].copy() for index in net.rules}
    for pairs in net.pairs.values():
        pairs.refresh()
    if AT_ONCE not in arrays:
        for index in [index for index, wires in enumerate(net.wires) if wires.at_once]:
            net.send(index, net.step)


def _first_version(net: Net, arrays: Arrays) -> dict[str, NDArray[Any]]:
    """The traces of a state of version 0.1.0, which had one of each side, by their present names."""
    found = {}
    for number in net.pairs:
        path = f"pairs/{number}"
        if f"{path}/k_plus" in arrays:
            for side, after, before, step in (
                ("pre", "k_plus", "k_plus", "k_plus_step"),
                ("post", "k_minus", "k_minus_before", "heard"),
            ):
                found[f"{path}/{side}/after"] = arrays[f"{path}/{after}"][None]
                found[f"{path}/{side}/before"] = arrays[f"{path}/{before}"][None]
                found[f"{path}/{side}/since"] = found[f"{path}/{side}/last"] = arrays[f"{path}/{step}"]
    return found


def _parts(net: Net) -> Iterator[tuple[str, Any]]:
    yield "net", net
    for label, parts in (("cells", net.cells), ("wires", net.wires), ("records", net.records)):
        for index, part in enumerate(parts):
            yield f"{label}/{index}", part
    for index, local in net.local.items():
        yield f"local/{index}", local
    for number, pairs in net.pairs.items():
        yield f"pairs/{number}", pairs
        yield f"pairs/{number}/pre", pairs.pre
        yield f"pairs/{number}/post", pairs.post
