"""The models' functions, compiled and chosen by number, so that one loop runs every model.

The choice is written out from the lists of `models`: a model that is entered there runs here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from neuro.kernels.jit import compiled, inner, merged
from neuro_event.models import MODULATED_RULES, RULES


def chosen(function: str, arguments: str, models: Sequence[Any], compile_: Any = inner) -> Any:
    """A compiled function (number, arguments) that calls the function of that name of the numbered model.

    A model's function may take fewer of the arguments: the first ones.
    """
    scope: dict[str, Any] = {}
    lines = [f"def {function}(number, {arguments}):"]
    for number, model in enumerate(models):
        own = getattr(model.arithmetic, function)
        scope[f"of_{number}"] = compiled(own)
        taken = ", ".join(arguments.split(", ")[: own.__code__.co_argcount])
        lines += [f"    if number == {number}:", f"        return of_{number}({taken})"]
    lines.append(lines[2])
    exec("\n".join(lines), scope)
    return compile_(scope[function])


on_post = chosen("on_post", "y, e, c, pre, post", RULES, merged)
on_pre = chosen("on_pre", "y, e, c, pre, post", RULES, merged)
advance = chosen("advance", "y, e, c, begin, end, n, grid", MODULATED_RULES, merged)
