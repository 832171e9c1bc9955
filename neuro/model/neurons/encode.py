"""Values as spikes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.coding.codes import chain
from neuro.coding.encoders import Floats
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, here
from neuro.core.quantities import Value, quantity
from neuro.core.values import FromFile, shown
from neuro.model.neurons.base import Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class encode(Generator):
    """Emits what a code makes of values; while running it is a `spike_generator`, or a `poisson_generator` of rates.

    A spike that the code puts at t is emitted in the step of `start` + t: with t = 0 in the first one after `start`.
    What a code draws follows from the network's seed and the population's name. In YAML `{file: ..., key: ...}` may
    stand for `values`.
    """

    equation: ClassVar[str] = "spikes = code(values)"
    source: ClassVar[str] = "thesis section 2.3, line 666"
    role: ClassVar[str] = "encoded"
    file_of: ClassVar[str] = "values"

    values: Value = quantity(doc="what is encoded", arrays=True)
    code: Any = quantity(
        doc="a code of `neuro.coding`, or a list of which each takes what the one before gives", kind="codes"
    )
    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)

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
        """Whether the spikes are Poisson, at the rates of the last code."""
        return bool(self.code[-1].rates)

    def spikes(self, seed: int) -> Floats:
        """What the codes give.

        Args:
            seed: of codes that draw.

        Returns:
            Times in ms after `start`, an axis of spikes last, NaN where there is none; or rates in Hz.

        Raises:
            ModelError: a code refuses the values or its parameters; the path leads to what it refuses.
        """
        found = np.atleast_1d(self.values.values if isinstance(self.values, FromFile) else np.asarray(self.values))
        for k, code in enumerate(self.code):
            place = ("code", *((str(k),) if len(self.code) > 1 else ()), code.name)
            if k + 1 < len(self.code) and not code.rates:
                raise ModelError(f"{self.name}.code: {code.name} gives spike times: expected it last", path=place)
            try:
                found = code(found, seed)
            except ModelError as error:
                path = ("values",) if k == 0 and error.path == (code.values,) else (*place, *error.path)
                raise error.but(message=f"{code.name}: {error.message}", path=path) from None
        return found
