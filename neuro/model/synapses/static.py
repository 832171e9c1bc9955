"""A synapse that keeps its weight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class static(Synapse):
    """Sends its weight after its delay. Source: NEST 3.10, `static_synapse`.

    With `receptor` all spikes go to the receptor of that name, whatever the sign of their weight: a current takes the
    weight as it is, a conductance grows by it, so it is not negative.
    """

    equation: ClassVar[str] = "sends w"
    source: ClassVar[str] = "NEST 3.10 static_synapse"

    receptor: str | None = quantity(
        None, "", "the target's receptor that spikes go to; by the sign of the weight if not said", kind="receptor"
    )
