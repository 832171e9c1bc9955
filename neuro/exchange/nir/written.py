"""A graph of NIR under construction."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from neuro.exchange.nir.nodes import Scaled
from neuro.exchange.verdict import Verdict
from neuro.program.program import Population, Program, Projection


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
