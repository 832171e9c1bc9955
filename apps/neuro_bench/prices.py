"""Joules of multiply-accumulates: arithmetic alone, so a lower bound of what any processor takes.

| type | pJ a product and a sum, 45 nm, 0.9 V |
| --- | --- |
| int8 | 0.2 + 0.03 |
| float32 | 3.7 + 0.9 |

Source: Horowitz, ISSCC 2014, figure 1.1.9. By the same figure 64 bits of an 8 kB cache take 10 pJ and of DRAM 1,300 pJ
or more. A bill of a chip has all of that, so the two are compared only with these words beside them.
"""

from __future__ import annotations

PICOJOULES = {"int8": 0.23, "float32": 4.6}
"""Of a multiply-accumulate."""


def arithmetic(kind: str, macs: float) -> dict[str, float]:
    """Joules of so many multiply-accumulates of a type of `PICOJOULES`, under the name of what they are of."""
    return {f"{kind} arithmetic, 45 nm": PICOJOULES[kind] * 1e-12 * macs}
