"""Neurons that compete, as C: of those above threshold a function lets some fire, and resets those that lose.

No chip has such groups: where a chip runs, its host decides them, by the voltages of the step and keyed draws for ties.
"""

from __future__ import annotations

import math

from neuro.core.keyed_random import key
from neuro.exchange.c_code.arrays import Memory
from neuro.exchange.c_code.cells import Cells
from neuro.model.parts import Competition, lateral_reset, winner_take_all
from neuro.program.program import Program

SUPPORTED = (winner_take_all, lateral_reset)


def decide(program: Program, index: int, cells: Cells, threshold: str, memory: Memory) -> tuple[list[str], list[str]]:
    """The functions of a group, and the statements that open it.

    Args:
        program: has the group.
        index: of the group.
        cells: the population.
        threshold: of neuron i, as text of C.
        memory: takes its state.
    """
    group, k = program.groups[index], cells.number
    choice, opened, shape = group.choice, list[str](), program.populations[group.population].shape
    alone = isinstance(choice, lateral_reset) and shape[choice.axis] == 1
    lines = [] if alone else _choose(cells, key(program.seed, "tie", group.name), threshold)
    lines += [f"static void decide_{k}(void)", "{"]
    if isinstance(choice, lateral_reset):
        # Compilers take the loop over rivals of one neuron for one that leaves its array.
        lines += [] if alone else _rivals(cells, shape[choice.axis], math.prod(shape[choice.axis + 1 :]))
    else:
        once = isinstance(choice, winner_take_all) and choice.first_to_fire
        if once:
            closed = memory.variable(f"closed_{k}", "uint8_t", f"{group.name}: whether it has decided")
            opened = [f"{closed} = 0;"]
        lines += _one(cells, once)
    fires = [f"    for (uint32_t i = 0; i < {cells.size}u; i++) {{", f"        if (fired_{k}[i]) fire_{k}(i);", "    }"]
    return [*lines, *fires, "}", ""], opened


def supports(choice: Competition) -> bool:
    """Whether groups of a kind are written as C."""
    return isinstance(choice, SUPPORTED)


def _choose(cells: Cells, tie: int, threshold: str) -> list[str]:
    """The neuron of the largest margin; of equal ones that of the larger draw."""
    k, none = cells.number, f"{cells.size}u"
    return [
        f"static uint32_t best_{k}(uint32_t first, uint32_t last, uint32_t apart)",
        "{",
        f"    uint64_t base = step_word(UINT64_C({tie}), now), best_drawn = 0;",
        "    int64_t best_margin = 0;",
        f"    uint32_t best = {none};",
        "    for (uint32_t i = first; i < last; i += apart) {",
        f"        if (fired_{k}[i]) {{",
        f"            int64_t margin = (int64_t)v_{k}[i] - {threshold};",
        "            uint64_t drawn = draw(base, i) >> 11;",
        "            int equal = margin == best_margin && drawn > best_drawn;",
        f"            if (best == {none} || margin > best_margin || equal) {{",
        "                best = i, best_margin = margin, best_drawn = drawn;",
        "            }",
        "        }",
        "    }",
        "    return best;",
        "}",
        "",
    ]


def _one(cells: Cells, once: bool) -> list[str]:
    """Winner take all: with `first_to_fire` the others stay at threshold, and the group is closed."""
    k, size = cells.number, cells.size
    lines = [f"    uint32_t best = best_{k}(0, {size}u, 1);"]
    lose = f"fired_{k}[i] = 0;" if once else f"fired_{k}[i] = 0, reset_{k}(i);"
    closed = f" || closed_{k}" if once else ""
    lines += [f"    for (uint32_t i = 0; i < {size}u; i++) {{", f"        if (fired_{k}[i] && (i != best{closed})) {{"]
    lines += [f"            {lose}", "        }", "    }"]
    return [*lines, *([f"    if (best < {size}u) closed_{k} = 1;"] if once else [])]


def _rivals(cells: Cells, rivals: int, apart: int) -> list[str]:
    """Lateral reset: of each set of rivals the best fires, and all others are reset."""
    k, size = cells.number, cells.size
    return [
        f"    for (uint32_t first = 0; first < {size}u; first++) {{",
        f"        if (first / {apart}u % {rivals}u != 0) continue;",
        f"        uint32_t last = first + {rivals * apart}u, best = best_{k}(first, last, {apart}u);",
        f"        for (uint32_t i = first; best < {size}u && i < last; i += {apart}u) {{",
        f"            if (i != best) fired_{k}[i] = 0, reset_{k}(i);",
        "        }",
        "    }",
    ]
