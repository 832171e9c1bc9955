"""Classes by a local rule: a recogniser of `neuro_recognise` that learns by reward, not by gradients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro import ModelError
from neuro_bench.costs import Costs, spiking_costs
from neuro_bench.features import recordings
from neuro_bench.method import Method
from neuro_bench.spiking import PRICED
from neuro_bench.task import Examples

if TYPE_CHECKING:
    from neuro_recognise.recogniser import Recogniser

LEAST = 22
"""px of a side: a kernel has 11 cells of 2 px."""


class ReMuS(Method):
    """Prototypes that learn by reward-modulated STDP; the first to fire in a pseudo-frame names the class.

    As `neuro recognise train --method remus` with the same preset, on the spikes of the examples. A step has one time,
    and several events of a pixel in it are one.
    """

    called_by = "remus"
    title = "reward-modulated STDP on pseudo-frames, as neuro recognise"
    spiking = True
    settings = {"preset": "best", "epochs": 8}
    space = {"preset": ("best", "adapted"), "epochs": (4, 8, 16)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Recognises:
        """Learn from examples; see `Method`.

        Raises:
            ModelError: the input is no event camera's, no example has a pseudo-frame, or there is no such preset.
        """
        from neuro_recognise.methods import method_of
        from neuro_recognise.observations import observed
        from neuro_recognise.recogniser import learn

        sheets, rows, columns = train.spikes.shape
        if sheets != 2 or min(rows, columns) < LEAST:
            found = f"method '{self.called_by}': the input has the shape {train.spikes.shape}"
            expected = f"expected the two polarities of an event camera, at least {LEAST} x {LEAST} px"
            raise ModelError(f"{found}: {expected}", hint="n-mnist, poker-dvs and dvs-gesture have such")
        method = method_of(self.called_by, settings["preset"], {"epochs": settings["epochs"]}).fitting((columns, rows))
        shown = replace(observed(method, recordings(train), train.classes), labels=train.labels)
        return _Recognises(learn(method, shown, digest="", seed=seed))


class _Recognises:
    """A recogniser that is asked about examples."""

    def __init__(self, recogniser: Recogniser) -> None:
        self.recogniser = recogniser

    def predict(self, shown: Examples) -> Any:
        """The class of each, -1 where nothing speaks for any."""
        from neuro_recognise.method import choose

        return choose(self.recogniser.scores(recordings(shown)))

    def costs(self, shown: Examples) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first examples; what cuts and filters is not counted.

        Examples differ in length; that of the counts is the mean. Real time is the network's own, 64 ms a pseudo-frame.
        """
        n = min(PRICED, len(shown))
        answer = self.recogniser.answer(recordings(shown.take(np.arange(n))))
        assert answer.run is not None
        sim, taken = answer.run()
        return spiking_costs(sim, taken, n, steps=taken.raw_counts.steps // n)
