"""What generators must satisfy, and those that change at listed times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.core.keyed_random import LARGEST_MEAN
from neuro.model.neurons import (
    Generator,
    Model,
    gamma_sup_generator,
    noise_generator,
    poisson_generator,
    sinusoidal_poisson_generator,
)
from neuro.program.program import Floats, Program, Schedule

FINER = "use a finer resolution or a lower rate"


def check_generator(model: Generator, parameters: Mapping[str, Floats], clock: Clock) -> None:
    """What the resolved parameters of a generator must satisfy together.

    Args:
        model: the generator, as described.
        parameters: one value for all neurons or one for each, by word; what is not given is not checked.
        clock: of the network.

    Raises:
        ModelError: the first thing that is wrong.
    """
    if isinstance(model, poisson_generator | sinusoidal_poisson_generator) and "rate" in parameters:
        _check_rate(model, "rate", float(parameters["rate"].max()), clock)
    if isinstance(model, sinusoidal_poisson_generator) and {"rate", "amplitude"} <= set(parameters):
        peak = np.max(parameters["rate"] + np.abs(parameters["amplitude"]))
        _check_rate(model, "rate + amplitude", float(peak), clock)
    if isinstance(model, gamma_sup_generator) and "rate" in parameters:
        _check_gamma(model, float(parameters["rate"].max()), clock)
    if isinstance(model, noise_generator):
        _check_noise(model, parameters, clock)


def _check_rate(model: Model, what: str, rate: float, clock: Clock) -> None:
    limit = LARGEST_MEAN * 1000.0 / clock.resolution
    if rate > limit:
        message = f"{model.name}.{what} = {rate:g} Hz: expected at most {limit:g} Hz, {LARGEST_MEAN:g} spikes a step"
        raise ModelError(message, path=(model.name, *words_of(what)))


def _check_gamma(model: gamma_sup_generator, rate: float, clock: Clock) -> None:
    """The chance to leave a stage is at most 1/2, and so many leave that the chance of none is a double."""
    per_step = model.gamma_shape * clock.resolution / 1000.0
    limit = min(0.5, LARGEST_MEAN / model.n_proc) / per_step
    if rate > limit:
        message = (
            f"{model.name}.rate = {rate:g} Hz: expected at most {limit:g} Hz with gamma_shape = {model.gamma_shape} "
            f"and n_proc = {model.n_proc} at a resolution of {clock.resolution:g} ms"
        )
        raise ModelError(message, hint=FINER, path=(model.name, "rate"), about=("gamma_shape", "n_proc"))


def _check_noise(model: noise_generator, parameters: Mapping[str, Floats], clock: Clock) -> None:
    if clock.step(model.dt, f"{model.name}.dt") < 1:
        message = f"{model.name}.dt = {model.dt:g} ms: expected at least the resolution, {clock.resolution:g} ms"
        raise ModelError(message, path=(model.name, "dt"), kind="resolution")
    if {"std", "std_mod"} <= set(parameters):
        std, std_mod = np.broadcast_arrays(parameters["std"], parameters["std_mod"])
        bad = np.flatnonzero(std_mod > std)
        if bad.size:
            where = f"[{bad[0]}]" if std.size > 1 else ""
            message = f"{model.name}.std_mod{where} = {std_mod[bad[0]]:g} pA: expected at most std = {std[bad[0]]:g} pA"
            hint = "the variance would be negative at times"
            raise ModelError(message, hint=hint, path=(model.name, "std_mod"), about=("std",))


def schedule_of(model: Model, size: int, clock: Clock) -> Schedule | None:
    """The steps at which a generator changes, and its values from each on; None if it does not.

    Args:
        model: of a population.
        size: how many neurons it has.
        clock: of the network.

    Raises:
        ModelError: a time is not on the grid, or the rows are not one for each neuron.
    """
    if not isinstance(model, Generator) or not model.schedule:
        return None
    times, values = (getattr(model, word) for word in model.schedule)
    message = f"{model.name}.{model.schedule[1]}"
    if values.ndim == 2 and len(values) != size:
        message += f" has {len(values)} rows: expected {size}, one for each neuron, or one list for all"
        raise ModelError(message, path=(model.name, model.schedule[1]))
    if model.role == "poisson" and values.size:
        _check_rate(model, model.schedule[1], float(values.max()), clock)
    steps = clock.steps(times, f"{model.name}.{model.schedule[0]}")
    # A row for each moment: whoever runs the network takes one row where it stops.
    rows = np.ascontiguousarray(np.atleast_2d(values).T + 0.0)
    return Schedule(steps, rows)


def check_trains(program: Program) -> None:
    """No two targets share a train that must be individual.

    Raises:
        ModelError: two do; it names the projection by which there is more than one.
    """
    used = {
        k: np.zeros(part.size, dtype=np.int64)
        for k, part in enumerate(program.populations)
        if isinstance(part.model, sinusoidal_poisson_generator) and part.model.individual_spike_trains
    }
    for q, part in enumerate(program.projections):
        if part.source not in used:
            continue
        name, size = program.populations[part.source].name, program.populations[part.source].size
        used[part.source] += np.bincount(program.synapses(q)[0], minlength=size)
        most = int(used[part.source].max(initial=0))
        if most > 1:
            raise ModelError(
                f"projection '{part.name}': a neuron of '{name}' has {most} targets, and individual_spike_trains is "
                "true: expected one target for each",
                where=part.origin,
                hint="give each target a neuron of its own, by one_to_one; or set individual_spike_trains: false, "
                "and all targets of a neuron share its train",
            )
