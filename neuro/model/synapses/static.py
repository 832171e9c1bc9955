"""A synapse that keeps its weight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class static(Synapse):
    """Sends its weight after its delay. Source: NEST 3.10, `static_synapse`."""

    equation: ClassVar[str] = "sends w"
    source: ClassVar[str] = "NEST 3.10 static_synapse"
