"""Neurons that fire together: volleys of excitation that comes back, rhythms of the step, shared noise, copies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.core.english import some
from neuro.diagnosis.findings import Finding, fault, finding, warning
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.wiring import Wiring
from neuro.program.program import Ints

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


def findings(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
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
