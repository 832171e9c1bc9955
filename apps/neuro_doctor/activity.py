"""Checks of the activity in a short run: silence, missing inputs, high rates, synchrony, equal spikes, dead outputs."""

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
"""Share of the highest possible rate that is a fault: for any population, and for a population that excites itself.

At CEILING a neuron (tau_m 10 ms, t_ref 2 ms) gets 13 times the input that makes it fire, and twice this input raises
its rate by only a tenth. No cortical rhythm comes near RUNAWAY.
"""
ALONE = 0.5
"""Least share of a rate that a constant current must cause alone to be reported as the cause."""
SLOW_HZ = 50.0
"""Least rate that is reported as a ceiling, Hz: neurons with a long t_ref may answer once to each of several inputs."""
DEAD = 0.25
"""Least share of silent neurons of an output that is reported. Weights drawn around 0 do not excite some neurons."""


def findings(wiring: Wiring, run: Observation) -> Iterator[Finding]:
    """Yield findings about the activity in a run."""
    if run.unstable:
        evidence = f"{run.unstable}, on {run.program.resolution:g} ms steps"
        remedy = f"use a finer `resolution`, as {run.program.resolution / 4.0:g} ms, or smaller weights and currents"
        yield fault("unstable", run.program, evidence, remedy)
        return
    yield from _inputs(wiring, run)
    deciding = {
        g.population for g in run.program.groups if getattr(g.choice, "first_to_fire", False) or g.choice.several
    }
    silence, driven = Silence(wiring, run), wiring.reached(run.driven)
    for k, part in enumerate(run.program.populations):
        if part.kind != "neuron" or run.steps == 0:
            continue
        if not run.populations[k].spikes.any():
            results = silence.findings(k)
        elif k not in deciding:  # deciding populations stop firing at the decision
            results = chain(_firing(wiring, run, k), silence.falls(k))
        else:
            continue
        # Artificial input of --drive proves no fault.
        yield from map(_downgrade, results) if k in driven else results


def _downgrade(problem: Finding) -> Finding:
    if problem.name == "dead-outputs":  # an output need not answer to noise
        return replace(problem, severity="note")
    return replace(problem, severity="warning") if problem.severity == "fault" else problem


