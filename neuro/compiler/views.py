"""Views at the ends of projections: rules see the neurons of a view, backends those of the population."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from neuro.compiler.connect import Connections
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
    n_pre, n_post = size(source.shape), size(target.shape)
    row_ends, inner = found.row_ends, found.targets
    if found.layout == "one_to_one":
        row_ends, inner = np.arange(n_pre + 1), np.arange(n_pre, dtype=np.int32)
    elif found.layout == "dense":
        row_ends, inner = np.arange(n_pre + 1) * n_post, np.tile(np.arange(n_post, dtype=np.int32), n_pre)
    sources, degrees, order = _ids(source), np.diff(row_ends), found.order
    targets = _ids(target).astype(np.int32)[inner]
    if not (_ascend(sources) and _ascend(_ids(target))):
        moved = np.lexsort((targets, np.repeat(sources, degrees)))
        targets, order = targets[moved], moved if order is None else order[moved]
    out = np.zeros(source.size + 1, dtype=np.int64)
    out[sources + 1] = degrees
    return replace(found, layout="csr", row_ends=np.cumsum(out), targets=targets, order=order)


def _ids(end: End) -> Ints:
    return np.arange(end.size) if end.ids is None else end.ids


def _ascend(ids: Ints) -> bool:
    return bool(np.all(ids[1:] > ids[:-1]))
