"""ReMuS learns what it learnt when it was an app of its own, to the same bits."""

import hashlib

import numpy as np
import pytest

from neuro.events import Events
from neuro_recognise.method import choose
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features


@pytest.fixture(scope="module")
def bars():
    """Bars, upright and lying, that move over a small field."""
    rng = np.random.default_rng(0)
    made = []
    for k in range(24):
        along, across = rng.integers(8, 27, 900), 14 + np.arange(900) // 180 + rng.integers(0, 2, 900)
        x, y = (along, across) if k % 2 else (across, along)
        made.append(Events(np.arange(900) * 100, x, y, rng.integers(0, 2, 900), (34, 34)))
    return made


@pytest.mark.parametrize(
    ("settings", "history", "kernels"),
    [
        ("thesis", [32 / 48, 1.0, 1.0], "4a791ceea5f144de"),
        ("best", [34 / 48, 38 / 48, 46 / 48], "036bc5f4c2d820bd"),
    ],
)
def test_the_same_kernels(bars, settings, history, kernels):
    """The digests are of kernels that version 0.1.0 learnt, rounded to what no machine adds differently."""
    method = method_of("remus", settings, {"theta": 40, "per_class": 2, "epochs": 3}).fitting((34, 34))
    # in the order of a folder: by class, then by name
    order = sorted(range(16), key=lambda k: (k % 2 == 0, k))
    evidence = [method.observe(bars[k]) for k in order]
    labels = np.array([0 if k % 2 else 1 for k in order])
    made = learn(method, Features(evidence, labels, tuple(map(str, order)), ("lying", "upright")), "bars", seed=3)
    rounded = np.round(made.learnt["c1_s2"], 9) + 0.0
    assert made.learnt["history"].tolist() == history
    assert hashlib.blake2b(rounded.tobytes(), digest_size=8).hexdigest() == kernels
    unseen = Features([method.observe(one) for one in bars[16:]], np.full(8, -1), tuple("abcdefgh"), made.classes)
    assert choose(method.answer(made.learnt, unseen).scores).tolist() == [1, 0] * 4
