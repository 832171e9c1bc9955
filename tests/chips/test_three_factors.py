"""Learning with three factors on Loihi 2: lava's engine, and what a described rule becomes for it."""

import json
from pathlib import Path

import numpy as np
import pytest

from neuro.model.synapses import loihi2_learning
from neuro.model.synapses.loihi_rule import POST, PRE, LearningRule, Trace
from neuro_chip.plastic import ThreeFactors

GOLDEN = Path(__file__).parent / "loihi2_three_factors"
CASES = json.loads((GOLDEN / "lava_0_10_0.json").read_text())
HELD = Trace(0, 1, 1)


def engine(case, weights):
    """A projection that learns by the rule of a case; nothing but the test changes what its targets send."""
    dw, dt = (loihi2_learning.parsed(case[word], word) for word in ("dw", "dt"))
    rule = LearningRule(dw, dt, dict.fromkeys((*PRE, *POST), HELD), case["t_epoch"], from_target=True)
    own = {"graded": GRADED[case["graded"]], "sign_mode": case["sign_mode"].lower()}
    n_post, n_pre = weights.shape
    ends, targets = np.arange(0, weights.size + 1, n_post), np.tile(np.arange(n_post, dtype=np.int32), n_pre)
    return ThreeFactors("p", 0, rule, case | own, ends, targets, n_post, weights.T.ravel())


GRADED = {
    "USE_REGULAR_IMPULSE": "impulse",
    "OVERWRITE": "overwrite",
    "ADD_WITH_SATURATION": "add_with_saturation",
    "ADD_WITHOUT_SATURATION": "add_without_saturation",
}


@pytest.mark.parametrize("name", CASES)
def test_the_engine_equals_lava(name):
    with np.load(GOLDEN / "lava_0_10_0.npz") as file:
        arrays = {key.removeprefix(f"{name}__"): file[key] for key in file.files if key.startswith(f"{name}__")}
    plastic = engine(CASES[name], arrays["W0"])
    shape = arrays["W0"].shape
    for k, x in enumerate(arrays["x"]):
        plastic.ys[:] = [arrays[trace][k] for trace in POST]
        pre = np.flatnonzero(x)
        plastic.step(k + 1, pre, np.flatnonzero(arrays["post"][k]), x[pre])
        np.testing.assert_array_equal(plastic.weights.reshape(shape[::-1]).T, arrays["weights"][k])
        np.testing.assert_array_equal(plastic.tags.reshape(shape[::-1]).T, arrays["tag_1"][k])
        np.testing.assert_array_equal(plastic.xs, [arrays[trace][k] for trace in PRE])
