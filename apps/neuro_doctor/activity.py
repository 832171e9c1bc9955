"""Checks of the activity in a short run: silence, missing inputs, ceilings, runaway, rhythms, copies, dead outputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from neuro.apps import some
from neuro.extend import Neuron, Population
from neuro_doctor.findings import Finding, fault, figure, finding, note, warning
from neuro_doctor.learning import balanced
from neuro_doctor.observing import Observation
from neuro_doctor.parts import FAST_HZ, changes_weights
from neuro_doctor.structure import can_fire_alone, is_end
from neuro_doctor.wiring import Ints, Wiring

CEILING, RUNAWAY = 0.7, 0.5
"""Shares of the highest possible rate. At the first a neuron gets 13 times the input that makes it fire (tau_m 10 ms,
t_ref 2 ms), and twice as much adds a tenth. The second is of populations that excite themselves: no cortical rhythm is
near it."""
ALONE = 0.5
"""Share of a rate that a constant current alone brings, which makes it the cause."""
SLOW_HZ = 50.0
"""A rate below it is no ceiling: neurons with a long t_ref answer once to each of several inputs."""
DEAD = 0.25
"""Share of outputs without a spike that is reported: weights drawn around 0 leave some without a net excitation."""


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
    silent, tried = Silence(wiring, seen), wiring.reached(seen.driven)
    for k, part in enumerate(seen.program.populations):
        if part.kind != "neuron" or seen.steps == 0:
            continue
        if not seen.populations[k].spikes.any():
            found = silent.findings(k)
        elif k not in decided:  # their spikes end with a decision
            found = chain(_firing(wiring, seen, k), silent.falls(k))
        else:
            continue
        # What an input does that was made up for the examination proves no fault.
        yield from map(_milder, found) if k in tried else found


def _milder(found: Finding) -> Finding:
    if found.name == "dead-outputs":  # noise is no picture of what an output answers to
        return replace(found, severity="note")
    return replace(found, severity="warning") if found.severity == "fault" else found


def _firing(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Of a population that fires."""
    yield from list(_fast(wiring, seen, k)) or of_rhythm(wiring, seen, k)
    yield from list(shared(wiring, seen, k)) or _copies(wiring, seen, k)
    yield from _dead(wiring, seen, k)


