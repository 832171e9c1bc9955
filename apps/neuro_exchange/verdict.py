"""What becomes of each part of a network that goes from one tool to another."""

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
    """What becomes of one node.

    Attributes:
        node: its name.
        kind: its type, e.g. "LIF".
        verdict: "exact", "approximate" or "refused".
        how: the convention under which it is exact, what differs, or why it is refused.
        way_out: what to do if it is refused.
        measured: by how much it differs if it is approximate, in a short run, or why nothing is measured.
    """

    node: str
    kind: str
    verdict: str
    how: str
    way_out: str = ""
    measured: str = ""


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts of all nodes of a network, in its order. It prints as a table, and has a length and an order.

    Attributes:
        heading: the network, the direction and the convention.
        nodes: one verdict for each node.
        note: what was assumed, and what follows from it; "" if nothing was.
    """

    heading: str
    nodes: tuple[Verdict, ...]
    note: str = ""

    @property
    def exact(self) -> bool:
        """Whether every node is exact."""
        return all(each.verdict == EXACT for each in self.nodes)

    @property
    def refused(self) -> tuple[Verdict, ...]:
        """The nodes that are refused."""
        return tuple(each for each in self.nodes if each.verdict == REFUSED)

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.nodes)

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, node: str) -> Verdict:
        for each in self.nodes:
            if each.node == node:
                return each
        raise unknown("node", node, [each.node for each in self.nodes])

    def to_json(self) -> str:
        """The heading, a list of nodes, and the note."""
        content = {"heading": self.heading, "exact": self.exact, "nodes": [asdict(each) for each in self.nodes]}
        content |= {"note": self.note} if self.note else {}
        return json.dumps(content, indent=1)

    def check(self) -> None:
        """Refuse the network if a node is refused.

        Raises:
            ModelError: names every refused node, why, and the way out.
        """
        if self.refused:
            first, *others = (
                ModelError(f"node '{each.node}' ({each.kind}): {each.how}", hint=each.way_out, path=(each.node,))
                for each in self.refused
            )
            raise first.but(others=tuple(others))

    def _tables(self) -> list[tables.Table]:
        rows = tuple(
            (each.node, each.kind, each.verdict, "; ".join(filter(None, (each.how, each.way_out, each.measured))))
            for each in self.nodes
        )
        return [tables.Table("", ("node", "type", "verdict", "how"), rows)]

    def __str__(self) -> str:
        return "\n\n".join(filter(None, (tables.as_text(self.heading, self._tables()), self.note)))

    def _repr_html_(self) -> str:
        note = f"<p>{escape(self.note)}</p>" if self.note else ""
        return tables.as_html(self.heading, self._tables()) + note