def _firing(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield findings about a population that fires."""
    yield from list(_fast(wiring, run, k)) or synchrony_findings(wiring, run, k)
    yield from list(shared_noise_findings(wiring, run, k)) or _copies(wiring, run, k)
    yield from _dead(wiring, run, k)


def _inputs(wiring: Wiring, run: Observation) -> Iterator[Finding]:
    """Yield findings about generators with projections that emitted nothing or only briefly."""
    program, h = run.program, run.program.resolution
    for k, part in enumerate(program.populations):
        if part.kind in ("neuron", "current"):
            continue
        connected = bool(wiring.out_of(k))
        if k in run.idle - run.driven and connected:
            problem, word = ("lists no spikes", "spike_times") if part.kind == "listed" else ("has rate 0", "rate")
            remedy = f"feed it from a program, or set its {word}; `neuro doctor --drive 20Hz` tries Poisson spikes"
            yield note("no-input", part, f"no input was given: it {problem}", remedy)
        elif connected and run.is_brief(k):
            evidence = (
                f"it is on from {part.start * h:g} to {part.stop * h:g} ms only, {(part.stop - part.start) * h:g} of "
                f"{run.ms:g} ms, and emitted {run.populations[k].spikes.mean():.2g} spikes a neuron"
            )
            yield warning("brief-input", part, evidence, "check `stop`: its unit is ms; write `stop: 1 s` for seconds")
        elif k not in run.idle and not run.populations[k].spikes.any() and connected and part.stop > part.start:
            first = part.spike_steps.min(initial=2**62) if part.kind == "listed" and part.stream is None else part.start
            if first >= run.steps:
                evidence = f"its first spikes come at {first * h:g} ms, after the run of {run.ms:g} ms"
                yield warning("late-input", part, evidence, "run longer (`--for`), or check its times: they are in ms")
            else:
                evidence = f"it emitted no spike in {run.ms:g} ms"
                yield note("late-input", part, evidence, "raise its rate, or run longer")


def ceiling_hz(part: Population, h: float) -> float:
    """Return the highest rate of a neuron: one spike per refractory period plus a step, Hz."""
    refractory = part.parameters.get("t_ref", part.parameters.get("dead_time", np.zeros(1)))
    return 1000.0 / (round(float(refractory.min()) / h) * h + h)


def _fast(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield a finding about a rate near the highest possible rate, with its cause."""
    part = run.program.populations[k]
    if not isinstance(part.model, Neuron) or part.model.relay or part.model.chip or part.model.most:
        return
    if part.model.graded:
        return  # graded neurons may send a message in each step on purpose
    if float(np.max(part.parameters.get("max_spikes", 1.0))) > 1.0:
        return  # these neurons emit several spikes per step on purpose
    rate, limit = run.rate(k), min(ceiling_hz(part, run.program.resolution), FAST_HZ)
    feedback = wiring.excites_itself(k)
    if rate < max((RUNAWAY if feedback else CEILING) * limit, SLOW_HZ):
        return
    rate_text = f"the mean rate of {some(part.size, 'neuron')} is {rate:.3g} Hz"
    h = run.program.resolution
    limit_text = "t_ref allows" if limit < min(999.0 / h, FAST_HZ) else f"one spike in each step of {h:g} ms allows"
    limit_text = "no neuron exceeds" if limit == FAST_HZ < 999.0 / h else limit_text
    evidence = f"{rate_text}, {rate / limit:.0%} of the {limit:,.0f} Hz that {limit_text}"
    if current_finding := _alone(wiring, k, rate):
        yield fault("ceiling", part, f"{evidence}; {current_finding[0]}", current_finding[1], part.name)
    elif feedback:
        names = wiring.names(wiring.loops(k))
        remedy = f"lower `weight` of {names}, or strengthen the inhibition onto it"
        yield fault("runaway", part, f"{evidence}; it excites itself through {names}", remedy, part.name)
    else:
        remedy = f"lower the weights or rates of {_strongest(wiring, run, k)}{_reduction(wiring, run, k)}"
        yield fault("ceiling", part, evidence, remedy, part.name)


def _alone(wiring: Wiring, k: int, rate: float) -> tuple[str, str] | None:
    """Return evidence and remedy if constant currents alone cause at least half of a population's rate, else None."""
    part, cell, current = wiring.program.populations[k], wiring.cell(k), wiring.current(k)
    if cell is None:
        return None
    i_e = float(part.parameters.get("I_e", np.zeros(1)).mean())
    v, fires = cell.follow(np.zeros(1), current=current + i_e - cell.parameters.get("I_e", 0.0))
    interval = v.size * cell.h + cell.parameters.get("t_ref", 0.0)
    if not fires or 1000.0 / interval < ALONE * rate:
        return None
    evidence = f"without incoming spikes it fires every {interval:.3g} ms"
    if cell.distance <= 0.0:
        return f"{evidence}, as E_L is not below V_th", "lower E_L, or raise V_th"
    if current > i_e:
        names = wiring.names(wiring.onto(k, "current"))
        remedy = f"lower `weight` of {names}, or the amplitude of its generator"
        return f"{evidence}, by {current:g} pA of {names}", remedy
    return f"{evidence}, by I_e = {i_e:g} pA{rheobase(part)}", f"lower I_e of '{part.name}'"


def _strongest(wiring: Wiring, run: Observation, k: int) -> str:
    """Return the names of the projections with at least a fifth of a population's excitation."""
    per_step = run.per_step()
    up = {q: per_step[wiring.program.projections[q].source] * wiring.pushes(q)[0] for q in wiring.onto(k)}
    return wiring.names(q for q, current in up.items() if current >= 0.2 * sum(up.values())) or "its inputs"


def _reduction(wiring: Wiring, run: Observation, k: int) -> str:
    """Return the factor that lowers the mean input to the threshold, e.g. " to about 1/4"; "" below 1.5 times."""
    cell = wiring.cell(k)
    if cell is None or cell.distance <= 0.0:
        return ""
    x = wiring.drive(k, run.per_step())
    pull = sum(x[r] * cell.slope(r) for r in range(min(x.size, cell.model.receptors)))
    # The effect of a spike lasts about a membrane time constant.
    tau = cell.parameters.get("tau_m", 10.0)
    mean = pull * min(tau, 1000.0) / cell.h
    return f" to about 1/{figure(mean / cell.distance)}" if mean > 1.5 * cell.distance else ""


def _copies(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield a finding if all sampled neurons of a population fired the same spikes."""
    if not is_copied(run, k):
        return
    part, s = run.program.populations[k], run.populations[k]
    # A signal has a value per neuron, so it may teach neurons with equal spikes differently.
    learns = [p.name for p in run.program.projections if p.target == k and changes_weights(p.synapse) and p.signal < 0]
    n = s.steps.size // s.ids.size
    evidence = f"{some(s.ids.size, 'neuron')} in the sample fired the same {some(n, 'spike')} in the same steps"
    remedy = "draw the weights onto them, connect them at random, or let `initial` differ"
    if learns:
        evidence += f", so '{learns[0]}' teaches all of them alike"
    yield finding("neurons-alike", "warning" if learns else "note", part, evidence, remedy, part.name)


def _dead(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield a finding about neurons of an output that stay silent while the others fire, beyond chance."""
    part, spikes = run.program.populations[k], run.populations[k].spikes
    if not is_end(wiring, k) or spikes.all() or part.size < 2:
        return
    inputs = wiring.inputs_of_each(k)  # neurons without inputs have the finding "unreached"
    dead = np.flatnonzero((spikes == 0) & (True if inputs is None else inputs > 0))
    silent = dead.size
    mean_spikes = float(spikes[spikes > 0].mean())
    if mean_spikes < 10.0 or silent < DEAD * part.size:  # at 10 expected spikes, P(no spike) = 1 / 20,000
        return
    evidence = f"{silent:,} of {some(part.size, 'neuron')} never fired, the others {mean_spikes:.3g} times each"
    ids, fire = ", ".join(map(str, dead[:5])), spikes > 0
    remedy = f"look at the inputs of neurons {ids}: raise their weights, or draw them with less spread"
    for word, v in part.parameters.items():
        if v.size > 1 and (v[dead].max() < v[fire].min() or v[dead].min() > v[fire].max()):
            evidence += f"; their mean {word} is {v[dead].mean():.4g}, the mean of the others {v[fire].mean():.4g}"
            remedy = f"set {word} of neurons {ids} to the value of the others"
    # With inhibition, some neurons may lose the competition before they learn.
    excited = not any(wiring.pushes(q)[1] for q in wiring.onto(k))
    severity = "fault" if excited and 2 * silent >= part.size else "warning"
    yield finding("dead-outputs", severity, part, evidence, remedy, part.name)


NEARLY = 0.9
"""Share of the distance to the threshold above which a longer run or another seed may bring spikes."""
SHORT_MS = 100.0
"""Shortest run in which silence is a fault, ms: at 10 Hz a spike comes every 100 ms."""
EARLY, FADED, KEPT = 10, 0.02, 0.5
"""Limits of "falls-silent". EARLY: least number of spikes in the first third of the run. FADED: largest number in the
last third, as a share of the first. KEPT: the same share for each input, at least. If 10 spikes are expected, the
probability of no spike is 1 in 20,000."""
WITHERED, WITHERED_HZ = 0.2, 1.0
"""Limits in place of FADED if learning weakened the inputs: largest share and largest rate, Hz, of spikes in the last
third. Some spikes may remain there, since learning continues."""
DEPLETED, SHRUNK = 0.5, 0.75
"""Silence is explained if less than this share remains of a synapse under short-term depression (DEPLETED), or of the
mean weight after learning (SHRUNK)."""


class Silence:
    """Checks of populations that are silent, or fall silent.

    Args:
        wiring: wiring of the network.
        run: record of the run.
    """

    def __init__(self, wiring: Wiring, run: Observation) -> None:
        self.wiring, self.run, self.program = wiring, run, run.program
        self.silent = {k for k, s in enumerate(run.populations) if not s.spikes.any()}
        self.receiving = {
            part.target
            for q, part in enumerate(self.program.projections)
            if part.carries == "current"
            or (part.source not in self.silent and wiring.may_excite(q) and part.delay_span[0] < run.steps)
        }
        brief = {k for k in range(len(run.populations)) if run.is_brief(k)}
        self.waiting = wiring.reached((run.idle - run.driven) | brief)

    def falls(self, k: int) -> Iterator[Finding]:
        """Yield a finding if a population fires at first and falls silent although its inputs continue."""
        part, (n_first, n_last), reached = self.program.populations[k], self._thirds(k), self.wiring.reached([k])
        edges = [q for q in self.wiring.onto(k) if self.wiring.may_excite(q)]
        inputs = [self._thirds(j) for j in {self.program.projections[q].source for q in edges} - reached]
        if self.run.ms < SHORT_MS or n_first < EARLY or self.wiring.onto(k, "current"):
            return
        if not inputs or any(n_end < KEPT * n_begin or not n_end for n_begin, n_end in inputs):
            return
        learning = {q: self.run.learning[q] for q in edges if q in self.run.learning}
        shrunk = [q for q, w in learning.items() if np.abs(w.last).mean() < SHRUNK * np.abs(w.first).mean()]
        slow = bool(shrunk) and 3000.0 * n_last < WITHERED_HZ * part.size * self.run.ms
        if n_last > (WITHERED if slow else FADED) * n_first:
            return
        evidence = (
            f"{some(n_first, 'spike')} in the first third of the run, {n_last} in the last, though its inputs continued"
        )
        inhibit, severity = [q for q in self.wiring.onto(k) if self.wiring.pushes(q)[1]], "fault"
        cause, remedy = self._long_refractory(part) or self._depleted(edges)
        if shrunk:
            begin, end = learning[shrunk[0]].first.mean(), learning[shrunk[0]].last.mean()
            cause = f": learning brought the mean weight of {self.wiring.names(shrunk)} from {begin:.3g} to {end:.3g}"
            remedy = f"{balanced(self.program.projections[shrunk[0]], grows=False)}, or lower the learning rate"
        elif inhibit and not cause:
            # Inhibition that the population itself causes only ends a transient, so it is not reported.
            if not n_last and not reached & {self.program.projections[q].source for q in inhibit}:
                yield self._inhibited(k, "falls-silent", evidence, inhibit)
            return
        elif not cause:
            remedy = f"raise `weight` of {self.wiring.names(edges)}: initial states made it fire at first, or it adapts"
            severity = "fault" if is_end(self.wiring, k) else "warning"
        yield finding("falls-silent", severity, part, evidence + cause, remedy, part.name)

    def _thirds(self, k: int) -> tuple[int, int]:
        """Return the spikes of a population in the first and in the last third of the run."""
        course, third = self.run.course[:, k], max(1, len(self.run.course) // 3)
        return int(course[:third].sum()), int(course[-third:].sum())

    def _long_refractory(self, part: Population) -> tuple[str, str] | None:
        """Return evidence and remedy if t_ref is at least a third of the run, else None."""
        t_ref = float(part.parameters.get("t_ref", np.zeros(1)).min())
        return (f"; t_ref is {t_ref:g} ms", f"lower t_ref of '{part.name}'") if 3.0 * t_ref >= self.run.ms else None

    def _depleted(self, inputs: list[int]) -> tuple[str, str]:
        """Return evidence and remedy for the first projection with strong short-term depression; empty if none."""
        for q in inputs:
            part, rate = self.program.projections[q], self.run.per_step()
            rested, remaining = (self.wiring.efficacy(q, per_step) for per_step in (1e-9, rate[part.source]))
            if remaining < DEPLETED * rested:
                names = [word for word in ("U", "tau_rec") if word in part.synapse.parameters()]
                evidence = (
                    f"; short-term depression leaves {remaining:.2g} of the weights of '{part.name}' at the "
                    f"{self.run.rate(part.source):.3g} Hz of its source, where a rested synapse sends {rested:.2g}"
                )
                return evidence, f"lower {' or '.join(names) or 'the depression'} of '{part.name}'"
        return "", ""

    def _inhibited(self, k: int, name: str, evidence: str, inhibit: list[int]) -> Finding:
        """Return a finding about a population that some inhibitory projections silence."""
        sources = {self.program.projections[q].source for q in inhibit}
        inhibited = {self.program.projections[q].target for q in self.wiring.out_of(k) if self.wiring.pushes(q)[1]}
        # Of populations that inhibit each other, one may lose the competition.
        severity, part = "note" if sources & inhibited else "warning", self.program.populations[k]
        remedy = f"lower the inhibition of {self.wiring.names(inhibit)}, or raise its excitation"
        return finding(name, severity, part, evidence, remedy, part.name)

    def findings(self, k: int) -> Iterator[Finding]:
        """Yield a finding about a silent population, unless its inputs are silent or missing."""
        part, cell = self.program.populations[k], self.wiring.cell(k)
        # A population without a `Cell` cannot be simulated alone, so only its inputs are checked.
        fires_alone = can_fire_alone(self.wiring, k) if cell is not None else not self.wiring.onto(k)
        if k in self.waiting or not (k in self.receiving or fires_alone):
            return
        v = self.run.populations[k].potentials
        evidence = f"0 of {some(part.size, 'neuron')} fired in {self.run.ms:g} ms{self._silenced(k)}"
        if cell is None or not v.size:
            yield self._silent(k, part, evidence, "")
            return
        top = float(v.max())
        evidence += f"; the largest V_m was {top:.4g} mV, V_th is {cell.threshold:g} mV"
        per_step, current = self.run.per_step(), self.wiring.current(k)
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
        result = self._silent(k, part, evidence, times)
        nearly = top - cell.rest > NEARLY * cell.distance and result.severity == "fault"
        yield replace(result, severity="warning") if nearly else result

    def _silent(self, k: int, part: Population, evidence: str, times: str) -> Finding:
        """Return the finding "silent"; `times` is the text of the factor for the weights, or ""."""
        # A stimulated output whose states are recorded may stay below its threshold on purpose.
        sources = {self.program.projections[q].source for q in self.wiring.onto(k)}
        stimuli = all(self.program.populations[j].kind == "listed" for j in sources)
        probed = any(p.population == k and p.record not in ("spikes", "rate") for p in self.program.probes)
        severity = "note" if probed and stimuli and not self.wiring.out_of(k) else "fault"
        # Recurrent weights have no effect before the first spike and too much after it, so a change is no remedy.
        active = [q for q in self.wiring.onto(k) if self.program.projections[q].source not in self.silent]
        inputs = [q for q in active if self.wiring.may_excite(q)] + self.wiring.onto(k, "current")
        slow = {j for j in (self.program.projections[q].source for q in inputs) if self.run.rate(j) < WITHERED_HZ}
        upstream = [q for j in sorted(slow) for q in self.wiring.onto(j) if self.wiring.may_excite(q)]
        depleted, rested = self._depleted(inputs + upstream)
        rates = "" if depleted else ", or the rate of its inputs"  # higher rates deplete synapses more
        names = f"`weight` of {self.wiring.names(inputs)}{times}{rates}" if inputs else "its I_e"
        sources = {self.program.projections[q].source for q in inputs}
        shows = [p.name for j, p in enumerate(self.program.populations) if j in sources and p.records and j != k]
        negative_current = " or I_e" if inputs and float(part.parameters.get("I_e", np.zeros(1)).max()) < 0.0 else ""
        remedy = f"raise {names}{negative_current}, or lower {'V_th' if 'V_th' in part.parameters else 'its threshold'}"
        if depleted:
            evidence, remedy = evidence + depleted, f"{rested}, or {remedy}"
        severity = "note" if self.run.ms < SHORT_MS else severity
        return finding("silent", severity, part, evidence, remedy, part.name, *shows)

    def _silenced(self, k: int) -> str:
        """Return the part of a message about populations that get no spikes because this one is silent."""
        unreached = (self.wiring.reached([k]) - {k} - self.receiving) & self.silent
        names = ", ".join(f"'{self.program.populations[j].name}'" for j in sorted(unreached)[:5])
        return f", so nothing reaches {names}" if names else ""


def rheobase(part: Population) -> str:
    """Return the rheobase for a message, e.g. ", its rheobase is 375 pA"; "" if unknown."""
    p = {word: float(v[0]) for word, v in part.parameters.items()}
    if not {"tau_m", "C_m", "E_L"} <= p.keys() or not np.isfinite(p["tau_m"]):
        return ""
    return f", its rheobase is {p['C_m'] * (p['V_th'] - p['E_L']) / p['tau_m']:.3g} pA"


CROWD = 10
"""Least number of neurons for findings about synchrony; fewer may be synchronous by chance."""
VOLLEY = 0.5
"""Least share of neurons that fire together in a volley."""
WIDTHS_MS = (1.0, 2.0, 5.0, 10.0, 20.0)
"""Durations of volleys that are searched, ms: 1 with equal delays, longer with spread delays and slow inputs."""
IN_VOLLEYS, MORE = 0.7, 0.3
"""In synchronous activity volleys have at least the share IN_VOLLEYS of the spikes. This share exceeds the volleys'
share of the time by at least MORE. Gamma rhythms of balanced networks have volleys of a few percent of the neurons."""
LOOP = 0.1
"""Least recurrent excitation by one spike of each neuron, as a share of the distance to the threshold. With less,
the rhythm is due to inhibition."""
COLLECTIVE = 3.0
"""Least variance over mean of the spikes per step of synchronous neurons; independent neurons have at most 1."""
FEW_STEPS, FAST = 4, 0.8
"""FEW_STEPS: longest period that is due to the resolution, steps; delay and reset take one step each. FAST: least share
of the variance at such periods."""

NOISE_HZ = 200.0
"""Least rate of a generator neuron that represents the noise of many neurons, not a common stimulus."""
MAIN = 0.5
"""Least share of the excitation that a main input causes."""


def synchrony_findings(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield findings about synchronous volleys and rhythms of a few steps in a population that fires."""
    part, s, h = run.program.populations[k], run.populations[k], run.program.resolution
    active = int((s.spikes > 0).sum())
    if active < CROWD or not s.bins.size or not s.bins.any():
        return
    returns = _comes_back(wiring, k)
    volleys = next(filter(None, (_volleys(s.bins, active, round(ms / (run.bin * h))) for ms in WIDTHS_MS)), None)
    if volleys is None or not returns:
        yield from _alternates(run, k, returns)
        return
    if is_copied(run, k) or not wiring.excites_itself(k):
        return  # equal inputs make equal spikes, and inhibition may make a normal rhythm
    cell, loops = wiring.cell(k), wiring.loops(k)
    back_by = sum(wiring.pushes(q)[0] for q in loops) / part.size
    if cell is not None and back_by * max(map(cell.slope, range(cell.model.receptors))) < LOOP * cell.distance:
        return
    begins, share, width = volleys
    # Listed spikes, e.g. of a recording, may contain volleys, and the rates of inputs may vary.
    sources = [j for j, p in enumerate(run.program.populations) if p.kind != "neuron" and k in wiring.reached([j])]
    if width > 2 and any(run.varies(j) for j in sources):
        return
    listed_input = any(run.program.populations[j].kind == "listed" and run.populations[j].spikes.any() for j in sources)
    period, lasts = float(np.median(np.diff(begins))) * run.bin * h, width * run.bin * h
    text = f"{begins.size} volleys of more than half of {active:,} neurons within {lasts:g} ms"
    evidence = f"{share:.0%} of its spikes fall into {text}, {period:.3g} ms apart"
    names = wiring.names(loops)
    spread = "spread its delays (`delay: {uniform: ...}`)"
    remedy = f"lower `weight` of {names}, {spread}, or give each neuron noise of its own"
    severity = "warning" if listed_input else "fault"
    yield finding("synchrony", severity, part, evidence, remedy, part.name)


def _volleys(bins: Ints, active: int, width: int) -> tuple[Ints, float, int] | None:
    """Find volleys of a width: return the first bins, the share of spikes in volleys, and the width.

    The result is None if the activity is not synchronous.

    Args:
        bins: spikes per bin.
        active: number of neurons that fire.
        width: duration of a volley, bins.
    """
    if width < 1 or bins.size < 5 * width:
        return None
    window = np.ones(width, dtype=np.int64)
    crowded = np.convolve(bins, window, "valid") >= VOLLEY * active
    volley = np.convolve(crowded, window) > 0
    begins, share = np.flatnonzero(np.diff(volley.astype(np.int8), prepend=0) == 1), bins[volley].sum() / bins.sum()
    synchronous = begins.size >= 5 and share >= IN_VOLLEYS and share - volley.mean() >= MORE
    return (begins, float(share), width) if synchronous else None


def _comes_back(wiring: Wiring, k: int) -> bool:
    """Return whether spikes of a population have an effect on it, directly or through other populations."""
    return any(wiring.program.projections[q].source in wiring.reached([k], excite=False) for q in wiring.onto(k))


def _alternates(run: Observation, k: int, returns: bool) -> Iterator[Finding]:
    """Yield a finding about a rhythm of a few steps in a recurrent population, which is due to the resolution."""
    part, s, h = run.program.populations[k], run.populations[k], run.program.resolution
    if not returns or s.ids.size < CROWD or is_copied(run, k) or run.steps < 100:
        return
    steps = s.bins if run.bin == 1 else np.bincount(s.steps, minlength=run.steps + 1)[1:]
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


def shared_noise_findings(wiring: Wiring, run: Observation, k: int) -> Iterator[Finding]:
    """Yield a finding if all neurons of a population get the noise of a single generator neuron."""
    program, per_step, target = run.program, run.per_step(), run.program.populations[k]
    up = {q: per_step[program.projections[q].source] * wiring.pushes(q)[0] for q in wiring.onto(k)}
    for q, excitation in up.items():
        source = program.populations[program.projections[q].source]
        single = source.kind == "poisson" and source.size == 1 and wiring.weights[q].synapses >= target.size >= CROWD
        if single and source.largest("rate") >= NOISE_HZ and excitation > MAIN * sum(up.values()):
            evidence = (
                f"all its {some(target.size, 'neuron')} receive the spikes of the only neuron of '{source.name}', "
                f"{excitation / sum(up.values()):.0%} of their excitation"
            )
            remedy = (
                f"give '{source.name}' `shape: {target.size}`, and connect it one_to_one: a neuron for each target "
                "(NEST's poisson_generator sends each target a train of its own, a neuron here sends one train)"
            )
            yield warning("shared-input", target, evidence, remedy, target.name, source.name)


def is_copied(run: Observation, k: int) -> bool:
    """Return whether all sampled neurons fired the same spikes, at least three each."""
    s = run.populations[k]
    if s.ids.size < 2 or s.steps.size < 3 * s.ids.size or s.steps.size % s.ids.size:
        return False
    if np.any(np.diff(s.spikes[s.ids])):
        return False  # the neurons fired different numbers of spikes
    trains = np.sort(s.steps * s.ids.size + s.rows).reshape(-1, s.ids.size)
    return bool(
        (trains % s.ids.size == np.arange(s.ids.size)).all()
        and (trains // s.ids.size == trains[:, :1] // s.ids.size).all()
    )
