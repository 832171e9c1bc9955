"""What a short run shows of learning: weights that do not move, that are lost at a bound, that move one way only."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro.apps import some
from neuro.extend import Projection
from neuro_doctor.findings import Finding, fault, figure, finding, note, warning
from neuro_doctor.observing import Learnt, Observation
from neuro_doctor.parts import LEFT, changes_weights
from neuro_doctor.wiring import Wiring

Flags = NDArray[np.bool_]
AT_BOUND = 0.9
"""Share of weights at one bound which leaves nothing to learn. Additive rules end at both bounds: that is a result."""
NEAR = 0.05
"""Share of the way between the bounds that counts as at a bound: a single pair of spikes may lead away from it."""
AT_ONE = 0.25
"""Share of weights at one bound, of which a third at most began there, which a short run should not bring."""
AT_BOTH, SPREAD, QUICK_MS = 0.3, 2.0, 5000.0
"""Share of weights at either bound, growth of their spread, and the longest run in which this is too fast."""
ONE_WAY = 0.99
"""Share of changes of one sign above which a rule only grows or only shrinks weights."""
SPENT = 0.25
"""Share of the way to the bound that weights have gone by then: a slow common drift is a rule at work."""


def findings(wiring: Wiring, seen: Observation, ran: float, steered: bool) -> Iterator[Finding]:
    """Findings about projections that learn while the network runs.

    Args:
        wiring: of the network.
        seen: the run.
        ran: how long a simulation ran before that asks, in ms; 0 if none does.
        steered: whether it set signals.
    """
    for q, learnt in seen.learning.items():
        part = seen.program.projections[q]
        if not changes_weights(part.synapse):
            continue
        pre, post = (bool(seen.populations[k].spikes.any()) for k in (part.source, part.target))
        if part.signal >= 0 and not steered and seen.program.signals[part.signal].values is None:
            yield _unset(seen, part, ran)
        if part.dopamine >= 0:
            yield from _dopamine(seen, part, learnt)
        if not (pre and post) or seen.unstable:
            continue
        moved = learnt.last != learnt.first
        modulated = part.synapse.modulated or part.synapse.learns == "moves"
        if not moved.any() and not modulated:
            each = "delay" if part.synapse.delays else "weight"
            evidence = f"none of {some(part.size, each)} changed in {seen.ms:g} ms, though both sides fired"
            remedy = "raise its learning rate, check that its time constants (ms) span the times between spikes"
            yield fault("learns-nothing", part, evidence, remedy)
        elif moved.any() and not part.synapse.delays:
            yield from _bounds(part, learnt, seen)


def _unset(seen: Observation, part: Projection, ran: float) -> Finding:
    signal = seen.program.signals[part.signal]
    page = "docs/how-to/reward-in-a-closed-loop.md"
    tau = part.synapse.parameters().get("tau_c")
    soon = "" if tau is None else f", within {3.0 * float(np.max(tau)):g} ms of the spikes that earn it"
    remedy = f"set it while the network runs{soon}: sim.signal('{signal.name}', reward), or give it values; see {page}"
    if ran > 0.0:
        return warning("signal-not-set", part, f"signal '{signal.name}' was never set in {ran:g} ms", remedy)
    return note("signal-not-set", part, f"signal '{signal.name}' stayed at 0: it has no values", remedy)


def _dopamine(seen: Observation, part: Projection, learnt: Learnt) -> Iterator[Finding]:
    releases = seen.program.populations[part.dopamine]
    if part.dopamine in seen.idle - seen.driven:
        return
    if not seen.populations[part.dopamine].spikes.any():
        evidence = f"'{releases.name}', which releases its dopamine, fired 0 spikes in {seen.ms:g} ms: n stayed at 0"
        remedy = f"make '{releases.name}' fire: give it an input, spikes or a rate"
        yield fault("no-dopamine", part, evidence, remedy, releases.name)
        return
    c, n = learnt.eligibility, learnt.modulator
    if not c.size or c.max() == 0.0 or n.max() == 0.0:
        return
    met = float(learnt.together.max() / (c.max() * n.max()))
    if met < LEFT:
        tau = float(np.max(part.synapse.parameters()["tau_c"]))
        gap = abs(int(n.argmax()) - int(c.argmax())) * seen.ms / c.size
        evidence = (
            f"eligibility and dopamine hardly meet: their product reaches {met:.2g} of the product of their peaks, "
            f"which are {gap:.3g} ms apart; tau_c = {tau:g} ms"
        )
        remedy = f"raise tau_c to about {figure(max(gap, 2 * tau))} ms, or release dopamine earlier"
        yield fault("eligibility-dies", part, evidence, remedy)


def _bounds(part: Projection, learnt: Learnt, seen: Observation) -> Iterator[Finding]:
    low, high = (np.broadcast_to(end, learnt.last.shape) for end in part.synapse.bounds())
    w = learnt.last
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return
    slack, moved = NEAR * np.maximum(high - low, 1e-300), w - learnt.first
    top, bottom = w >= high - slack, w <= low + slack
    divided = list(_divided(part, learnt, top, bottom, seen.ms))
    strengthens = float(np.abs(high).mean()) >= float(np.abs(low).mean())  # else weights below 0 inhibit
    for way, at, end, name in ((1.0, top, high, "largest"), (-1.0, bottom, low, "smallest")):
        share, before = float(at.mean()), float((np.abs(learnt.first - end) <= slack).mean())
        gone = float((way * moved).mean()) / max(float(np.abs(end - learnt.first).mean()), 1e-300)
        towards = float((way * moved[moved != 0.0] > 0.0).mean())
        remedy = f"{balanced(part, (way > 0.0) == strengthens)}, or lower the learning rate"
        most = share >= AT_BOUND > before and w.size >= 4
        many = share >= AT_ONE > 3.0 * before and seen.ms <= QUICK_MS and not divided
        if most or (many and gone > SPENT and w.size >= 20):
            near = "at" if bool((w[at] == end[at]).all()) else f"within {NEAR:.0%} of"
            evidence = (
                f"{share:.0%} of {some(w.size, 'weight')} are {near} the {name}, {end.mean():g}, after {seen.ms:g} ms, "
                f"{before:.0%} were before"
            )
            remedy += ", or use a rule whose changes depend on the weight"
            yield finding("weights-at-bounds", "fault" if most else "warning", part, evidence, remedy)
            return
        if w.size >= 20 and gone > SPENT and towards > ONE_WAY:
            evidence = (
                f"{towards:.0%} of {some(int((moved != 0.0).sum()), 'weight')} that changed "
                f"{'grew' if way > 0.0 else 'shrank'}, by {gone:.0%} of the way to the bound in {seen.ms:g} ms"
            )
            yield warning("one-way", part, evidence, remedy)
    yield from divided


def _divided(part: Projection, learnt: Learnt, top: Flags, bottom: Flags, ms: float) -> Iterator[Finding]:
    """Weights that a short run brings to both bounds."""
    w, first = learnt.last, learnt.first
    if w.size < 20 or not (top.any() and bottom.any()) or float((top | bottom).mean()) < AT_BOTH:
        return
    if ms > QUICK_MS or float(w.std()) < SPREAD * float(first.std()) or first.std() == 0.0:
        return
    evidence = (
        f"{bottom.mean():.0%} of {some(w.size, 'weight')} are within {NEAR:.0%} of the smallest and {top.mean():.0%} "
        f"of the largest after {ms:g} ms, and their spread has grown {w.std() / first.std():.2g} times"
    )
    words = {word.rstrip("_") for word in part.synapse.parameters()}
    rate = "lambda" if "lambda" in words else "the learning rate"
    soft = ", or set mu_plus and mu_minus above 0, for soft bounds" if {"mu_plus", "mu_minus"} <= words else ""
    yield warning("weights-at-bounds", part, evidence, f"lower {rate} for slower changes{soft}")


def balanced(part: Projection, grows: bool) -> str:
    """How the parameters of a rule shift it towards depression, of weights that grow, or towards potentiation."""
    words = part.synapse.parameters()
    more, less = ("raise", "lower") if grows else ("lower", "raise")
    for plus, minus in (("A_plus", "A_minus"), ("Aplus", "Aminus")):
        if plus in words and minus in words:
            return f"{more} {minus} or {less} {plus}"
    if "alpha" in words:
        return f"{more} alpha"
    return f"strengthen {'depression' if grows else 'potentiation'}"
