"""Populations that never fire, or that fall silent, and why: each cause once, with what it silences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from neuro.core.english import some
from neuro.diagnosis.findings import Finding, figure, finding
from neuro.diagnosis.learning import balanced
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.structure import can_fire_alone, is_end
from neuro.diagnosis.wiring import Wiring
from neuro.program.program import Population

NEARLY = 0.9
"""Share of the way to the threshold beyond which a longer run, or another seed, may well bring spikes."""
SHORT_MS = 100.0
"""A run in which silence is no fault yet: at 10 Hz a spike comes every 100 ms."""
EARLY, FADED, KEPT = 10, 0.02, 0.5
"""Spikes in the first third of a run, and the share of them in the last third at which a population has fallen silent,
where each of its inputs keeps half of its spikes. Of 10 spikes expected, none is a chance of 1 in 20,000."""
WITHERED, SLOW_HZ = 0.2, 1.0
"""Such a share, and the rate it comes down to, where learning weakened the inputs, which goes on."""
DEPLETED, SHRUNK = 0.5, 0.75
"""Share of what a rested synapse sends that is left by depression, and of weights by learning, which explains it."""


class Silence:
    """Judges populations that are silent, from the beginning or later.

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
            if part.carries == "current"
            or (part.source not in self.silent and wiring.may_excite(q) and part.delay_span[0] < seen.steps)
        }
        brief = {k for k in range(len(seen.populations)) if seen.is_brief(k)}
        self.waiting = wiring.reached((seen.idle - seen.driven) | brief)

    def falls(self, k: int) -> Iterator[Finding]:
        """Of one population that fired at first, if it falls silent while all that excites it goes on."""
        part, (early, late), after = self.program.populations[k], self._thirds(k), self.wiring.reached([k])
        onto = [q for q in self.wiring.onto(k) if self.wiring.may_excite(q)]
        inputs = [self._thirds(j) for j in {self.program.projections[q].source for q in onto} - after]
        if self.seen.ms < SHORT_MS or early < EARLY or self.wiring.onto(k, "current"):
            return
        if not inputs or any(then < KEPT * before or not then for before, then in inputs):
            return
        moved = {q: self.seen.learning[q] for q in onto if q in self.seen.learning}
        shrunk = [q for q, w in moved.items() if np.abs(w.last).mean() < SHRUNK * np.abs(w.first).mean()]
        slow = bool(shrunk) and 3000.0 * late < SLOW_HZ * part.size * self.seen.ms
        if late > (WITHERED if slow else FADED) * early:
            return
        evidence = (
            f"{some(early, 'spike')} in the first third of the run, {late} in the last, though its inputs went on"
        )
        inhibit, severity = [q for q in self.wiring.onto(k) if self.wiring.pushes(q)[1]], "fault"
        more, remedy = self._held(part) or self._depleted(onto)
        if shrunk:
            first, last = moved[shrunk[0]].first.mean(), moved[shrunk[0]].last.mean()
            more = f": learning brought the mean weight of {self.wiring.names(shrunk)} from {first:.3g} to {last:.3g}"
            remedy = f"{balanced(self.program.projections[shrunk[0]], grows=False)}, or lower the learning rate"
        elif inhibit and not more:
            if not late and not after & {self.program.projections[q].source for q in inhibit}:  # no loop that settles
                yield self._inhibited(k, "falls-silent", evidence, inhibit)
            return
        elif not more:
            remedy = f"raise `weight` of {self.wiring.names(onto)}: initial states made it fire at first, or it adapts"
            severity = "fault" if is_end(self.wiring, k) else "warning"
        yield finding("falls-silent", severity, part, evidence + more, remedy, part.name)

    def _thirds(self, k: int) -> tuple[int, int]:
        """Spikes in the first and in the last third of the run."""
        course, third = self.seen.course[:, k], max(1, len(self.seen.course) // 3)
        return int(course[:third].sum()), int(course[-third:].sum())

    def _held(self, part: Population) -> tuple[str, str] | None:
        """A refractory time of a third of the run or more, and what to do; None where it is shorter."""
        held = float(part.parameters.get("t_ref", np.zeros(1)).min())
        return (f"; t_ref is {held:g} ms", f"lower t_ref of '{part.name}'") if 3.0 * held >= self.seen.ms else None

    def _depleted(self, onto: list[int]) -> tuple[str, str]:
        """What short-term depression leaves of a projection, and how to leave more; empty where none depletes."""
        for q in onto:
            part, rate = self.program.projections[q], self.seen.per_step()
            rested, left = (self.wiring.efficacy(q, per_step) for per_step in (1e-9, rate[part.source]))
            if left < DEPLETED * rested:
                words = [word for word in ("U", "tau_rec") if word in part.synapse.parameters()]
                said = (
                    f"; short-term depression leaves {left:.2g} of the weights of '{part.name}' at the "
                    f"{self.seen.rate(part.source):.3g} Hz of its source, where a rested synapse sends {rested:.2g}"
                )
                return said, f"lower {' or '.join(words) or 'the depression'} of '{part.name}'"
        return "", ""

    def _inhibited(self, k: int, name: str, evidence: str, inhibit: list[int]) -> Finding:
        sources = {self.program.projections[q].source for q in inhibit}
        back = {self.program.projections[q].target for q in self.wiring.out_of(k) if self.wiring.pushes(q)[1]}
        # Of populations that inhibit each other one may lose.
        severity, part = "note" if sources & back else "warning", self.program.populations[k]
        remedy = f"lower the inhibition of {self.wiring.names(inhibit)}, or raise its excitation"
        return finding(name, severity, part, evidence, remedy, part.name)

    def findings(self, k: int) -> Iterator[Finding]:
        """Of one population; none if the cause lies before it, or an input is missing."""
        part, cell = self.program.populations[k], self.wiring.cell(k)
        # Of a model that is not followed nothing is known but what it hears.
        alone = can_fire_alone(self.wiring, k) if cell is not None else not self.wiring.onto(k)
        if k in self.waiting or not (k in self.heard or alone):
            return
        v = self.seen.populations[k].potentials
        evidence = f"0 of {some(part.size, 'neuron')} fired in {self.seen.ms:g} ms{self._silenced(k)}"
        if cell is None or not v.size:
            yield self._silent(k, part, evidence, "")
            return
        top = float(v.max())
        evidence += f"; the largest V_m was {top:.4g} mV, V_th is {cell.threshold:g} mV"
        per_step, current = self.seen.per_step(), self.wiring.current(k)
        up, crossed = cell.follow(self.wiring.drive(k, per_step, excite=True), current=current)
        mean, _ = cell.follow(self.wiring.drive(k, per_step), current=current)
        lift = float(up[-1]) - cell.rest
        if (crossed or lift > NEARLY * cell.distance) and mean[-1] < up[-1]:
            evidence += f"; excitation alone leads to {up[-1]:.4g} mV, inhibition keeps the mean at {mean[-1]:.4g} mV"
            inhibit = [q for q in self.wiring.onto(k) if self.wiring.pushes(q)[1]]
            yield self._inhibited(k, "silenced", evidence, inhibit)
            return
        evidence += f"; its mean excitation leads to {up[-1]:.4g} mV{rheobase(part)}"
        times = f" to about {figure(cell.distance / lift)} times" if lift > 1e-4 * cell.distance else ""
        found = self._silent(k, part, evidence, times)
        nearly = top - cell.rest > NEARLY * cell.distance and found.severity == "fault"
        yield replace(found, severity="warning") if nearly else found

    def _silent(self, k: int, part: Population, evidence: str, times: str) -> Finding:
        # A short run says little, and an output whose states are recorded may be looked at below its threshold.
        sources = {self.program.projections[q].source for q in self.wiring.onto(k)}
        stimuli = all(self.program.populations[j].kind == "listed" for j in sources)
        probed = any(p.population == k and p.record not in ("spikes", "rate") for p in self.program.probes)
        severity = "note" if probed and stimuli and not self.wiring.out_of(k) else "fault"
        # Recurrent weights are no remedy: nothing arrives by them before the first spike, and too much after it.
        heard = [q for q in self.wiring.onto(k) if self.program.projections[q].source not in self.silent]
        onto = [q for q in heard if self.wiring.may_excite(q)] + self.wiring.onto(k, "current")
        slow = {j for j in (self.program.projections[q].source for q in onto) if self.seen.rate(j) < SLOW_HZ}
        before = [q for j in sorted(slow) for q in self.wiring.onto(j) if self.wiring.may_excite(q)]
        depleted, rested = self._depleted(onto + before)
        rates = "" if depleted else ", or the rate of its inputs"  # they deplete it the more
        names = f"`weight` of {self.wiring.names(onto)}{times}{rates}" if onto else "its I_e"
        sources = {self.program.projections[q].source for q in onto}
        shows = [p.name for j, p in enumerate(self.program.populations) if j in sources and p.records and j != k]
        held_down = " or I_e" if onto and float(part.parameters.get("I_e", np.zeros(1)).max()) < 0.0 else ""
        remedy = f"raise {names}{held_down}, or lower {'V_th' if 'V_th' in part.parameters else 'its threshold'}"
        if depleted:
            evidence, remedy = evidence + depleted, f"{rested}, or {remedy}"
        severity = "note" if self.seen.ms < SHORT_MS else severity
        return finding("silent", severity, part, evidence, remedy, part.name, *shows)

    def _silenced(self, k: int) -> str:
        """The populations that hear nothing since it is silent."""
        after = (self.wiring.reached([k]) - {k} - self.heard) & self.silent
        names = ", ".join(f"'{self.program.populations[j].name}'" for j in sorted(after)[:5])
        return f", so nothing reaches {names}" if names else ""


def rheobase(part: Population) -> str:
    """The constant current that brings V_m to the threshold, in words; "" where it is not known."""
    p = {word: float(v[0]) for word, v in part.parameters.items()}
    if not {"tau_m", "C_m", "E_L"} <= p.keys() or not np.isfinite(p["tau_m"]):
        return ""
    return f", its rheobase is {p['C_m'] * (p['V_th'] - p['E_L']) / p['tau_m']:.3g} pA"
