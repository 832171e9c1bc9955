"""The models' functions, compiled and chosen by number, so that one loop runs every model.

The choice is written out from the tables `NEURONS` and `SYNAPSES`: a model that is entered there runs here.
"""

from __future__ import annotations

from typing import Any

from neuro.kernels.jit import compiled, inner, merged
from neuro.neurons import NEURONS
from neuro.synapses import SYNAPSES

RULES = [synapse for synapse in SYNAPSES.values() if synapse.learns == "pairs"]
_STEP = "s, c, x, i_0, lo, hi, fired"


def _chosen(function: str, arguments: str, models: list[Any], compile_: Any = inner) -> Any:
    """A compiled function (number, arguments) that calls the function of that name of the numbered model."""
    scope: dict[str, Any] = {}
    lines = [f"def {function}(number, {arguments}):"]
    for number, model in enumerate(models):
        scope[f"of_{number}"] = compiled(getattr(model.arithmetic, function))
        lines += [f"    if number == {number}:", f"        return of_{number}({arguments})"]
    lines.append(f"    return of_0({arguments})")
    exec("\n".join(lines), scope)
    return compile_(scope[function])


constants = _chosen("constants", "p, h, c", list(NEURONS))
step = _chosen("step", _STEP, list(NEURONS))
fire = _chosen("fire", "s, c, i", list(NEURONS))
quiet = _chosen("quiet", "s, c, i_0, lo, hi", list(NEURONS))

on_post = _chosen("on_post", "y, e, c, k_plus", RULES, merged)
on_pre = _chosen("on_pre", "y, e, c, k_minus", RULES, merged)
advance = _chosen("advance", "y, e, c, begin, end, n, grid", [r for r in RULES if r.modulated])
MODULATED_RULES = [r for r in RULES if r.modulated]
