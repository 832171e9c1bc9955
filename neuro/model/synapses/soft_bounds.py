"""What rules for trials share: soft bounds of a weight, and the check that one parameter is below another."""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

from neuro.core.errors import ModelError
from neuro.model.synapses.base import Synapse


def check_below(rule: Synapse, low: str, high: str) -> None:
    """Refuse a rule of which one parameter is not less than another of the same unit.

    Raises:
        ModelError: it says which.
    """
    small, large, unit = getattr(rule, low), getattr(rule, high), rule.quantities()[low].unit
    if not small < large:
        of_unit = f" {unit}" if unit else ""
        raise ModelError(
            f"{rule.name}.{low} = {small:g}{of_unit}: expected less than {high} = {large:g}{of_unit}", path=(low,)
        )


def softly(w, rate, w_min, w_max):
    """A weight after a change by rate w (1 - w), relative to its bounds."""
    span = w_max - w_min
    share = (w - w_min) / span
    return min(w_max, max(w_min, w + span * rate * share * (1.0 - share)))
