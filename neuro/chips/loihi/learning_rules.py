"""Which rule of the chip's learning engine a projection gets, and which rules a chip or a neuron cannot have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from neuro.chips.description import Chip
from neuro.chips.loihi.learning_fit import COARSE_UPDATE
from neuro.chips.loihi.learning_map import Mapped, rule_of
from neuro.chips.quantising.fixed import FixedProjection
from neuro.chips.quantising.inputs import Options, approximated, refused
from neuro.chips.quantising.learning import LEARN_ELSEWHERE, foreign
from neuro.core.errors import ModelError
from neuro.model.neurons import parrot_neuron
from neuro.model.synapses import loihi_learning
from neuro.program.backend import Problem
from neuro.program.program import Program

FRACTIONS = 256
"""Parts of a step that a tag tells apart: -128 to 127 of them, so that the register is the nearest whole step."""

LARGEST_SIGNAL = 4.0
"""Dopamine that a signal may set, in those of one dopamine spike, 1/tau_n, where the option `signals` says nothing."""


def give_rules(program: Program, chip: Chip, wires: dict[int, FixedProjection], options: Options) -> Iterator[Problem]:
    """Give rules to the projections that learn on the chip; tell what is refused and what is approximated.

    Args:
        program: the whole network.
        chip: for which it is quantised.
        wires: the projections in words, by index; those that learn are replaced.
        options: largest dopamine by projection.
    """
    for index, part in enumerate(program.projections):
        synapse, told = part.synapse, f"projection '{part.name}': {part.synapse.name}"
        if (problem := foreign(program, chip, index) or _no_rule(program, index)) is not None:
            yield problem
        elif isinstance(synapse, loihi_learning) and index in wires:
            wires[index] = replace(wires[index], rule=synapse.rule())
        elif synapse.delays and index in wires:
            yield _delays(program, index)
        elif synapse.learns == "pairs" and index in wires:
            try:
                mapped = _mapped(program, index, wires[index], options)
            except ModelError as error:
                yield refused(part.origin, told, error.message, error.hint)
                continue
            wires[index] = replace(wires[index], rule=mapped.rule, n_scale=mapped.n_scale)
            differs = "".join(f"\n    - {text}" for text in mapped.approximations)
            yield approximated(part.origin, told, f"the chip's learning engine runs it otherwise:{differs}")
            if mapped.update < COARSE_UPDATE:
                why = (
                    f"a change is {mapped.update:.2g} of a weight step: below {COARSE_UPDATE:g} much of it is cut away"
                )
                yield approximated(part.origin, told, why, "learn faster, or lower Wmax, which sets the weight step")


def _delays(program: Program, index: int) -> Problem:
    """What a rule for delays becomes on the chip; a synapse that has other traces than times cannot be there."""
    part = program.projections[index]
    told = f"projection '{part.name}': {part.synapse.name}"
    traces = (*part.synapse.pre, *part.synapse.post) if part.synapse.learns == "pairs" else ()
    if any(trace.tau for trace in traces) or len(traces) > 2:
        return refused(part.origin, told, "of spikes the host knows when the last ones were", LEARN_ELSEWHERE)
    when = "times of spikes, which its learning engine has not" if traces else "the ends of trials"
    kept = f"delays are whole steps in the register and 1/{FRACTIONS} of a step in the tag"
    return approximated(part.origin, told, f"{kept}; the host changes them by {when}")


def _no_rule(program: Program, index: int) -> Problem | None:
    """Why a synapse model cannot be onto these neurons; None if it can."""
    part = program.projections[index]
    synapse, target = part.synapse, program.populations[part.target].model
    told = f"projection '{part.name}': {synapse.name}"
    if isinstance(target, parrot_neuron) and synapse.learns in ("pairs", "chip"):
        why, way = (
            "the host relays the spikes of parrots, so there is no weight to learn",
            "learn at the next projection",
        )
    elif synapse.chip and not target.chip and not isinstance(target, parrot_neuron):
        why, way = f"its weights are mantissas, but {target.name} has mV and pA", "use static or stdp, or a loihi_lif"
    elif words := synapse.of_each():
        why = f"{', '.join(words)} of each synapse: a rule of the chip is one for the whole projection"
        way = "give all synapses one number, split the projection, or run on event"
    elif synapse.learns == "pairs" and target.chip:
        why, way = f"its weights are in mV or pA, but {target.name} has registers", "use loihi_learning"
    else:
        return None
    return refused(part.origin, told, why, way)


def _mapped(program: Program, index: int, wires: FixedProjection, options: Options) -> Mapped:
    """The rule of the learning engine for a projection.

    Raises:
        ModelError: there is none.
    """
    part = program.projections[index]
    told = part.synapse.parameters()
    tau_minus = program.populations[part.target].parameters["tau_minus"]
    if wires.step.size > 1 or tau_minus.size > 1:
        raise ModelError("the target's neurons differ: a rule is one for the whole projection")
    if wires.sign_mode != "excitatory":
        raise ModelError(
            f"weights in sign mode {wires.sign_mode}: expected Wmin >= 0 and weights >= 0",
            hint="set Wmin: 0" if "Wmin" in told else "backend 'event' runs it",
        )
    return rule_of(
        part.synapse,
        program.resolution,
        float(tau_minus[0]),
        float(wires.step[0]),
        wires.bits,
        delay=int(part.delay.max(initial=1)),
        largest_n=float(options.of("signals", part.name) or LARGEST_SIGNAL / told.get("tau_n", 1.0)),
    )
