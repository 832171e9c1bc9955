"""Neurons of a population in YAML: its name, `{exc: "0:100"}`, `{grid: "2:4, :"}`, or ids in a list or a file.

On a command line the same index stands behind the name: `exc[0:100]`, `grid[2:4, :]`, ids as `exc[[3, 7]]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from neuro.core.checks import check
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import Quantity
from neuro.core.values import FromFile
from neuro.model.language.files import array
from neuro.model.language.nodes import about, found, mistake, plain, put_at, within
from neuro.model.language.reader import Node
from neuro.model.parts import Population
from neuro.model.views import view
from neuro.model.written_views import indices

IDS = Quantity(doc="ids of neurons", kind="ids")


def neurons(node: Node, populations: Mapping[str, Population], role: str) -> Any:
    """What `of`, `from` or `to` stands for: what is said if it is the name of a population, or a view of it.

    Args:
        node: what is said.
        populations: those of the network.
        role: the word before it, for messages.
    """
    if not isinstance(node.value, dict):
        return plain(node)
    if len(node.value) != 1:
        raise mistake(node, f"{role}: {found(node)}: expected a name, or {{name: index}}")
    [(name, index)] = node.value.items()
    if name not in populations:
        error = unknown("population", name, populations)
        raise error.at(index.label, role)
    with within(role):
        chosen = _index(index, populations[name])
        with about(index):
            ids = isinstance(chosen, (list, FromFile))
            return view(populations[name], check(IDS, chosen, name) if ids else chosen)


def _index(node: Node, population: Population) -> Any:
    """The index that is written, or ids that are not yet checked."""
    if isinstance(node.value, str):
        return _axes(node, population)
    if isinstance(node.value, dict):
        return array(node)
    if isinstance(node.value, (int, list)) and not isinstance(node.value, bool):
        return plain(node)
    raise mistake(node, f'{population.name}: {found(node)}: expected an index such as "0:100", or a list of ids')


def _axes(node: Node, population: Population) -> tuple[int | slice, ...]:
    try:
        return indices(node.value, population.name)
    except ModelError as error:
        raise put_at(node, error) from None
