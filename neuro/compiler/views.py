"""Views at the ends of projections: rules see the neurons of a view, backends those of the population."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from neuro.compiler.connect import Connections, listed_one_by_one
from neuro.compiler.shapes import Shape, size
from neuro.model.views import View
from neuro.program.program import Ints


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """Neurons of a population, as a rule sees them.

    Attributes:
        shape: sizes of the axes.
        ids: the neurons in the population, None for all of them in order.
        size: of the population.
    """

    shape: Shape
    ids: Ints | None
    size: int


def end_of(view: View | None, shape: Shape) -> End:
    """The neurons of a view, or of a whole population of a shape.

    Raises:
        ModelError: the view reaches beyond the shape.
    """
    n = size(shape)
    if view is None:
        return End(shape, None, n)
    ids, sizes = view.within(shape)
    whole = ids.size == n and bool(np.array_equal(ids, np.arange(n)))
    return End(sizes, None if whole else ids, n)


def own_places(source: End, target: End) -> Ints:
    """Of each neuron of the source its place in the target, -1 where it is not there; ends of one population."""
    places = np.full(source.size, -1, dtype=np.int64)
    places[_ids(target)] = np.arange(size(target.shape))
    found: Ints = places[_ids(source)]
    return found


def placed(found: Connections, source: End, target: End) -> Connections:
    """The same synapses between the neurons of the populations, sorted by source, then target."""
    if source.ids is None and target.ids is None:
        return found
    found = listed_one_by_one(found, size(source.shape), size(target.shape))
    sources, degrees, order, shared = _ids(source), np.diff(found.row_ends), found.order, found.shared
    targets = _ids(target).astype(np.int32)[found.targets]
    if not (_ascend(sources) and ascend(target)):
        moved = np.lexsort((targets, np.repeat(sources, degrees)))
        targets, order = targets[moved], moved if order is None else order[moved]
        shared = None if shared is None else shared[moved]
    out = np.zeros(source.size + 1, dtype=np.int64)
    out[sources + 1] = degrees
    return replace(found, row_ends=np.cumsum(out), targets=targets, order=order, shared=shared)


def ascend(end: End) -> bool:
    """Whether the neurons of an end are in the order of the population."""
    return end.ids is None or _ascend(end.ids)


def _ids(end: End) -> Ints:
    return np.arange(end.size) if end.ids is None else end.ids


def _ascend(ids: Ints) -> bool:
    return bool(np.all(ids[1:] > ids[:-1]))
