"""What a model takes for one example: counts in NeuroBench's words, and joules.

Joules of multiply-accumulates are those of the arithmetic alone, so a lower bound of what any processor takes:

| type | pJ a product and a sum, 45 nm, 0.9 V |
| --- | --- |
| int8 | 0.2 + 0.03 |
| float32 | 3.7 + 0.9; a sum alone 0.9 |

Source: Horowitz, ISSCC 2014, figure 1.1.9. By the same figure 64 bits of an 8 kB cache take 10 pJ and of DRAM 1,300 pJ
or more. A bill of a chip has all of that, so the two are compared only with these words beside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

PICOJOULES = {"int8": 0.23, "float32": 4.6, "float32 sum": 0.9}
"""Of a multiply-accumulate, or a sum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What a model takes for one example, in NeuroBench's words; a value of a series is one, too.

    Attributes:
        parameters: numbers that were learnt.
        footprint_bytes: of all that describes the model.
        connection_sparsity: share of the weights that are 0.
        activation_sparsity: share of the activations that are 0.
        effective_macs: multiply-accumulates whose factors are both not 0.
        effective_acs: accumulates of weights that are not 0, by spikes.
        dense: operations if nothing were 0.
        joules: of one example, by what it is computed on.
    """

    parameters: int
    footprint_bytes: int
    connection_sparsity: float = 0.0
    activation_sparsity: float = 0.0
    effective_macs: float = 0.0
    effective_acs: float = 0.0
    dense: float = 0.0
    joules: Mapping[str, float] = field(default_factory=dict)

    def as_words(self) -> dict[str, Any]:
        """All of it as plain data."""
        return asdict(self)


def arithmetic(kind: str, macs: float) -> dict[str, float]:
    """Joules of so many multiply-accumulates of a type of `PICOJOULES`, under the name of what they are of."""
    return {f"{kind} arithmetic, 45 nm": PICOJOULES[kind] * 1e-12 * macs}
