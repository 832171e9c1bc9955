"""Populations that never fire, and why: each cause once, with what it silences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from neuro.core.english import some
from neuro.diagnosis.findings import Finding, figure, finding
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.structure import can_fire_alone
from neuro.diagnosis.wiring import Wiring
from neuro.program.program import Population

NEARLY = 0.9
"""Share of the way to the threshold beyond which a longer run, or another seed, may well bring spikes."""
SHORT_MS = 100.0
"""A run in which silence is no fault yet: at 10 Hz a spike comes every 100 ms."""


class Silence:
    """Judges populations without a spike.

    Args:
        wiring: of the network.
        seen: the run.
    """

    def __init__(self, wiring: Wiring, seen: Observation) -> None:
        self.wiring, self.seen, self.program = wiring, seen, seen.program
        self.silent = {k for k, s in enumerate(seen.populations) if not s.spikes.any()}
        self.heard = {
            part.target
            for q, part in enumerate(self.program.projections)
            if part.carries == "current" or (part.source not in self.silent and self._may_excite(q))
        }
        brief = {k for k in range(len(seen.populations)) if seen.is_brief(k)}
        self.waiting = wiring.reached((seen.idle - seen.driven) | brief)

    def _may_excite(self, q: int) -> bool:
        part = self.program.projections[q]
        return self.wiring.pushes(q)[0] > 0.0 or (part.synapse.learns != "" and self.wiring.weights[q].synapses > 0)

    def findings(self, k: int) -> Iterator[Finding]:
        """Of one population; none if the cause lies before it, or an input is missing."""
        part, cell = self.program.populations[k], self.wiring.cell(k)
        if k in self.waiting or not (k in self.heard or can_fire_alone(self.wiring, k)):
            return
        v = self.seen.populations[k].potentials
        evidence = f"0 of {some(part.size, 'neuron')} fired in {self.seen.ms:g} ms{self._silenced(k)}"
        if cell is None or not v.size:
            yield self._silent(k, part, evidence, "")
            return
        top = float(v.max())
        evidence += (
            f"; the largest V_m was {top:.4g} mV, {cell.threshold - top:.3g} mV below V_th = {cell.threshold:g} mV"
        )
        per_step, current = self.seen.per_step(), self.wiring.current(k)
        up, crossed = cell.follow(self.wiring.drive(k, per_step, excite=True), current=current)
        mean, _ = cell.follow(self.wiring.drive(k, per_step), current=current)
        lift = float(up[-1]) - cell.rest
        if (crossed or lift > NEARLY * cell.distance) and mean[-1] < up[-1]:
            evidence += (
                f"; its excitation alone leads to {up[-1]:.4g} mV, inhibition keeps the mean at {mean[-1]:.4g} mV"
            )
            inhibit = [q for q in self.wiring.onto(k) if self.wiring.pushes(q)[1]]
            sources = {self.program.projections[q].source for q in inhibit}
            back = {self.program.projections[q].target for q in self.wiring.out_of(k) if self.wiring.pushes(q)[1]}
            # Of populations that inhibit each other one may lose.
            severity = "note" if sources & back else "warning"
            remedy = f"lower the inhibition of {self.wiring.names(inhibit)}, or raise its excitation"
            yield finding("silenced", severity, part, evidence, remedy, part.name)
            return
        evidence += f"; its mean excitation leads to {up[-1]:.4g} mV{_rheobase(part)}"
        times = f" to about {figure(cell.distance / lift)} times" if lift > 1e-4 * cell.distance else ""
        found = self._silent(k, part, evidence, times)
        nearly = top - cell.rest > NEARLY * cell.distance and found.severity == "fault"
        yield replace(found, severity="warning") if nearly else found

    def _silent(self, k: int, part: Population, evidence: str, times: str) -> Finding:
        # A short run says little, and an output whose states are recorded may be looked at below its threshold.
        probed = any(p.population == k and p.record not in ("spikes", "rate") for p in self.program.probes)
        severity = "warning" if probed and not self.wiring.out_of(k) else "fault"
        # Recurrent weights are no remedy: nothing arrives by them before the first spike, and too much after it.
        heard = [q for q in self.wiring.onto(k) if self.program.projections[q].source not in self.silent]
        onto = [q for q in heard if self._may_excite(q)] + self.wiring.onto(k, "current")
        names = f"`weight` of {self.wiring.names(onto)}{times}, or the rate of its inputs" if onto else "its I_e"
        sources = {self.program.projections[q].source for q in onto}
        shows = [p.name for j, p in enumerate(self.program.populations) if j in sources and p.records and j != k]
        held_down = " or I_e" if onto and float(part.parameters.get("I_e", np.zeros(1)).max()) < 0.0 else ""
        remedy = f"raise {names}{held_down}, or lower V_th"
        return finding(
            "silent", "note" if self.seen.ms < SHORT_MS else severity, part, evidence, remedy, part.name, *shows
        )

    def _silenced(self, k: int) -> str:
        """The populations that hear nothing since it is silent."""
        after = (self.wiring.reached([k]) - {k} - self.heard) & self.silent
        names = ", ".join(f"'{self.program.populations[j].name}'" for j in sorted(after)[:5])
        return f", so nothing reaches {names}" if names else ""


def _rheobase(part: Population) -> str:
    p = {word: float(v[0]) for word, v in part.parameters.items()}
    if not {"tau_m", "C_m", "E_L"} <= p.keys() or not np.isfinite(p["tau_m"]):
        return ""
    return f", its rheobase is {p['C_m'] * (p['V_th'] - p['E_L']) / p['tau_m']:.3g} pA"
