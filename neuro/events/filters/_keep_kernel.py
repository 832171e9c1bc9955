# mypy: ignore-errors
"""Leave out what is not kept."""

from neuro.kernels.jit import kernel


@kernel
def compact(keep, values, out):
    """keep: bool[n]; values: [n]; out: at least one longer than what is kept, since every value is written first."""
    j = 0
    for k in range(keep.shape[0]):
        out[j] = values[k]
        j += keep[k]
