"""Soft bounds of a weight, which rules for trials share."""

# mypy: disable-error-code="no-untyped-def"


def softly(w, rate, w_min, w_max):
    """A weight after a change by rate w (1 - w), relative to its bounds."""
    span = w_max - w_min
    share = (w - w_min) / span
    return min(w_max, max(w_min, w + span * rate * share * (1.0 - share)))