def _inputs(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Generators that gave nothing, though the rest of the network may wait for them."""
    program, h = seen.program, seen.program.resolution
    for k, part in enumerate(program.populations):
        if part.kind in ("neuron", "current"):
            continue
        heard = bool(wiring.out_of(k))
        if k in seen.idle - seen.driven and heard:
            lacks, word = ("lists no spikes", "spike_times") if part.kind == "listed" else ("has rate 0", "rate")
            remedy = f"feed it from a program, or set its {word}; `neuro doctor --drive 20Hz` tries Poisson spikes"
            yield note("no-input", part, f"no input was given: it {lacks}", remedy)
        elif heard and seen.is_brief(k):
            evidence = (
                f"it is on from {part.start * h:g} to {part.stop * h:g} ms only, {(part.stop - part.start) * h:g} of "
                f"{seen.ms:g} ms, and emitted {seen.populations[k].spikes.mean():.2g} spikes a neuron"
            )
            yield warning("brief-input", part, evidence, "check `stop`: its unit is ms; `stop: 1 s` may be written")
        elif k not in seen.idle and not seen.populations[k].spikes.any() and heard and part.stop > part.start:
            first = part.spike_steps.min(initial=2**62) if part.kind == "listed" and part.stream is None else part.start
            if first >= seen.steps:
                evidence = f"its first spikes come at {first * h:g} ms, after the run of {seen.ms:g} ms"
                yield warning("late-input", part, evidence, "run longer (`--for`), or check its times: they are in ms")
            else:
                evidence = f"it emitted no spike in {seen.ms:g} ms"
                yield note("late-input", part, evidence, "raise its rate, or run longer")


def ceiling_hz(part: Population, h: float) -> float:
    """The highest rate of a neuron in Hz: one spike in each refractory period and step."""
    held = part.parameters.get("t_ref", part.parameters.get("dead_time", np.zeros(1)))
    return 1000.0 / (round(float(held.min()) / h) * h + h)


def _fast(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    part = seen.program.populations[k]
    if not isinstance(part.model, Neuron) or part.model.relay or part.model.chip or part.model.most:
        return
    if part.model.graded:
        return  # a message in each step may be what they are for
    if float(np.max(part.parameters.get("max_spikes", 1.0))) > 1.0:
        return  # several spikes in a step are what these neurons are for
    rate, most = seen.rate(k), min(ceiling_hz(part, seen.program.resolution), FAST_HZ)
    again = wiring.excites_itself(k)
    if rate < max((RUNAWAY if again else CEILING) * most, SLOW_HZ):
        return
    fires = f"the mean rate of {some(part.size, 'neuron')} is {rate:.3g} Hz"
    h = seen.program.resolution
    allows = "t_ref allows" if most < min(999.0 / h, FAST_HZ) else f"one spike in each step of {h:g} ms allows"
    allows = "no neuron exceeds" if most == FAST_HZ < 999.0 / h else allows
    evidence = f"{fires}, {rate / most:.0%} of the {most:,.0f} Hz that {allows}"
    if alone := _alone(wiring, k, rate):
        yield fault("ceiling", part, f"{evidence}; {alone[0]}", alone[1], part.name)
    elif again:
        names = wiring.names(wiring.loops(k))
        remedy = f"lower `weight` of {names}, or strengthen the inhibition onto it"
        yield fault("runaway", part, f"{evidence}; it excites itself through {names}", remedy, part.name)
    else:
        remedy = f"lower the weights or rates of {_strongest(wiring, seen, k)}{_by(wiring, seen, k)}"
        yield fault("ceiling", part, evidence, remedy, part.name)


def _alone(wiring: Wiring, k: int, rate: float) -> tuple[str, str] | None:
    """The constant current by which a population fires at half its rate or more without spikes, and what to lower."""
    part, cell, current = wiring.program.populations[k], wiring.cell(k), wiring.current(k)
    if cell is None:
        return None
    i_e = float(part.parameters.get("I_e", np.zeros(1)).mean())
    v, fires = cell.follow(np.zeros(1), current=current + i_e - cell.parameters.get("I_e", 0.0))
    interval = v.size * cell.h + cell.parameters.get("t_ref", 0.0)
    if not fires or 1000.0 / interval < ALONE * rate:
        return None
    said = f"without a spike that arrives it fires every {interval:.3g} ms"
    if cell.distance <= 0.0:
        return f"{said}, as E_L is not below V_th", "lower E_L, or raise V_th"
    if current > i_e:
        names = wiring.names(wiring.onto(k, "current"))
        return f"{said}, by {current:g} pA of {names}", f"lower `weight` of {names}, or the amplitude of its generator"
    return f"{said}, by I_e = {i_e:g} pA{rheobase(part)}", f"lower I_e of '{part.name}'"


def _strongest(wiring: Wiring, seen: Observation, k: int) -> str:
    """The projections that bring most of its excitation."""
    per_step = seen.per_step()
    up = {q: per_step[wiring.program.projections[q].source] * wiring.pushes(q)[0] for q in wiring.onto(k)}
    return wiring.names(q for q, each in up.items() if each >= 0.2 * sum(up.values())) or "its inputs"


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


def _copies(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    if not is_copied(seen, k):
        return
    part, s = seen.program.populations[k], seen.populations[k]
    # A signal has a value for each neuron, so it may teach copies differently.
    learns = [p.name for p in seen.program.projections if p.target == k and changes_weights(p.synapse) and p.signal < 0]
    n = s.steps.size // s.ids.size
    evidence = f"{some(s.ids.size, 'neuron')} that were followed fired the same {some(n, 'spike')} in the same steps"
    remedy = "draw the weights onto them, connect them at random, or let `initial` differ: until then they do the same"
    if learns:
        evidence += f", so '{learns[0]}' teaches all of them alike"
    yield finding("neurons-alike", "warning" if learns else "note", part, evidence, remedy, part.name)


def _dead(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Neurons of an output that stay silent while the others fire: more than chance explains."""
    part, spikes = seen.program.populations[k], seen.populations[k].spikes
    if not is_end(wiring, k) or spikes.all() or part.size < 2:
        return
    inputs = wiring.inputs_of_each(k)  # neurons without any are `unreached`
    dead = np.flatnonzero((spikes == 0) & (True if inputs is None else inputs > 0))
    silent = dead.size
    others = float(spikes[spikes > 0].mean())
    if others < 10.0 or silent < DEAD * part.size:  # of 10 spikes expected, none is a chance of 1 in 20,000
        return
    evidence = f"{silent:,} of {some(part.size, 'neuron')} never fired, the others {others:.3g} times each"
    ids, fire = ", ".join(map(str, dead[:5])), spikes > 0
    remedy = f"look at the inputs of neurons {ids}: raise their weights, or draw them with less spread"
    for word, v in part.parameters.items():
        if v.size > 1 and (v[dead].max() < v[fire].min() or v[dead].min() > v[fire].max()):
            evidence += f"; their {word} is {v[dead].mean():.4g} on average, that of the others {v[fire].mean():.4g}"
            remedy = f"set {word} of neurons {ids} as that of the others"
    # With inhibition some may well lose, before they have learnt.
    excited = not any(wiring.pushes(q)[1] for q in wiring.onto(k))
    severity = "fault" if excited and 2 * silent >= part.size else "warning"
    yield finding("dead-outputs", severity, part, evidence, remedy, part.name)


NEARLY = 0.9
"""Share of the way to the threshold beyond which a longer run, or another seed, may well bring spikes."""
SHORT_MS = 100.0
"""A run in which silence is no fault yet: at 10 Hz a spike comes every 100 ms."""
EARLY, FADED, KEPT = 10, 0.02, 0.5
"""Spikes in the first third of a run, and the share of them in the last third at which a population has fallen silent,
where each of its inputs keeps half of its spikes. Of 10 spikes expected, none is a chance of 1 in 20,000."""
WITHERED, WITHERED_HZ = 0.2, 1.0
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
        slow = bool(shrunk) and 3000.0 * late < WITHERED_HZ * part.size * self.seen.ms
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
        slow = {j for j in (self.program.projections[q].source for q in onto) if self.seen.rate(j) < WITHERED_HZ}
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


CROWD = 10
"""Neurons below which a common rhythm may be chance."""
VOLLEY = 0.5
"""Share of neurons that fire within a bin which makes a volley."""
WIDTHS_MS = (1.0, 2.0, 5.0, 10.0, 20.0)
"""Lengths of volleys: along equal delays a millisecond, along spread ones as long as the slowest delays and inputs."""
IN_VOLLEYS, MORE = 0.7, 0.3
"""Share of spikes in volleys that makes activity synchronous, and how far that is above their share of time. Gamma
rhythms of balanced networks have volleys of a few percent of the neurons."""
LOOP = 0.1
"""Share of the way to the threshold that one spike of each neuron brings back, below which inhibition sets the pace."""
COLLECTIVE = 3.0
"""Variance over mean of the spikes in a step above which neurons act together; independent ones have at most 1."""
FEW_STEPS, FAST = 4, 0.8
"""A rhythm of so few steps follows from the resolution: delay and reset are one step each at least."""

NOISE_HZ = 200.0
"""A generator neuron that is faster stands for the noise of many neurons, and not for a stimulus that all may hear."""
MAIN = 0.5
"""Share of the excitation which makes an input the main drive."""


def of_rhythm(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Of a population that fires."""
    part, s, h = seen.program.populations[k], seen.populations[k], seen.program.resolution
    active = int((s.spikes > 0).sum())
    if active < CROWD or not s.bins.size or not s.bins.any():
        return
    back = _comes_back(wiring, k)
    found = next(filter(None, (_volleys(s.bins, active, round(ms / (seen.bin * h))) for ms in WIDTHS_MS)), None)
    if found is None or not back:
        yield from _alternates(seen, k, back)
        return
    if is_copied(seen, k) or not wiring.excites_itself(k):
        return  # equal inputs make equal spikes, and inhibition may well pace a population
    cell, loops = wiring.cell(k), wiring.loops(k)
    back_by = sum(wiring.pushes(q)[0] for q in loops) / part.size
    if cell is not None and back_by * max(map(cell.slope, range(cell.model.receptors))) < LOOP * cell.distance:
        return
    begins, share, width = found
    # Spikes that are listed, as those of a recording, may well come in volleys by themselves, and rates may vary.
    heard = [j for j, p in enumerate(seen.program.populations) if p.kind != "neuron" and k in wiring.reached([j])]
    if width > 2 and any(seen.varies(j) for j in heard):
        return
    listed = any(seen.program.populations[j].kind == "listed" and seen.populations[j].spikes.any() for j in heard)
    period, lasts = float(np.median(np.diff(begins))) * seen.bin * h, width * seen.bin * h
    volleys = f"{begins.size} volleys of more than half of {active:,} neurons within {lasts:g} ms"
    evidence = f"{share:.0%} of its spikes fall into {volleys}, {period:.3g} ms apart"
    names = wiring.names(loops)
    spread = "spread its delays (`delay: {uniform: ...}`)"
    remedy = f"lower `weight` of {names}, {spread}, or give each neuron noise of its own"
    severity = "warning" if listed else "fault"
    yield finding("synchrony", severity, part, evidence, remedy, part.name)


def _volleys(bins: Ints, active: int, width: int) -> tuple[Ints, float, int] | None:
    """Where volleys within some bins begin, the share of spikes in them, and the bins; None if there are too few."""
    if width < 1 or bins.size < 5 * width:
        return None
    window = np.ones(width, dtype=np.int64)
    crowded = np.convolve(bins, window, "valid") >= VOLLEY * active
    inside = np.convolve(crowded, window) > 0
    begins, share = np.flatnonzero(np.diff(inside.astype(np.int8), prepend=0) == 1), bins[inside].sum() / bins.sum()
    synchronous = begins.size >= 5 and share >= IN_VOLLEYS and share - inside.mean() >= MORE
    return (begins, float(share), width) if synchronous else None


def _comes_back(wiring: Wiring, k: int) -> bool:
    """Whether spikes of a population have any effect on it."""
    return any(wiring.program.projections[q].source in wiring.reached([k], excite=False) for q in wiring.onto(k))


def _alternates(seen: Observation, k: int, back: bool) -> Iterator[Finding]:
    """A rhythm of a few steps of neurons that hear each other, which another resolution would not have."""
    part, s, h = seen.program.populations[k], seen.populations[k], seen.program.resolution
    if not back or s.ids.size < CROWD or is_copied(seen, k) or seen.steps < 100:
        return
    steps = s.bins if seen.bin == 1 else np.bincount(s.steps, minlength=seen.steps + 1)[1:]
    if steps.mean() == 0.0 or steps.var() < COLLECTIVE * steps.mean():
        return
    power = np.abs(np.fft.rfft(steps - steps.mean())) ** 2
    per_step = np.fft.rfftfreq(steps.size)
    fast = per_step >= 1.0 / FEW_STEPS
    if power[fast].sum() > FAST * power.sum():
        period = 1.0 / per_step[int(power.argmax())]
        evidence = (
            f"its spikes come every {period:.2g} steps of {h:g} ms: {power[fast].sum() / power.sum():.0%} of the "
            f"variance of their number, which is {steps.var() / steps.mean():.2g} times that of independent neurons"
        )
        remedy = f"use a finer `resolution`, as {h / 10.0:g} ms, with delays of many steps, drawn for each synapse"
        yield fault("step-oscillation", part, evidence, remedy, part.name)


def shared(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Noise of a single generator neuron that all neurons of a population hear."""
    program, per_step, target = seen.program, seen.per_step(), seen.program.populations[k]
    up = {q: per_step[program.projections[q].source] * wiring.pushes(q)[0] for q in wiring.onto(k)}
    for q, excitation in up.items():
        source = program.populations[program.projections[q].source]
        alone = source.kind == "poisson" and source.size == 1 and wiring.weights[q].synapses >= target.size >= CROWD
        if alone and source.largest("rate") >= NOISE_HZ and excitation > MAIN * sum(up.values()):
            evidence = (
                f"all its {some(target.size, 'neuron')} hear the same spikes of the one neuron of '{source.name}', "
                f"{excitation / sum(up.values()):.0%} of their excitation"
            )
            remedy = (
                f"give '{source.name}' `shape: {target.size}`, and connect it one_to_one: a neuron for each target "
                "(NEST's poisson_generator sends each target a train of its own, a neuron here sends one train)"
            )
            yield warning("shared-input", target, evidence, remedy, target.name, source.name)


def is_copied(seen: Observation, k: int) -> bool:
    """Whether all neurons that were followed fired the same spikes, at least three."""
    s = seen.populations[k]
    if s.ids.size < 2 or s.steps.size < 3 * s.ids.size or s.steps.size % s.ids.size:
        return False
    if np.any(np.diff(s.spikes[s.ids])):
        return False  # they fire in the same steps, not equally often
    trains = np.sort(s.steps * s.ids.size + s.rows).reshape(-1, s.ids.size)
    return bool(
        (trains % s.ids.size == np.arange(s.ids.size)).all()
        and (trains // s.ids.size == trains[:, :1] // s.ids.size).all()
    )
