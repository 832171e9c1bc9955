"""Whether numbers lie within bounds: one pass instead of several of NumPy's, which take longer than a small network."""

# mypy: ignore-errors
from neuro.kernels.jit import kernel


@kernel
def within(values, low, high):
    """Whether all values lie in [low, high]; what is no number does not."""
    inside = True
    for k in range(values.size):
        inside &= (low <= values[k]) & (values[k] <= high)
    return inside
