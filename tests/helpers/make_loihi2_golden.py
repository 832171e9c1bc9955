"""Make golden cases of Loihi 2 with lava-nc 0.10.0: at the ends of its registers, and with three factors.

    PYTHON tests/helpers/make_loihi2_golden.py tests/chips/loihi2_ends
    PYTHON tests/helpers/make_loihi2_golden.py tests/chips/loihi2_three_factors

PYTHON has lava-nc 0.10.0, which needs Python 3.10: `python3.10 -m venv lava && lava/bin/pip install lava-nc==0.10.0`.
`neuro.testing.loihi2_traces` says what the arrays are called; they are in lava's order, width before height.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from lava.magma.core.learning.constants import GradedSpikeCfg
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule, Loihi3FLearningRule
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2SimCfg
from lava.proc.conv.process import Conv
from lava.proc.dense.process import DelayDense, Dense, LearningDense
from lava.proc.io.sink import RingBuffer as Sink
from lava.proc.io.source import RingBuffer as Source
from lava.proc.lif.process import LIF, TernaryLIF
from lava.utils.weightutils import SignMode

from make_sums import drawn_sum

Array = np.ndarray

facts: dict[str, dict[str, Any]] = {}
arrays: dict[str, Array] = {}


def keep(name: str, case: dict[str, Any], **values: Array) -> None:
    """Add a case."""
    facts[name] = case
    arrays.update({f"{name}__{word}": np.asarray(value, dtype=np.int32) for word, value in values.items()})


def ran(process: Any, inputs: dict[str, Array], output: str, states: tuple[str, ...] = ()) -> dict[str, Array]:
    """Run a process; arrays (steps, ...) of what it sends, as "sent", and of its states after each step."""
    steps = len(next(iter(inputs.values())))
    for port, values in inputs.items():
        source = Source(data=np.moveaxis(values, 0, -1).astype(int))
        source.s_out.connect(getattr(process, port))
    out = getattr(process, output)
    sink = Sink(shape=out.shape, buffer=steps)
    out.connect(sink.a_in)
    found: dict[str, list[Array]] = {word: [] for word in states}
    for _ in range(steps):
        process.run(RunSteps(1), Loihi2SimCfg(select_tag="fixed_pt"))
        for word in states:
            found[word].append(np.array(getattr(process, word).get()))
    sent = np.moveaxis(np.array(sink.data.get()), -1, 0)
    process.stop()
    return {"sent": sent} | {word: np.array(each) for word, each in found.items()}


def convolutions() -> None:
    """Kernels, strides, paddings, dilations, groups and channels that differ down and across: each alone, and all."""
    rng = np.random.default_rng(1)
    plain = {"kernel": (3, 2), "stride": (1, 1), "padding": (0, 0), "dilation": (1, 1), "groups": 1, "maps": 4}
    cases = {
        "kernel": {},
        "kernel_of_one_row": {"kernel": (4, 1)},
        "kernel_of_one_column": {"kernel": (1, 4)},
        "stride": {"stride": (1, 3)},
        "stride_down": {"stride": (3, 1)},
        "padding": {"padding": (2, 0)},
        "padding_down": {"padding": (0, 2)},
        "dilation": {"dilation": (1, 2)},
        "dilation_across": {"dilation": (3, 1)},
        "groups": {"groups": 2},
        "depthwise": {"groups": 4, "maps": 8},
        "all": {"stride": (2, 1), "padding": (1, 3), "dilation": (2, 3), "groups": 2, "maps": 6},
        "all_turned": {"kernel": (2, 3), "stride": (1, 2), "padding": (3, 1), "dilation": (3, 2), "groups": 4},
    }
    for name, words in cases.items():
        case = plain | words
        width, height = case.pop("kernel")
        maps, shape = case.pop("maps"), (9, 7, 4)
        weight = rng.integers(-255, 256, (maps, width, height, shape[2] // case["groups"]))
        x = rng.integers(-100, 100, (4, *shape)) * (rng.random((4, *shape)) < 0.3)
        convolve(f"conv_{name}", weight, x, case)
    # 255 x 32896 + 127 is 2^23 - 1, the largest sum of 24 bits.
    x = np.zeros((7, 3, 2, 1))
    x[1:6, 0, 1, 0] = (32896, 32896, -32896, -32896, 65793)
    x[1:6, 1, 1, 0] = (127, 128, -128, -129, 0)
    weight = np.array([[1, 255], [-1, -255]]).reshape(2, 2, 1, 1)
    convolve("conv_wraps", weight, x, {word: plain[word] for word in ("stride", "padding", "dilation", "groups")})


def convolve(name: str, weight: Array, x: Array, case: dict[str, Any]) -> None:
    """Add a convolution."""
    bits = 24 if np.abs(x).max() > 127 else 8
    process = Conv(weight=weight, input_shape=x.shape[1:], num_message_bits=bits, **case)
    words = {word: list(value) if isinstance(value, tuple) else value for word, value in case.items()}
    keep(
        name,
        words | {"num_message_bits": bits, "weight_exp": 0},
        W=weight,
        x=x,
        a=ran(process, {"s_in": x}, "a_out")["sent"],
    )


def connections() -> None:
    """Weights beyond both ends of each sign mode, all numbers of weight bits, exponents and delays at their ends."""
    x = np.zeros((6, 4), dtype=int)
    x[1:4] = [[1, -1, 127, -128], [-128, 127, 1, 1], [3, 0, -5, 7]]
    mixed = np.array([[-257, -256, -255, -254], [253, 254, 255, 256], [-1, 0, 1, 2]])
    kinds = {"MIXED": mixed, "EXCITATORY": np.abs(mixed), "INHIBITORY": -np.abs(mixed)}
    for mode, weights in kinds.items():
        for bits, exponent in ((8, 0), (1, 0), (4, 7), (8, -8), (7, -1)):
            case = {"num_message_bits": 8, "weight_exp": exponent, "num_weight_bits": bits, "sign_mode": mode}
            process = Dense(weights=weights, **{**case, "sign_mode": SignMode[mode]})
            name = f"dense_ends_{mode.lower()}_{bits}_{exponent}"
            keep(name, case, W=weights, x=x, a=ran(process, {"s_in": x}, "a_out")["sent"])
    delays = np.array([[0, 62, 1, 61], [62, 0, 31, 32]])
    weights = np.array([[8, -16, 32, 64], [2, 4, -6, 10]])
    x = np.zeros((70, 4), dtype=int)
    x[[1, 2, 5]] = [[1, 2, 3, 4], [-5, 6, -7, 8], [9, 9, 9, 9]]
    case = {"num_message_bits": 8, "weight_exp": 0, "num_weight_bits": 8, "sign_mode": "MIXED"}
    process = DelayDense(weights=weights, delays=delays, **{**case, "sign_mode": SignMode.MIXED})
    keep("delaydense_ends", case, W=weights, D=delays, x=x, a=ran(process, {"s_in": x}, "a_out")["sent"])


def neurons() -> None:
    """Currents that wrap and voltages that are clipped at both ends, thresholds and biases at theirs."""
    # 64 x 131072 is 2^23: u wraps above it, and one step of the input below.
    jumps = np.array([131071, 1, 1, -1, -262143, -2, 1, 262143, 131072, -131072, -131073, 0, 0, 0])
    inputs = {
        "lif_u_ends": {"du": -1, "dv": 4095, "vth": 131071},
        "lif_u_keeps_nothing": {"du": 4095, "dv": 4095, "vth": 131071},
        "lif_v_ends": {"du": 4095, "dv": 0, "vth": 131071},
        "lif_vth_0": {"du": 4095, "dv": 0, "vth": 0},
        "lif_v_keeps_nothing": {"du": 2048, "dv": 4096, "vth": 1},
    }
    for name, words in inputs.items():
        a = np.stack([jumps, -jumps, np.tile([131071, 131071, -131072], 5)[:14], np.full(14, -131071)], axis=1)
        if name == "lif_vth_0":
            a = np.sign(a)
        found = ran(LIF(shape=(4,), bias_mant=np.zeros(4, int), bias_exp=0, **words), {"a_in": a}, "s_out", ("u", "v"))
        keep(name, {**words, "bias_exp": 0}, a_in=a, u=found["u"], v=found["v"], s=found["sent"])
    for exponent in (0, 7):
        bias = np.array([4095, -4096, 1, -1])
        words = {"du": 0, "dv": 0, "vth": 131071}
        a = np.zeros((40, 4), dtype=int)
        found = ran(LIF(shape=(4,), bias_mant=bias, bias_exp=exponent, **words), {"a_in": a}, "s_out", ("u", "v"))
        name = f"lif_bias_{exponent}"
        keep(name, words | {"bias_exp": exponent}, a_in=a, bias_mant=bias, u=found["u"], v=found["v"], s=found["sent"])
    for high, low in ((131071, -131071), (0, 0), (1, -1)):
        words = {"du": 4095, "dv": 0, "vth_hi": high, "vth_lo": low}
        a = np.stack([jumps, -jumps, np.full(14, 1), np.full(14, -1)], axis=1)
        found = ran(TernaryLIF(shape=(4,), **words), {"a_in": a}, "s_out", ("u", "v"))
        keep(f"ternary_ends_{high}", words | {"bias_exp": 0}, a_in=a, u=found["u"], v=found["v"], s=found["sent"])


def learning() -> None:
    """Weights that learn up to both bounds of each sign mode, and tags and traces up to theirs."""
    rules = {"up": {"dw": "2^1*x1*y0", "dt": "2^2*x1*y0"}, "down": {"dw": "-2^1*x1*y0", "dt": "-2^2*x1*y0"}}
    starts = {"MIXED": [[100, -100, 0], [250, -250, 2]], "EXCITATORY": [[100, 3, 0], [250, 128, 2]]}
    starts["INHIBITORY"] = [[-100, -3, 0], [-250, -128, -2]]
    for way, rule in rules.items():
        for mode, start in starts.items():
            learn(f"learning_ends_{mode.lower()}_{way}", rule, mode, np.array(start), 48, 4)


def learn(name: str, rule: dict[str, str], mode: str, start: Array, steps: int, epoch: int) -> None:
    """Add a case of learning."""
    rng = np.random.default_rng(2)
    x, post = (rng.random((steps, n)) < 0.5 for n in start.shape[::-1])
    post[0] = False  # nothing can make a neuron of ours fire in its first step
    case = rule | {"x1_impulse": 120, "x1_tau": 40, "x2_impulse": 0, "x2_tau": 0, "y1_impulse": 120, "y1_tau": 40}
    learnt = Loihi2FLearningRule(**case, t_epoch=epoch, rng_seed=3)
    process = LearningDense(weights=start, learning_rule=learnt, sign_mode=SignMode[mode])
    source = Source(data=post.T.astype(int))
    source.s_out.connect(process.s_in_bap)
    found = ran(process, {"s_in": x.astype(int)}, "a_out", ("weights", "tag_1", "x1", "y1"))
    case |= {"t_epoch": epoch, "graded": "USE_REGULAR_IMPULSE", "num_message_bits": 0, "rng_seed": 3, "sign_mode": mode}
    recorded = {word: found[word] for word in ("weights", "tag_1", "x1", "y1")}
    keep(name, case, W0=start, x=x, post=post, a=found["sent"], **recorded)


GRADED = ("USE_REGULAR_IMPULSE", "OVERWRITE", "ADD_WITH_SATURATION", "ADD_WITHOUT_SATURATION")
SENT = ("y1", "y2", "y3")
"""Traces that the target sends."""


def three_factors(cases: int = 20) -> None:
    """Random rules of three factors: what the target sends as y1, y2 and y3 is drawn."""
    for seed in range(cases):
        rng = np.random.default_rng(seed)
        steps, epoch = 40, int(rng.choice([1, 1, 2, 3, 5]))
        shape = tuple(rng.integers(1, 5, 2))
        mode = str(rng.choice(["MIXED", "EXCITATORY", "INHIBITORY"]))
        low, high = {"MIXED": (-128, 128), "EXCITATORY": (0, 256), "INHIBITORY": (-255, 1)}[mode]
        start = rng.integers(low, high, shape) * (2 if mode == "MIXED" else 1)
        graded = str(rng.choice(GRADED))
        every = int(rng.integers(0, 4))
        case: dict[str, Any] = {word: drawn_sum(rng, every, 4) for word in ("dw", "dt")}
        case |= {"x1_impulse": 0 if graded != GRADED[0] else int(rng.integers(1, 128)), "x1_tau": int(rng.integers(40))}
        case |= {"x2_impulse": int(rng.integers(1, 128)), "x2_tau": int(rng.integers(40))}
        words = {**case, "t_epoch": epoch, "rng_seed": seed}
        bits = 0 if graded == GRADED[0] else 8
        x = rng.integers(1, 256, (steps, shape[1])) * (rng.random((steps, shape[1])) < 0.3)
        post = rng.random((steps, shape[0])) < 0.3
        sent = {word: rng.integers(0, 128, (steps, shape[0])) for word in SENT}
        process = LearningDense(
            weights=start,
            learning_rule=Loihi3FLearningRule(**words),
            sign_mode=SignMode[mode],
            num_message_bits=bits,
            graded_spike_cfg=GradedSpikeCfg[graded],
        )
        inputs = {"s_in": x, "s_in_bap": post.astype(int)} | {f"s_in_{word}": values for word, values in sent.items()}
        found = ran(process, inputs, "a_out", ("weights", "tag_1", "x1", "x2"))
        del found["sent"]
        words |= {"graded": graded, "num_message_bits": bits, "sign_mode": mode}
        keep(f"three_factors_{seed}", words, W0=start, x=x, post=post, **sent, **found)


def main() -> None:
    """Make the cases of a folder and write them."""
    folder = Path(sys.argv[1])
    if folder.name == "loihi2_three_factors":
        three_factors()
    else:
        convolutions()
        connections()
        neurons()
        learning()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "lava_0_10_0.json").write_text(json.dumps(facts, indent=1) + "\n")
    np.savez_compressed(folder / "lava_0_10_0.npz", **arrays)


if __name__ == "__main__":
    main()
