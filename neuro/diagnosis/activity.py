"""What a short run shows of activity: silence, ceilings, runaway, volleys, copies, dead neurons."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from neuro.core.english import some
from neuro.diagnosis.findings import Finding, fault, figure, finding, note, warning
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.structure import can_fire_alone
from neuro.diagnosis.wiring import Wiring
from neuro.model.neurons import Neuron
from neuro.program.program import Population

CEILING, RUNAWAY = 0.7, 0.5
"""Shares of the highest possible rate. At the first a neuron gets 13 times the input that makes it fire (tau_m 10 ms,
t_ref 2 ms), and twice as much adds a tenth. The second is of populations that excite themselves: no cortical rhythm is
near it."""
SLOW_HZ = 50.0
"""A rate below it is no ceiling: neurons with a long t_ref answer once to each of several inputs."""
SHORT_MS = 100.0
"""A run that silence is no fault in: at 10 Hz a spike comes every 100 ms."""
CROWD = 10
"""Neurons below which a common rhythm may be chance."""
VOLLEY = 0.5
"""Share of neurons that fire within a bin which makes a volley."""
IN_VOLLEYS = 0.8
"""Share of spikes in volleys that makes activity synchronous. Gamma rhythms of balanced networks have volleys of a few
percent of the neurons."""
DEAD = 0.25
"""Share of outputs without a spike that is reported: weights drawn around 0 leave some without a net excitation."""
COLLECTIVE = 3.0
"""Variance over mean of the spikes in a step above which neurons act together; independent ones have at most 1."""
FEW_STEPS = 4
"""A rhythm of so few steps follows from the resolution: delay and reset are one step each at least."""


def findings(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Findings about activity."""
    if seen.unstable:
        evidence = f"{seen.unstable}, on {seen.program.resolution:g} ms steps"
        remedy = f"use a finer `resolution`, as {seen.program.resolution / 4.0:g} ms, or smaller weights and currents"
        yield fault("unstable", seen.program, evidence, remedy)
        return
    yield from _inputs(wiring, seen)
    decided = {
        g.population for g in seen.program.groups if getattr(g.choice, "first_to_fire", False) or g.choice.several
    }
    silent, tried = _Silence(wiring, seen), wiring.reached(seen.driven)
    for k, part in enumerate(seen.program.populations):
        if part.kind != "neuron" or seen.steps == 0:
            continue
        if not seen.populations[k].spikes.any():
            found = silent.findings(k)
        elif k not in decided:  # their spikes end with a decision
            found = _firing(wiring, seen, k)
        else:
            continue
        # What an input does that was made up for the examination proves no fault.
        yield from map(_milder, found) if k in tried else found


def _milder(found: Finding) -> Finding:
    return replace(found, severity="warning") if found.severity == "fault" else found


