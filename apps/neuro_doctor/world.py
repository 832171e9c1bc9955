"""Findings from a short closed loop with the network's world: rewards that are constant, late, or one-sided."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import neuro
from neuro import ModelError, Network
from neuro.apps import some
from neuro.extend import Program
from neuro_doctor.findings import Finding, fault, figure, warning
from neuro_doctor.learning import ONE_WAY
from neuro_doctor.parts import LEFT

STEPS = 300
"""Control steps of the loop."""


def resolves(net: Network, finding: Finding) -> bool:
    """Return whether a network's world supplies the missing input or signal of a finding from a run without a world."""
    world = net.world_section
    if world is None:
        return False
    if finding.name == "no-input":
        return finding.what in {f"population '{name}'" for name in world.observe}
    set_by_world = (f"signal '{name}'" in finding.evidence for name in world.reward or ())
    return finding.name == "signal-not-set" and any(set_by_world)


def findings(net: Network, backend: str, seed: int) -> Iterator[Finding]:
    """Run a network in its world for a short time with learning on, and check the rewards.

    Args:
        net: the network. Without a world with rewards there are no findings.
        backend: backend of the run.
        seed: seed of everything random.
    """
    world = net.world_section
    if world is None or not world.reward:
        return
    try:
        loop = neuro.closed_loop(net, backend=backend, seed=seed, block=2 * STEPS, record=True)
        initial, infos = dict(loop.pilot.weights), list[dict[str, object]]()  # type: ignore[attr-defined]  # a network
        loop.watch = lambda: infos.append(dict(loop.environments.infos[0]))
        loop.run(steps=STEPS + world.explore)
    except ModelError as error:
        message = f"the network did not run in it: {error.message}"
        yield Finding("world-not-run", "note", "the world", net.world_origin, message, error.hint or "mend this first")
        return
    program: Program = loop.sim.program
    for name, teacher in world.reward.items():
        if teacher.name not in ("reward", "info"):
            continue
        values = np.array([info[teacher.key] for info in infos]) if teacher.name == "info" else np.array(loop.rewards)
        signal = next(part for part in program.signals if part.name == name)
        if np.ptp(values) == 0.0:
            evidence = f"the reward was {np.ravel(values)[0]:g} in each of {len(values):,} control steps"
            yield warning("reward-constant", signal, evidence, "reward other actions, or raise the setting explore")
            continue
        times = np.flatnonzero(np.any(values.reshape(len(values), -1) != 0.0, axis=1))
        delay = world.step * float(np.median(np.diff(times))) if len(times) > 1 else world.step
        for part in program.projections:
            tau = part.synapse.parameters().get("tau_c")
            if part.signal < 0 or program.signals[part.signal] is not signal or tau is None:
                continue
            remains = float(np.exp(-delay / np.max(tau)))
            if remains < LEFT:
                evidence = f"a reward comes {delay:g} ms after an action, when {remains:.1g} of its eligibility is left"
                yield fault("eligibility-dies", part, evidence, f"raise tau_c to about {figure(delay)} ms")
            changes = loop.sim.get(part.name, "weight") - initial[part.name]
            changes = changes[changes != 0.0]
            if changes.size >= 20 and max((changes > 0.0).mean(), (changes < 0.0).mean()) >= ONE_WAY:
                direction, rate = ("fell", "A_minus") if changes.mean() < 0.0 else ("grew", "A_plus")
                span = f"{np.min(values):g} to {np.max(values):g}"
                evidence = f"all of {some(changes.size, 'weight')} that changed {direction}, though rewards were {span}"
                remedy = f"lower {rate}, or subtract the expected reward by the setting less"
                yield warning("one-way", part, evidence, remedy)
