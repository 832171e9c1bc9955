import numpy as np
import pytest

from neuro_recognise.methods.remus import Remus
from neuro_recognise.recogniser import learn
from neuro_recognise.shown import Shown


@pytest.fixture(scope="session")
def letters():
    """Spikes of 24 noisy recordings of three shapes on a small sheet, three frames each; two more are empty."""
    rng = np.random.default_rng(2)
    shapes = [rng.permutation(4 * 64)[:30] for _ in range(3)]
    labels = np.arange(26) % 3
    evidence = []
    for k in range(26):
        codes, ids, lengths = [], [], []
        for _ in range(3 if k < 24 else 0):
            seen = np.unique(np.concatenate([rng.permutation(shapes[labels[k]])[:26], rng.permutation(256)[:8]]))
            ticks = np.where(np.isin(seen, shapes[labels[k]]), rng.integers(0, 8, len(seen)), 6)
            order = np.lexsort((seen, ticks))
            codes.append(ticks[order])
            ids.append(seen[order])
            lengths.append(len(seen))
        codes, ids = (np.concatenate([np.zeros(0, int), *part]) for part in (codes, ids))
        ends = 10_000 * np.arange(1, len(lengths) + 1)
        one = {"codes": codes.astype(np.uint16), "ids": ids.astype(np.uint32)}
        evidence.append(one | {"lengths": np.array(lengths, np.int64), "ends": ends})
    return Shown(evidence, labels, tuple(f"{k}.bin" for k in range(26)), ("a", "b", "c"))


@pytest.fixture(scope="session")
def small():
    """ReMuS as in the thesis, with settings that go with `letters`."""
    changed = {"epochs": 3, "size": [16, 16], "window": 10.0, "field": 7, "theta": 16.0}
    return Remus().preset("thesis").changed(changed)


@pytest.fixture(scope="session")
def train():
    """Teach a method what recordings show."""

    def taught(shown, method, **more):
        return learn(method, shown, "letters", **more)

    return taught
