"""The steps of all families as one compiled function, chosen by the number of a population's kind."""

# mypy: ignore-errors
from neuro.kernels.jit import inner
from neuro_chip.families.every import NUMBERS, STEPS
from neuro_chip.tables import KIND


def _chosen(numbered):
    """A function (net, pop, row, step) that runs the step whose number a row has; the last one else."""
    (number, own), *others = numbered
    if not others:
        return own
    rest = _chosen(others)

    @inner
    def chosen(net, pop, row, step):
        if row[KIND] == number:
            own(net, pop, row, step)
        else:
            rest(net, pop, row, step)

    return chosen


update = _chosen([(NUMBERS[kind], step) for kind, step in STEPS.items()])
