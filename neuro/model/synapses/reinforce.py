"""Learning what to do by reward: the gradient of a spiking policy, taken locally, with eligibility over moves."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.synapses.td_lambda import E, constants, td_lambda, teach

__all__ = ["constants", "gather", "reinforce", "teach"]


@dataclass(frozen=True, kw_only=True, eq=False)
class reinforce(td_lambda):
    """An actor's rule: as `td_lambda`, but e grows by (S - p) x in each step.

    S is whether the neuron spikes in the step, and p the probability with which it does, a state of its model
    (`soft_wta`, `pp_psc_delta`): a spike that was not expected counts in full, one that was sure not at all. In the
    mean over draws that is the gradient of the log probability of the spikes with respect to the weight.

    Source: Williams, Machine Learning 8:229, 1992 (characteristic eligibility); for spikes Pfister, Toyoizumi, Barber
    & Gerstner, Neural Comput. 18:1318, 2006.
    """

    equation: ClassVar[str] = "e += (S - p) x in each step; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Williams, Machine Learning 8:229, 1992; Pfister et al., Neural Comput. 18:1318, 2006"
    sees: ClassVar[str] = "p"


def gather(y, e, c, pre, spikes, seen, gate):
    """What was done less what was expected."""
    y[E, e] += gate * (spikes - seen) * pre[0]
