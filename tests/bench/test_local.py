"""A recogniser that learns by reward, among the methods."""

from dataclasses import replace

import numpy as np
import pytest

import neuro
from neuro_bench import METHODS, Examples, Spikes
from neuro_bench.features import recordings
from neuro_bench.task import random_folds


def bars(n=20):
    """A bar 3 px wide that moves along rows or along columns, steps of 5 ms."""
    spikes = np.zeros((n, 20, 2, 34, 34), dtype=bool)
    for k, step in np.ndindex(n, 20):
        spikes[k, step, 0][(slice((step + k) % 31, (step + k) % 31 + 3), slice(None))[:: 1 if k % 2 else -1]] = True
    frames = spikes.sum(axis=1, dtype=np.float32)
    return Examples(frames, np.arange(n) % 2, ("standing", "lying"), Spikes.of_dense(spikes, 5.0))


def test_bars_are_told_apart_by_a_local_rule():
    fold, method = random_folds(bars(), 2, 0)[0], METHODS["remus"]()
    made = method.fit(fold.both, {**method.settings, "epochs": 2}, 0)
    assert made.predict(fold.test).tolist() == fold.test.labels.tolist()
    costs = made.costs(fold.test)
    assert costs.parameters == 2 * 8 * 4 * 11 * 11  # of each class eight maps, which see four orientations
    assert costs.effective_acs > 0.0
    # 4 orientations of 3, 5, 7 and 9 px on at most 34 x 34 px; 16 responses at each pixel; 4 x 17 x 17 values.
    frame = 656 * 34 * 34 + 16 * 34 * 34 + 4 * 17 * 17 * (3 + 10 + 11 + 1)
    assert 0.0 < costs.host["macs"] < 20 * frame
    assert costs.host["joules"] < costs.joules["Loihi, as fast as it can"] < costs.host["joules"] + 0.01


def test_what_shows_nothing_is_undecided():
    shown, method = bars(8), METHODS["remus"]()
    made = method.fit(shown, {**method.settings, "epochs": 1}, 0)
    first = shown.spikes.at == 0  # too few for a pseudo-frame
    few = replace(shown.spikes, **{name: getattr(shown.spikes, name)[first] for name in ("example", "at", "neuron")})
    assert made.predict(replace(shown, spikes=few)).tolist() == [-1] * 8
    assert sum(len(events) for events in recordings(shown)) == len(shown.spikes.at)


@pytest.mark.parametrize("shape", [(1, 34, 34), (2, 4, 32)])
def test_what_is_no_event_cameras_is_refused(shape):
    method, spikes = METHODS["remus"](), Spikes.of_dense(np.ones((20, 2, *shape)), 5.0)
    with pytest.raises(
        neuro.ModelError, match=r"shape .*: expected the two polarities of an event camera, at least 22"
    ):
        method.fit(replace(bars(), spikes=spikes), method.settings, 0)
