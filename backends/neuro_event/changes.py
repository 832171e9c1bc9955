"""What was set since step 0 beside the arrays of the kernels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from neuro.program.program import Floats, Program


class Changes:
    """Values as they were given, which a reset sets again, and what the program says otherwise by now.

    Args:
        program: what runs.

    Attributes:
        given: parameters that were set, by population and word, in the order of ids.
        rows: rows of parameters by population, in the order of the kernels.
        rules: the numbers of each projection's synapse model.
        kept: weights onto relays, which no kernel reads.
    """

    def __init__(self, program: Program) -> None:
        self.given: dict[tuple[int, str], Floats] = {}
        self.rows: dict[int, Floats] = {}
        self.rules = {q: p.synapse.vector() for q, p in enumerate(program.projections)}
        self.kept: dict[int, Floats] = {}

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        told = {f"told.{k}.{word}": values.copy() for (k, word), values in self.given.items()}
        for part, held in (("rule", self.rules), ("changed", self.rows), ("kept", self.kept)):
            told |= {f"{part}.{index}": values.copy() for index, values in held.items()}
        return told

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what a snapshot has."""
        held = {"rule": self.rules, "changed": self.rows, "kept": self.kept}
        for name, value in arrays.items():
            part, _, rest = name.partition(".")
            if part in held:
                held[part][int(rest)] = value.copy()
            elif part == "told":
                k, _, word = rest.partition(".")
                self.given[int(k), word] = value.copy()
