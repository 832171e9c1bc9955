"""The step of every kind of population, of all families of chips, and the kernel that takes the one of a population."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from neuro.kernels.jit import subkernel
from neuro_chip import loihi2_step, loihi_step, spinnaker_step, tables as t

FAMILIES = {"loihi": loihi_step, "loihi2": loihi2_step, "spinnaker": spinnaker_step}
"""How each family of chips runs here, by the name of its arithmetic: a new family is such a module and an entry."""

STEPS = {kind: step for family in FAMILIES.values() for kind, step in family.STEPS.items()}
"""The step of each kind of population (`FixedPopulation.kind`): step(net, pop, row, step) updates the neurons of a
population and sets `fired` where the threshold is reached."""

NUMBERS = {kind: t.STEPPED + place for place, kind in enumerate(STEPS)}
"""The number of each kind in the loop, column `KIND` of the table of populations."""


def _chosen(numbered):
    """A function (net, pop, row, step) that runs the step whose number a row has; the last one else."""
    (number, own), *others = numbered
    if not others:
        return own
    # A chain of comparisons, since a kernel holds no table of functions: there are few kinds, and a population asks
    # once a step.
    rest = _chosen(others)

    @subkernel
    def chosen(net, pop, row, step):
        if row[t.KIND] == number:
            own(net, pop, row, step)
        else:
            rest(net, pop, row, step)

    return chosen


update = _chosen([(NUMBERS[kind], step) for kind, step in STEPS.items()])
