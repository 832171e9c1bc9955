"""Findings about learning in a short run: weights that do not change, end at a bound, or change in one direction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro.apps import some
from neuro.extend import Projection
from neuro_doctor.findings import Finding, fault, figure, finding, note, warning
from neuro_doctor.observing import LearningRecord, Observation
from neuro_doctor.parts import LEFT, changes_weights
from neuro_doctor.wiring import Wiring

Flags = NDArray[np.bool_]
AT_BOUND = 0.9
"""Share of weights at one bound that is a fault. Weights at both bounds are the normal result of additive rules."""
NEAR = 0.05
"""Distance from a bound that counts as at the bound, as a share of the distance between both bounds."""
AT_ONE = 0.25
"""Share of weights at one bound after a short run that is a warning, if less than a third of this share began there."""
AT_BOTH, SPREAD, QUICK_MS = 0.3, 2.0, 5000.0
"""Limits of the finding that weights divide between the bounds too fast: least share of weights at the bounds, least
growth of their standard deviation, longest run in ms."""
ONE_WAY = 0.99
"""Share of changes of one sign above which a rule counts as one-way."""
SPENT = 0.25
"""Mean change above which one-way changes are reported, as a share of the way to the bound; slow drift is normal."""


def findings(wiring: Wiring, run: Observation, ran: float, steered: bool) -> Iterator[Finding]:
    """Yield findings about projections that learn during a run.

    Args:
        wiring: wiring of the network.
        run: record of the run.
        ran: time that the user's simulation ran before the diagnosis, ms; 0 for a network.
        steered: True if the user's simulation set signals.
    """
    for q, record in run.learning.items():
        part = run.program.projections[q]
        if not changes_weights(part.synapse):
            continue
        pre, post = (bool(run.populations[k].spikes.any()) for k in (part.source, part.target))
        if part.signal >= 0 and not steered and run.program.signals[part.signal].values is None:
            yield _unset_signal(run, part, ran)
        if part.dopamine >= 0:
            yield from _dopamine(run, part, record)
        if not (pre and post) or run.unstable:
            continue
        changed = record.last != record.first
        modulated = part.synapse.modulated or part.synapse.learns == "moves"
        if not changed.any() and not modulated:
            value = "delay" if part.synapse.delays else "weight"
            evidence = f"none of {some(part.size, value)} changed in {run.ms:g} ms, though both sides fired"
            remedy = "raise its learning rate, check that its time constants (ms) span the times between spikes"
            yield fault("learns-nothing", part, evidence, remedy)
        elif changed.any() and not part.synapse.delays:
            yield from _bounds(part, record, run)


def _unset_signal(run: Observation, part: Projection, ran: float) -> Finding:
    signal = run.program.signals[part.signal]
    page = "docs/how-to/reward-in-a-closed-loop.md"
    tau = part.synapse.parameters().get("tau_c")
    soon = "" if tau is None else f", within {3.0 * float(np.max(tau)):g} ms of the spikes that earn it"
    remedy = f"set it while the network runs{soon}: sim.signal('{signal.name}', reward), or give it values; see {page}"
    if ran > 0.0:
        return warning("signal-not-set", part, f"signal '{signal.name}' was never set in {ran:g} ms", remedy)
    return note("signal-not-set", part, f"signal '{signal.name}' stayed at 0: it has no values", remedy)


def _dopamine(run: Observation, part: Projection, record: LearningRecord) -> Iterator[Finding]:
    source = run.program.populations[part.dopamine]
    if part.dopamine in run.idle - run.driven:
        return
    if not run.populations[part.dopamine].spikes.any():
        evidence = f"'{source.name}', which releases its dopamine, fired 0 spikes in {run.ms:g} ms: n stayed at 0"
        remedy = f"make '{source.name}' fire: give it an input, spikes or a rate"
        yield fault("no-dopamine", part, evidence, remedy, source.name)
        return
    c, n = record.eligibility, record.modulator
    if not c.size or c.max() == 0.0 or n.max() == 0.0:
        return
    overlap = float(record.product.max() / (c.max() * n.max()))
    if overlap < LEFT:
        tau = float(np.max(part.synapse.parameters()["tau_c"]))
        gap = abs(int(n.argmax()) - int(c.argmax())) * run.ms / c.size
        evidence = (
            f"eligibility and dopamine hardly meet: their product reaches {overlap:.2g} of the product of their peaks, "
            f"which are {gap:.3g} ms apart; tau_c = {tau:g} ms"
        )
        remedy = f"raise tau_c to about {figure(max(gap, 2 * tau))} ms, or release dopamine earlier"
        yield fault("eligibility-dies", part, evidence, remedy)


def _bounds(part: Projection, record: LearningRecord, run: Observation) -> Iterator[Finding]:
    """Yield findings about weights that end at a bound, or that change in one direction."""
    low, high = (np.broadcast_to(end, record.last.shape) for end in part.synapse.bounds())
    w = record.last
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return
    slack, change = NEAR * np.maximum(high - low, 1e-300), w - record.first
    top, bottom = w >= high - slack, w <= low + slack
    divided = list(_divided(part, record, top, bottom, run.ms))
    strengthens = float(np.abs(high).mean()) >= float(np.abs(low).mean())  # False for inhibitory weights, below 0
    for sign, at_bound, end, name in ((1.0, top, high, "largest"), (-1.0, bottom, low, "smallest")):
        share, initial_share = float(at_bound.mean()), float((np.abs(record.first - end) <= slack).mean())
        share_of_way = float((sign * change).mean()) / max(float(np.abs(end - record.first).mean()), 1e-300)
        same_sign = float((sign * change[change != 0.0] > 0.0).mean())
        remedy = f"{balanced(part, (sign > 0.0) == strengthens)}, or lower the learning rate"
        is_fault = share >= AT_BOUND > initial_share and w.size >= 4
        is_warning = share >= AT_ONE > 3.0 * initial_share and run.ms <= QUICK_MS and not divided
        if is_fault or (is_warning and share_of_way > SPENT and w.size >= 20):
            near = "at" if bool((w[at_bound] == end[at_bound]).all()) else f"within {NEAR:.0%} of"
            evidence = (
                f"{share:.0%} of {some(w.size, 'weight')} are {near} the {name}, {end.mean():g}, after {run.ms:g} ms, "
                f"{initial_share:.0%} were before"
            )
            remedy += ", or use a rule whose changes depend on the weight"
            yield finding("weights-at-bounds", "fault" if is_fault else "warning", part, evidence, remedy)
            return
        if w.size >= 20 and share_of_way > SPENT and same_sign > ONE_WAY:
            evidence = (
                f"{same_sign:.0%} of {some(int((change != 0.0).sum()), 'weight')} that changed "
                f"{'grew' if sign > 0.0 else 'shrank'}, by {share_of_way:.0%} of the way to the bound in {run.ms:g} ms"
            )
            yield warning("one-way", part, evidence, remedy)
    yield from divided


def _divided(part: Projection, record: LearningRecord, top: Flags, bottom: Flags, ms: float) -> Iterator[Finding]:
    """Yield a finding if a short run divides the weights between both bounds."""
    w, first = record.last, record.first
    if w.size < 20 or not (top.any() and bottom.any()) or float((top | bottom).mean()) < AT_BOTH:
        return
    if ms > QUICK_MS or float(w.std()) < SPREAD * float(first.std()) or first.std() == 0.0:
        return
    evidence = (
        f"{bottom.mean():.0%} of {some(w.size, 'weight')} are within {NEAR:.0%} of the smallest and {top.mean():.0%} "
        f"of the largest after {ms:g} ms, and their spread has grown {w.std() / first.std():.2g} times"
    )
    names = {word.rstrip("_") for word in part.synapse.parameters()}
    rate = "lambda" if "lambda" in names else "the learning rate"
    soft = ", or set mu_plus and mu_minus above 0, for soft bounds" if {"mu_plus", "mu_minus"} <= names else ""
    yield warning("weights-at-bounds", part, evidence, f"lower {rate} for slower changes{soft}")


def balanced(part: Projection, grows: bool) -> str:
    """Return a remedy that shifts a rule towards depression if weights grow, else towards potentiation.

    E.g. "raise A_minus or lower A_plus" for weights that grow.
    """
    parameters = part.synapse.parameters()
    verb, opposite = ("raise", "lower") if grows else ("lower", "raise")
    for plus, minus in (("A_plus", "A_minus"), ("Aplus", "Aminus")):
        if plus in parameters and minus in parameters:
            return f"{verb} {minus} or {opposite} {plus}"
    if "alpha" in parameters:
        return f"{verb} alpha"
    return f"strengthen {'depression' if grows else 'potentiation'}"
