"""Verdicts: how exactly each part of a network is converted from one tool to another."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from html import escape

from neuro import ModelError
from neuro.apps import tables, unknown

EXACT, APPROXIMATE, REFUSED = "exact", "approximate", "refused"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of converting one node.

    Attributes:
        node: name of the node.
        kind: type of the node, e.g. "LIF".
        verdict: "exact", "approximate" or "refused".
        how: the convention under which the node is exact, the difference, or the reason for the refusal.
        way_out: advice for a refused node.
        measured: for an approximate node, the difference in spikes in a short run, or why nothing was measured.
    """

    node: str
    kind: str
    verdict: str
    how: str
    way_out: str = ""
    measured: str = ""


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts of all nodes of a network, in the network's order.

    Verdicts print as a table. `len`, iteration and indexing by the name of a node work as for a list.

    Attributes:
        heading: the network, the direction and the convention.
        nodes: one verdict per node.
        note: assumptions and their consequences; "" without assumptions.
    """

    heading: str
    nodes: tuple[Verdict, ...]
    note: str = ""

    @property
    def exact(self) -> bool:
        """True if every node is exact."""
        return all(verdict.verdict == EXACT for verdict in self.nodes)

    @property
    def refused(self) -> tuple[Verdict, ...]:
        """The verdicts of the refused nodes."""
        return tuple(verdict for verdict in self.nodes if verdict.verdict == REFUSED)

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.nodes)

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, node: str) -> Verdict:
        for verdict in self.nodes:
            if verdict.node == node:
                return verdict
        raise unknown("node", node, [verdict.node for verdict in self.nodes])

    def to_json(self) -> str:
        """Return the heading, the list of nodes and the note as JSON."""
        content = {"heading": self.heading, "exact": self.exact, "nodes": [asdict(verdict) for verdict in self.nodes]}
        content |= {"note": self.note} if self.note else {}
        return json.dumps(content, indent=1)

    def check(self) -> None:
        """Raise an error if a node is refused.

        Raises:
            ModelError: a node is refused. The error lists every refused node with the reason and the way out.
        """
        if self.refused:
            first, *later_parts = (
                ModelError(f"node '{v.node}' ({v.kind}): {v.how}", hint=v.way_out, path=(v.node,)) for v in self.refused
            )
            raise first.but(others=tuple(later_parts))

    def _tables(self) -> list[tables.Table]:
        rows = tuple(
            (v.node, v.kind, v.verdict, "; ".join(filter(None, (v.how, v.way_out, v.measured)))) for v in self.nodes
        )
        return [tables.Table("", ("node", "type", "verdict", "how"), rows)]

    def __str__(self) -> str:
        return "\n\n".join(filter(None, (tables.as_text(self.heading, self._tables()), self.note)))

    def _repr_html_(self) -> str:
        note = f"<p>{escape(self.note)}</p>" if self.note else ""
        return tables.as_html(self.heading, self._tables()) + note
