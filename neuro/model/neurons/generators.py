"""Generators of spikes from lists, rates or codes, and the random numbers that they need."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar, Self

import numpy as np

from neuro.coding.codes import chain
from neuro.coding.encoders import Floats
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, Where, here
from neuro.core.inputs import file_path
from neuro.core.quantities import Value, quantity
from neuro.core.values import FromFile, shown
from neuro.model.neurons.base import Generator, State, Timed

_FILE_WORDS = ("file", "key")


@dataclass(frozen=True, kw_only=True, eq=False)
class poisson_generator(Timed):
    """Generator of a Poisson number of spikes per step, independent for each neuron of the population.

    All targets of a neuron receive the same spike train. Source: NEST 3.10, `poisson_generator` with a parrot per
    neuron.
    """

    equation: ClassVar[str] = "number of spikes in a step ~ Poisson(rate h / 1000)"
    source: ClassVar[str] = "NEST 3.10 poisson_generator"
    role: ClassVar[str] = "poisson"

    rate: Value = quantity(0.0, "Hz", "mean rate", at_least=0, arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class spike_generator(Generator):
    """Generator of listed spikes.

    More spikes can be injected while running. Two spikes at one time make a spike of multiplicity 2.
    """

    equation: ClassVar[str] = "emits at the listed times"
    source: ClassVar[str] = "NEST 3.10 spike_generator"
    role: ClassVar[str] = "listed"

    spike_times: Any = quantity((), "ms", "an ascending list of times per neuron", kind="times")


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class spike_train(Generator):
    """Generator of the spikes of a recording. More spikes can be injected while running.

    Two spikes of a neuron at one time make a spike of multiplicity 2. `file` (and `key`) may replace `spikes`; in YAML
    `spikes: {file: ..., key: ...}` is also accepted. An HDF5 file has under `key` a group with the data sets `times`
    and `ids`, as written by `neuro run --out`, or a data set with these two columns. An NPY file has these columns or
    fields. The first line of a CSV file names the columns.
    """

    equation: ClassVar[str] = "emits at the recorded times"
    source: ClassVar[str] = "NEST 3.10 spike_generator, one per neuron"
    role: ClassVar[str] = "listed"
    file_of: ClassVar[str] = "spikes"

    spikes: Any = quantity(unit="ms", doc="a row per spike, in ascending time: time and neuron", kind="train")

    def __new__(cls, *args: Any, **words: Any) -> Self:
        """Raise an error for an unknown parameter, with the nearest parameter as hint."""
        return super().__new__(cls, *args, **{word: value for word, value in words.items() if word not in _FILE_WORDS})

    def __init__(self, *, spikes: Any = None, file: str | PathLike[str] | None = None, key: str | None = None) -> None:
        if file is None and key is not None:
            raise ModelError("spike_train: found 'key' without 'file': expected both", where=here())
        if (spikes is None) == (file is None):
            words = "neither 'spikes' nor 'file'" if file is None else "both 'spikes' and 'file'"
            raise ModelError(f"spike_train: found {words}: expected one of them", where=here())
        object.__setattr__(self, "spikes", spikes if file is None else self._read(file, key))
        self.__post_init__()

    def _read(self, file: str | PathLike[str], key: str | None) -> Any:
        from neuro.model.language.files import train_of

        try:
            return train_of(file_path(file, "file"), key, here() or Where("Python"))
        except ModelError as error:
            raise error.at(None, "spike_train") from None


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_spike_train(Generator):
    """Generator of listed spikes with payloads. More spikes can be injected while running.

    The payloads of two spikes of a neuron at one time are added.
    """

    equation: ClassVar[str] = "emits payloads at the listed times"
    source: ClassVar[str] = "NEST 3.10 spike_generator with spike_weights; lava 0.10 RingBuffer"
    role: ClassVar[str] = "listed"
    graded: ClassVar[bool] = True

    spikes: Any = quantity(
        (),
        unit="ms",
        doc="a row per spike, in ascending time: time, neuron and payload",
        kind="graded_train",
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class inhomogeneous_poisson_generator(Timed):
    """Generator of a Poisson number of spikes per step, at a rate that changes at listed times.

    Before the first time the rate is 0. A list of rates applies to all neurons. An array of shape [neurons, times] has
    a row per neuron. All targets of a neuron receive the same spike train.
    """

    equation: ClassVar[str] = (
        "number of spikes in a step ~ Poisson(rate h / 1000), "
        "rate = rate_values[k] for rate_times[k] <= t < rate_times[k + 1]"
    )
    source: ClassVar[str] = "NEST 3.10 inhomogeneous_poisson_generator"
    role: ClassVar[str] = "poisson"
    schedule: ClassVar[tuple[str, ...]] = ("rate_times", "rate_values")

    rate_times: Any = quantity(unit="ms", doc="times at which the rate changes", kind="moments")
    rate_values: Any = quantity(unit="Hz", doc="rate from each of these times on", kind="series", at_least=0)


def poisson(u, mean, p_zero):
    """Return a Poisson number from a uniform number `u`.

    `p_zero` is exp(-mean), the probability of 0, and `mean` is at most 500.
    """
    number, term, total = 0, p_zero, p_zero
    while u >= total:
        number += 1
        term = term * (mean / number)
        if total + term == total and number > mean:
            break
        total += term
    return number


def binomial(u, trials, chance):
    """Return a binomial number from a uniform number `u`, and a new uniform number.

    The new number is the position of `u` in the interval of the drawn number, and is independent of the drawn number.
    """
    if trials == 0 or chance == 0.0:
        return 0, u
    if chance >= 1.0:
        return trials, u
    below, odds = 0.0, chance / (1.0 - chance)
    number, term = 0, math.exp(trials * math.log1p(-chance))
    while u >= below + term and number < trials:
        below += term
        term = term * (odds * (trials - number) / (number + 1))
        number += 1
    return number, min(max((u - below) / term, 0.0), 1.0 - 2.0**-53) if term > 0.0 else 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class encode(Generator):
    """Generator of the spikes that a code makes from values.

    While the network runs, the population behaves as a `spike_generator`, or as a `poisson_generator` if the code
    returns rates.

    A spike at time t of the code is emitted in the step of `start` + t, and a spike at t = 0 in the first step after
    `start`. Random codes depend on the network's seed and the population's name. In YAML `{file: ..., key: ...}` may
    replace `values`.
    """

    equation: ClassVar[str] = "spikes = code(values)"
    source: ClassVar[str] = "thesis section 2.3, line 666"
    role: ClassVar[str] = "encoded"
    file_of: ClassVar[str] = "values"

    values: Value = quantity(doc="values to encode", arrays=True)
    code: Any = quantity(
        doc="a code of `neuro.coding`, or a chain of codes, each applied to the output of the one before", kind="codes"
    )
    start: float = quantity(0.0, "ms", "time after which the population emits", at_least=0)
    stop: float = quantity(math.inf, "ms", "time up to which the population emits", at_least=0, infinite=True)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "code", chain(self.code))
        except ModelError as error:
            raise error.at(here(), self.name) from None
        super().__post_init__()
        if isinstance(self.values, Choice):
            message = f"{self.name}.values = {shown(self.values)}: expected numbers"
            raise ModelError(message, where=here(), path=("values",))
        try:
            self.spikes(0)
        except ModelError as error:
            raise error.at(here()) from None

    @property
    def gives_rates(self) -> bool:
        """True if the last code returns rates, so that the spikes are Poisson."""
        return bool(self.code[-1].rates)

    def spikes(self, seed: int) -> Floats:
        """Return the spikes or rates of the codes.

        Args:
            seed: seed of random codes.

        Returns:
            Times in ms after `start`, with the spikes of a neuron on the last axis and NaN as padding, or rates in Hz.

        Raises:
            ModelError: a code refuses the values or its parameters. The path of the error leads to the wrong value.
        """
        encoded = np.atleast_1d(self.values.values if isinstance(self.values, FromFile) else np.asarray(self.values))
        for k, code in enumerate(self.code):
            place = ("code", *((str(k),) if len(self.code) > 1 else ()), code.name)
            if k + 1 < len(self.code) and not code.rates:
                raise ModelError(f"{self.name}.code: {code.name} gives spike times: expected it at the end", path=place)
            try:
                encoded = code(encoded, seed)
            except ModelError as error:
                path = ("values",) if k == 0 and error.path == (code.values,) else (*place, *error.path)
                raise error.but(message=f"{code.name}: {error.message}", path=path) from None
        return encoded


MEAN, AMPLITUDE, PER_STEP, PHASE = range(4)


@dataclass(frozen=True, kw_only=True, eq=False)
class sinusoidal_poisson_generator(Timed):
    """Generator of a Poisson number of spikes per step, at a sinusoidal rate. Negative rates count as 0.

    In NEST each target receives a separate spike train unless `individual_spike_trains` is false. In neuro all targets
    of a neuron share a spike train, so a neuron may have only one target while the parameter is true.
    """

    equation: ClassVar[str] = (
        "number of spikes in a step ~ Poisson(max(0, rate + amplitude sin(2 pi frequency t / 1000 + pi phase / 180)) "
        "h / 1000)"
    )
    source: ClassVar[str] = "NEST 3.10 sinusoidal_poisson_generator"
    fixed: ClassVar[tuple[str, ...]] = ("individual_spike_trains",)

    rate: Value = quantity(0.0, "Hz", "mean rate", at_least=0, arrays=True)
    amplitude: Value = quantity(0.0, "Hz", "amplitude of the sine", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "frequency of the sine", at_least=0, arrays=True)
    phase: Value = quantity(0.0, "deg", "phase of the sine at t = 0", arrays=True)
    individual_spike_trains: bool = quantity(True, "", "whether targets must not share a spike train", kind="boolean")

    def constants(p, h, c):
        """Fill `c` with spikes per step and the sine's angle per step.

        `p` has the parameters above without start and stop.
        """
        c[MEAN], c[AMPLITUDE] = p[0] * h / 1000.0, p[1] * h / 1000.0
        c[PER_STEP], c[PHASE] = 2.0 * math.pi / 1000.0 * p[2] * h, math.pi / 180.0 * p[3]

    def emit(s, c, u, step, lo, hi, out):
        """Draw Poisson numbers, all with the mean of the step."""
        mean = c[MEAN] + c[AMPLITUDE] * math.sin(c[PER_STEP] * step + c[PHASE])
        if mean > 0.0:
            p_zero = math.exp(-mean)
            for i in range(lo, hi):
                if u[i] >= p_zero:
                    out[i] = poisson(u[i], mean, p_zero)


LARGEST_SHAPE = 10
CHANCE, STAGES = range(2)
_STAGES: list[State] = []
for _k in range(LARGEST_SHAPE):
    _STAGES.append(State(f"in_stage_{_k}", "", "number of processes in a stage", hidden=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class gamma_sup_generator(Timed):
    """Generator of the spikes of many independent gamma processes, like the input from a population of neurons.

    A process passes through `gamma_shape` stages and spikes at the end of the last one. The probability to leave a
    stage in a step is rate gamma_shape h / 1000. All targets of a neuron receive the same spike train.
    """

    equation: ClassVar[str] = (
        "in a step each of n_proc processes enters its next stage of gamma_shape with the probability "
        "rate gamma_shape h / 1000, and spikes when it leaves the last one"
    )
    source: ClassVar[str] = "NEST 3.10 gamma_sup_generator; Deger, Helias, Boucsein & Rotter 2012"
    fixed: ClassVar[tuple[str, ...]] = ("gamma_shape", "n_proc")
    states: ClassVar[tuple[State, ...]] = tuple(_STAGES)

    rate: Value = quantity(0.0, "Hz", "mean rate of each process", at_least=0, arrays=True)
    gamma_shape: int = quantity(
        1, "", "number of stages of a process", kind="integer", at_least=1, at_most=LARGEST_SHAPE
    )
    n_proc: int = quantity(1, "", "number of processes", kind="integer", at_least=1)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the processes spread evenly over the stages, as in NEST. The first stages get the remainder."""
        stages, processes = int(parameters["gamma_shape"][0]), int(parameters["n_proc"][0])
        per_stage, remainder = divmod(processes, stages)
        return {f"in_stage_{k}": np.array([float(per_stage + (k < remainder))]) for k in range(stages)}

    def constants(p, h, c):
        """Fill `c` with the probability to leave a stage in a step. `p` is rate, gamma_shape and n_proc."""
        c[CHANCE], c[STAGES] = p[0] * p[1] * h / 1000.0, p[1]

    def emit(s, c, u, step, lo, hi, out):
        """Move binomial numbers of processes to the next stage. All stages of a neuron use the same uniform number."""
        stages = int(c[STAGES])
        for i in range(lo, hi):
            u_left, n_arriving = u[i], 0
            for stage in range(stages):
                n_leaving, u_left = binomial(u_left, int(s[stage, i]), c[CHANCE])
                s[stage, i] += n_arriving - n_leaving
                n_arriving = n_leaving
            s[0, i] += n_arriving
            out[i] = n_arriving
