"""Which blocks of a generator emit, after its rates were set."""

# mypy: ignore-errors
from neuro.kernels.jit import kernel
from neuro_event.tables import BLOCK


@kernel
def wake_emitting(mean, awake, busy, first, last, step):
    """Let the blocks first:last with a rate above 0 be awake and the others sleep; `busy` tells since when."""
    for block in range(first, last):
        if awake[block] == 1:
            busy[block] = step
        some = False
        for i in range(block * BLOCK, (block + 1) * BLOCK):
            some |= mean[i] != 0.0
        awake[block] = some
