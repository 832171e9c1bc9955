"""A graph with what becomes of each of its nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

from neuro.exchange.nir.cells import Cell
from neuro.exchange.nir.graph import Floats, Graph
from neuro.exchange.nir.maps import Map
from neuro.exchange.nir.models import Made
from neuro.exchange.verdict import REFUSED, Verdict, Verdicts


@dataclass(slots=True)
class Link:
    """What one neuron node sends another along one path of linear nodes.

    Attributes:
        source, target: names of the nodes.
        map: the linear nodes together.
        lag: seconds of the delays on the path, an element each of the source; 0 without one.
    """

    source: str
    target: str
    map: Map
    lag: Floats


@dataclass(slots=True)
class Read:
    """A graph with all that a network needs.

    Attributes:
        graph: the graph.
        tool: the convention, None where nothing tells.
        step: seconds.
        cells, made: of each stateful node.
        links: between neurons.
        bias: of each stateful node the constant input, in the unit of weighted input.
        late: the part of it that begins with the second step.
        depths: by how many steps each node is later here than in the tool.
        names: by Input and stateful node, the population that it is.
        verdicts: of each node.
    """

    graph: Graph
    tool: str | None
    step: float
    cells: dict[str, Cell] = field(default_factory=dict)
    made: dict[str, Made] = field(default_factory=dict)
    links: list[Link] = field(default_factory=list)
    bias: dict[str, Floats] = field(default_factory=dict)
    late: dict[str, Floats] = field(default_factory=dict)
    depths: dict[str, int] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    verdicts: dict[str, Verdict] = field(default_factory=dict)

    def refuse(self, node: str, why: str, way_out: str) -> None:
        """A node cannot be had."""
        if node not in self.verdicts or self.verdicts[node].verdict != REFUSED:
            self.verdicts[node] = Verdict(node, self.graph.nodes[node].kind, REFUSED, why, way_out)

    def table(self) -> Verdicts:
        """The verdicts in the order of the graph."""
        nodes = [each for each in self.graph.nodes.values() if each.kind != "Identity"]
        heading = f"{self.graph.source}: from {self.tool or 'an unknown tool'}, steps of {self.step * 1e3:g} ms"
        return Verdicts(heading, tuple(self.verdicts[node.name] for node in nodes))