def _firing(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Of a population that fires."""
    yield from list(_fast(wiring, seen, k)) or _volleys(wiring, seen, k)
    yield from _copies(wiring, seen, k)
    yield from _dead(wiring, seen, k)


def _inputs(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Generators that gave nothing, though the rest of the network may wait for them."""
    program, h = seen.program, seen.program.resolution
    for k, part in enumerate(program.populations):
        if part.kind in ("neuron", "current"):
            continue
        heard = bool(wiring.out_of(k))
        if k in seen.idle - seen.driven and heard:
            lacks, word = (
                ("its rate is 0 Hz", "rate") if part.kind == "poisson" else ("it lists no spikes", "spike_times")
            )
            remedy = f"feed it from a program, or set its {word}; `neuro doctor --drive 20Hz` tries Poisson spikes"
            yield note("no-input", part, f"no input was given: {lacks}", remedy)
        elif k not in seen.idle and not seen.populations[k].spikes.any() and heard and part.stop > part.start:
            first = part.spike_steps.min(initial=2**62) if part.kind == "listed" and part.stream is None else part.start
            if first >= seen.steps:
                evidence = f"its first spikes come at {first * h:g} ms, after the run of {seen.ms:g} ms"
                yield warning("late-input", part, evidence, "run longer (`--for`), or check its times: they are in ms")
            else:
                yield warning(
                    "late-input", part, f"it emitted no spike in {seen.ms:g} ms", "raise its rate, or run longer"
                )


class _Silence:
    """Populations that never fire, and why: each cause once, with what it silences."""

    def __init__(self, wiring: Wiring, seen: Observation) -> None:
        self.wiring, self.seen = wiring, seen
        self.per_step = seen.per_step()
        active = [k for k, s in enumerate(seen.populations) if s.spikes.any()]
        program = seen.program
        self.heard = {k for k, part in enumerate(program.populations) if wiring.onto(k, "current")}
        sent = [p for q, p in enumerate(program.projections) if p.source in active and wiring.weights[q].synapses]
        self.heard |= {p.target for p in sent}
        self.waiting = wiring.reached(seen.idle - seen.driven)

    def findings(self, k: int) -> Iterator[Finding]:
        """Of one population."""
        part = self.seen.program.populations[k]
        alone = can_fire_alone(self.wiring, k)
        if k not in self.heard and not alone:
            return  # there is no way to it, an input is missing, or what is before it is silent: that is reported there
        if k in self.waiting and not self._is_fed(k):
            return
        v = self.seen.populations[k].potentials
        cell = self.wiring.cell(k)
        fired = f"0 of {some(part.size, 'neuron')} fired in {self.seen.ms:g} ms"
        after = self._silenced_by(k)
        if after:
            fired += f", so nothing reaches {after}"
        if cell is None or not v.size:
            yield finding("silent", self._severity(k), part, fired, self._general(k), part.name)
            return
        top = float(v.max())
        fired += f"; the largest V_m was {top:.4g} mV, {cell.threshold - top:.3g} mV below V_th = {cell.threshold:g} mV"
        x = self.wiring.drive(k, self.per_step)
        current = self.wiring.current(k)
        up, crossed = cell.follow(self.wiring.drive(k, self.per_step, excite=True), current=current)
        mean, _ = cell.follow(x, current=current)
        arrived = float(mean[-1]) if mean.size else cell.rest
        if crossed and arrived < cell.threshold:
            evidence = (
                f"{fired}; its excitation alone would make it fire, inhibition keeps the mean at {arrived:.4g} mV"
            )
            names = self._names(k, inhibit=True)
            yield warning(
                "silenced", part, evidence, f"lower the inhibition of {names}, or raise its excitation", part.name
            )
            return
        lift = (float(up[-1]) if up.size else cell.rest) - cell.rest
        fired += f"; its mean excitation lifts V_m by {lift:.3g} of {cell.distance:.3g} mV{self._rheobase(k)}"
        if lift > 1e-4 * cell.distance:
            times = f"{figure(cell.distance / lift)} times"
            remedy = f"raise `weight` of {self._names(k)} to about {times}, or the rate of its inputs, or lower V_th"
        else:
            remedy = self._general(k)
        yield finding("silent", self._severity(k), part, fired, remedy, part.name, *self._sources(k))

    def _severity(self, k: int) -> str:
        """An output whose states are recorded may be looked at below its threshold; a short run says little."""
        if self.seen.ms < SHORT_MS:
            return "note"
        probes = [p for p in self.seen.program.probes if p.population == k and p.record not in ("spikes", "rate")]
        return "warning" if probes and not self.wiring.out_of(k) else "fault"

    def _is_fed(self, k: int) -> bool:
        """Whether another input than those that were not given reaches a population."""
        begin = [j for j, s in enumerate(self.seen.populations) if s.spikes.any()]
        return k in self.wiring.reached(begin) and not any(
            self.seen.program.projections[q].source in (self.seen.idle - self.seen.driven) | self.waiting
            for q in self.wiring.onto(k)
        )

    def _rheobase(self, k: int) -> str:
        p = {word: float(v[0]) for word, v in self.seen.program.populations[k].parameters.items()}
        if "tau_m" in p and "C_m" in p and np.isfinite(p["tau_m"]) and "E_L" in p:
            return f", its rheobase is {p['C_m'] * (p['V_th'] - p['E_L']) / p['tau_m']:.3g} pA"
        return ""

    def _silenced_by(self, k: int) -> str:
        program = self.seen.program
        after = self.wiring.reached([k]) - {k}
        names = [
            program.populations[j].name
            for j in sorted(after)
            if j not in self.heard and not self.seen.populations[j].spikes.any()
        ]
        return ", ".join(f"'{name}'" for name in names[:5])

    def _names(self, k: int, inhibit: bool = False) -> str:
        wanted = [q for q in self.wiring.onto(k) if self.wiring.pushes(q)[1 if inhibit else 0] != 0.0]
        wanted += [] if inhibit else self.wiring.onto(k, "current")
        return ", ".join(f"'{self.seen.program.projections[q].name}'" for q in wanted[:5]) or "its inputs"

    def _sources(self, k: int) -> list[str]:
        populations = self.seen.program.populations
        sources = {self.seen.program.projections[q].source for q in self.wiring.onto(k)}
        return [populations[j].name for j in sorted(sources) if populations[j].records and j != k]

    def _general(self, k: int) -> str:
        return f"raise `weight` of {self._names(k)} or the rate of its inputs, or lower its threshold"


def ceiling_hz(part: Population, h: float) -> float:
    """The highest rate of a neuron in Hz: one spike in each refractory period and step."""
    held = part.parameters.get("t_ref", part.parameters.get("dead_time", np.zeros(1)))
    return 1000.0 / (round(float(held.min()) / h) * h + h)


def _fast(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    part = seen.program.populations[k]
    if not isinstance(part.model, Neuron) or part.model.relay or part.model.chip or part.model.most:
        return
    rate, most = seen.rate(k), ceiling_hz(part, seen.program.resolution)
    again = wiring.excites_itself(k)
    if rate < max((RUNAWAY if again else CEILING) * most, SLOW_HZ):
        return
    fires = f"the mean rate of {some(part.size, 'neuron')} is {rate:.3g} Hz"
    evidence = f"{fires}, {rate / most:.0%} of the {most:.3g} Hz that t_ref allows"
    if again:
        names = ", ".join(f"'{seen.program.projections[q].name}'" for q in _loops(wiring, k))
        remedy = f"lower `weight` of {names}, or strengthen the inhibition onto it"
        yield fault("runaway", part, f"{evidence}; it excites itself through {names}", remedy, part.name)
    else:
        remedy = f"lower the weights or rates of its inputs{_by(wiring, seen, k)}, or its I_e"
        yield fault("ceiling", part, evidence, remedy, part.name)


def _loops(wiring: Wiring, k: int) -> list[int]:
    """Projections onto a population that excite it and come from what it reaches itself."""
    after = wiring.reached([k])
    return [q for q in wiring.onto(k) if wiring.program.projections[q].source in after and wiring.pushes(q)[0] > 0.0]


def _by(wiring: Wiring, seen: Observation, k: int) -> str:
    """How far the mean input is beyond the threshold, as a share to which it may be lowered."""
    cell = wiring.cell(k)
    if cell is None or cell.distance <= 0.0:
        return ""
    x = wiring.drive(k, seen.per_step())
    pull = sum(x[r] * cell.slope(r) for r in range(min(x.size, cell.model.receptors)))
    # What a spike leaves lasts about a membrane time constant.
    tau = cell.parameters.get("tau_m", 10.0)
    mean = pull * min(tau, 1000.0) / cell.h
    return f" to about 1/{figure(mean / cell.distance)}" if mean > 1.5 * cell.distance else ""


def _volleys(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    part, s, h = seen.program.populations[k], seen.populations[k], seen.program.resolution
    active = int((s.spikes > 0).sum())
    if active < CROWD or not s.bins.size or not s.bins.any():
        return
    in_volley = s.bins >= VOLLEY * active
    # A volley may lie across the edge of two bins.
    pairs = s.bins[:-1] + s.bins[1:] >= VOLLEY * active
    in_volley[:-1] |= pairs
    in_volley[1:] |= pairs
    begins = np.flatnonzero(np.diff(in_volley.astype(np.int8), prepend=0) == 1)
    share = float(s.bins[in_volley].sum() / s.bins.sum())
    back = _comes_back(wiring, k)
    if begins.size < 5 or share < IN_VOLLEYS or not back or float(in_volley.mean()) > 0.5:
        yield from _alternates(seen, k, back)
        return
    if _is_copied(seen, k) or not wiring.excites_itself(k):
        return  # equal inputs make equal spikes, and inhibition may well pace a population
    period = float(np.median(np.diff(begins))) * seen.bin * h
    volleys = f"{begins.size} volleys of more than half of {active:,} neurons"
    evidence = f"{share:.0%} of its spikes fall into {volleys}, {period:.3g} ms apart"
    names = ", ".join(f"'{seen.program.projections[q].name}'" for q in _loops(wiring, k))
    spread = "spread its delays (`delay: {uniform: ...}`)"
    remedy = f"lower `weight` of {names}, {spread}, or give each neuron noise of its own"
    yield fault("synchrony", part, evidence, remedy, part.name)


def _comes_back(wiring: Wiring, k: int) -> bool:
    """Whether spikes of a population have any effect on it."""
    return any(wiring.program.projections[q].source in wiring.reached([k], excite=False) for q in wiring.onto(k))


def _alternates(seen: Observation, k: int, back: bool) -> Iterator[Finding]:
    """A rhythm of a few steps of neurons that hear each other, which another resolution would not have."""
    part, s, h = seen.program.populations[k], seen.populations[k], seen.program.resolution
    if not back or s.ids.size < CROWD or _is_copied(seen, k) or seen.steps < 100:
        return
    steps = s.bins if seen.bin == 1 else np.bincount(s.steps, minlength=seen.steps + 1)[1:]
    if steps.mean() == 0.0 or steps.var() < COLLECTIVE * steps.mean():
        return
    power = np.abs(np.fft.rfft(steps - steps.mean())) ** 2
    per_step = np.fft.rfftfreq(steps.size)
    fast = per_step >= 1.0 / FEW_STEPS
    if power[fast].sum() > IN_VOLLEYS * power.sum():
        period = 1.0 / per_step[int(power.argmax())]
        evidence = (
            f"its spikes come every {period:.2g} steps of {h:g} ms: {power[fast].sum() / power.sum():.0%} of the "
            f"variance of their number, which is {steps.var() / steps.mean():.2g} times that of independent neurons"
        )
        remedy = f"use a finer `resolution`, as {h / 10.0:g} ms, with delays of many steps, drawn for each synapse"
        yield fault("step-oscillation", part, evidence, remedy, part.name)


def _is_copied(seen: Observation, k: int) -> bool:
    """Whether all neurons that were followed fired the same spikes, at least three."""
    s = seen.populations[k]
    if s.ids.size < 2 or s.steps.size < 3 * s.ids.size or s.steps.size % s.ids.size:
        return False
    trains = np.sort(s.steps * s.ids.size + s.rows).reshape(-1, s.ids.size)
    return bool(
        (trains % s.ids.size == np.arange(s.ids.size)).all()
        and (trains // s.ids.size == trains[:, :1] // s.ids.size).all()
    )


def _copies(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    if not _is_copied(seen, k):
        return
    part, s = seen.program.populations[k], seen.populations[k]
    # A signal has a value for each neuron, so it may teach copies differently.
    learns = [p.name for p in seen.program.projections if p.target == k and p.synapse.learns and p.signal < 0]
    n = s.steps.size // s.ids.size
    evidence = f"{some(s.ids.size, 'neuron')} that were followed fired the same {some(n, 'spike')} in the same steps"
    remedy = "draw the weights onto them, connect them at random, or let `initial` differ; one neuron does as much"
    if learns:
        evidence += f", so '{learns[0]}' teaches all of them alike"
    yield finding("neurons-alike", "warning" if learns else "note", part, evidence, remedy, part.name)


def _dead(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Neurons of an output that stay silent while the others fire: more than chance explains."""
    part, spikes = seen.program.populations[k], seen.populations[k].spikes
    outputs = [p.target for p in seen.program.projections if p.source == k and p.target != k]
    silent = int((spikes == 0).sum())
    if outputs or not silent or part.size < 2:
        return
    others = float(spikes[spikes > 0].mean())
    if others < 10.0 or silent < DEAD * part.size:  # of 10 spikes expected, none is a chance of 1 in 20,000
        return
    evidence = (
        f"{silent:,} of {some(part.size, 'neuron')} never fired, the others {others:.3g} times each in {seen.ms:g} ms"
    )
    ids = ", ".join(map(str, np.flatnonzero(spikes == 0)[:5]))
    remedy = f"look at the inputs of neurons {ids}: raise their weights, or draw them with less spread"
    yield warning("dead-outputs", part, evidence, remedy, part.name)
