"""The tempotron, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.lessons import Lesson, TrialEnd

INF = math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class tempotron(Synapse):
    """After a mistake, inputs change by how much each added to the potential at its largest.

    dw = +lambda K(t_max - t_i) for the neuron that should have fired, dw = -lambda K(t_max - t_i) for the one that
    should not, over the inputs that arrived up to t_max. K(t) = V0 (exp(-t/tau_m) - exp(-t/tau_s)) is the course of a
    postsynaptic potential, V0 such that its largest value is 1: `tau_m` and `tau_s` are best those of the neuron
    (tau_m and tau_syn_ex of `iaf_psc_exp`; tau_m and 0 for `iaf_psc_delta`). A neuron that decided wrongly has its
    t_max at its spike. The one that should have fired is, in a wrong or silent trial, the neuron of the right label
    with the largest V_m up to the decision; t_max is the tick of it.

    With `alone`, each neuron is taught by itself, as in the paper: in a trial in which no neuron decides (V_th is set
    out of reach while learning), all neurons of the right label should have reached `alone`, and no others; t_max is
    the tick of a neuron's largest V_m. Where one decides, it is as without.

    Source: Guetig & Sompolinsky, Nat. Neurosci. 9:420, 2006. Without `alone`, one neuron of a group fires at most, so
    that of the others none erred by firing.
    """

    equation: ClassVar[str] = "dw = +-lambda K(t_max - t_i) after a mistake, K(t) = V0 (exp(-t/tau_m) - exp(-t/tau_s))"
    source: ClassVar[str] = "Guetig & Sompolinsky, Nat. Neurosci. 9:420, 2006"
    learns: ClassVar[str] = "trials"
    peaks: ClassVar[bool] = True
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("Wmin", "Wmax"))

    lambda_: float = quantity(0.01, "", "step size, in the unit of the weight", at_least=0, of_value=True)
    tau_m: float = quantity(15.0, "ms", "time constant of the membrane", above=0, infinite=True)
    tau_s: float = quantity(3.75, "ms", "time constant of the synaptic current", at_least=0)
    Wmin: float = quantity(-INF, "", "smallest weight, in the unit of the weight", infinite=True, of_value=True)
    Wmax: float = quantity(INF, "", "largest weight, in the unit of the weight", infinite=True, of_value=True)
    alone: float = quantity(INF, "mV", "V_m that each neuron is taught by itself to reach, or not", infinite=True)

    def lessons(self, end: TrialEnd) -> list[Lesson]:
        """After a mistake the neuron that decided, and the one that should have."""
        if end.winner < 0 and self.alone < INF:
            return self._lessons_alone(end)
        if end.hit:
            return []
        found = [Lesson(end.winner, end.tick, -1.0)] if end.winner >= 0 else []
        neuron, tick = end.highest()
        if neuron >= 0:
            found.append(Lesson(neuron, tick, 1.0))
        return found

    def _lessons_alone(self, end: TrialEnd) -> list[Lesson]:
        """Each neuron that did not reach what it should have, or did what it should not."""
        assert end.peak is not None
        assert end.peak_tick is not None
        per_map = len(end.peak) // len(end.silenced)
        wanted = np.repeat(np.isin(np.arange(len(end.silenced)), end.maps), per_map)
        erred = np.flatnonzero(np.repeat(~end.silenced, per_map) & ((end.peak >= self.alone) != wanted))
        signs = np.where(wanted[erred], 1.0, -1.0)
        return list(map(Lesson, erred.tolist(), end.peak_tick[erred].tolist(), signs.tolist()))


STEP, TAU_M, TAU_S, W_MIN, W_MAX = range(5)


def constants(p, h, c):
    """The step with V0, then the other parameters."""
    c[:5] = p[:5]
    if p[TAU_S] > 0.0 and p[TAU_M] < math.inf:
        ratio = p[TAU_M] / p[TAU_S]
        c[STEP] = p[STEP] * ratio ** (ratio / (ratio - 1.0)) / (ratio - 1.0)


def teach(w, since, lesson, c):
    """New weight of one input, by what it added to the potential at the moment of the lesson."""
    if since < 0.0:
        return w
    rise = math.exp(-since / c[TAU_S]) if c[TAU_S] > 0.0 else 0.0
    kernel = math.exp(-since / c[TAU_M]) - rise
    return min(c[W_MAX], max(c[W_MIN], w + lesson * c[STEP] * kernel))
