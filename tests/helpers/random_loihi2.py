"""Random networks of all neurons and synapses of Loihi 2, and a plain twin of their integers, by lava's words."""

import numpy as np

import neuro

STEPS = 40
LIMIT = 2**23 - 1
BITS = {"mixed": (-256, 255), "excitatory": (0, 255), "inhibitory": (-255, 0)}
REGISTERS = {
    "loihi2_lif": ("u", "v"),
    "loihi2_ternary_lif": ("u", "v"),
    "loihi2_rf": ("real", "imag"),
    "loihi2_rf_iz": ("real", "imag"),
    "sigma_delta": ("sigma", "act", "residue", "error"),
    "delta_encoder": ("act", "residue", "error"),
    "sigma_decoder": ("sigma",),
    "graded_vector": (),
    "graded_product": (),
}
TWO = {"loihi2_rf": ("real", "imag"), "loihi2_rf_iz": ("real", "imag"), "graded_product": ("first", "second")}


def network(seed: int) -> tuple[neuro.Network, list, list]:
    """A network with loops, its populations (name of the model, parameters, size) and wires (matrices by lag)."""
    rng = np.random.default_rng(seed)
    net = neuro.Network("loihi2", resolution=1.0)
    shapes = [(2, 4, 3), (int(rng.integers(1, 3)), 3, 2) if rng.random() < 0.4 else (int(rng.integers(1, 7)),)]
    shapes += [(int(rng.integers(1, 7)),) for _ in range(2)]
    bits = int(rng.choice([1, 8, 16, 24, 32]))
    on = rng.random((STEPS, 24)) < 0.3
    steps, ids = np.nonzero(on)
    values = rng.integers(-(2 ** (bits - 1)), 2 ** (bits - 1), ids.size) if bits > 1 else np.ones(ids.size)
    rows = np.stack([steps + 1, ids, values], axis=1)
    rows = rows[rows[:, 2] != 0].astype(float)
    net.population("0", shapes[0], neuro.graded_spike_train(spikes=rows))
    sent = np.zeros((STEPS + 1, 24), dtype=np.int64)
    sent[rows[:, 0].astype(int), rows[:, 1].astype(int)] = rows[:, 2]
    parts: list = [("listed", sent, 24)]
    for k in (1, 2, 3):
        name = str(rng.choice(list(REGISTERS)))
        words = drawn(rng, name)
        net.population(str(k), shapes[k], getattr(neuro, name)(**words))
        parts.append((name, words, int(np.prod(shapes[k]))))
        for state in REGISTERS[name]:
            net.probe(f"{k}.{state}", str(k), state)
    wires = []
    for source, target in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (3, 2), (2, 2)):
        if rng.random() < 0.8 or target == source + 1:
            wires += connected(rng, net, parts, shapes, source, target)
    return net, parts, wires


def drawn(rng: np.random.Generator, name: str) -> dict:
    """Parameters of a model, also at their ends."""
    if name in ("loihi2_lif", "loihi2_ternary_lif"):
        words = {"du": int(rng.choice([-1, 0, 4095, 700])), "dv": int(rng.choice([0, 1, 4096, 300]))}
        words |= {"bias_mant": int(rng.integers(-4096, 4096)), "bias_exp": int(rng.integers(0, 8))}
        words |= {"reset_interval": int(rng.choice([0, 1, 5])), "reset_offset": int(rng.integers(0, 9))}
        tops = (0, 1, 300, 131071)
        if name == "loihi2_lif":
            return words | {"vth": int(rng.choice(tops))}
        return words | {"vth_hi": int(rng.choice(tops)), "vth_lo": -int(rng.choice(tops))}
    if name in ("loihi2_rf", "loihi2_rf_iz"):
        words = {word: int(rng.choice([-4096, -1000, 0, 3000, 4096])) for word in ("cos_decay", "sin_decay")}
        return words | {"state_exp": int(rng.integers(0, 8)), "vth": int(rng.choice([0, 1, 40, 5000]))}
    if name == "graded_product":
        return {"vth": int(rng.choice([0, 30, 100000])), "exp": int(rng.integers(0, 12))}
    if name == "graded_vector":
        return {"vth": int(rng.choice([0, 9, 3000])), "relu": bool(rng.random() < 0.5)}
    if name == "sigma_decoder":
        return {}
    words = {
        "spike_exp": int(rng.integers(0, 8)),
        "state_exp": int(rng.integers(0, 8)),
        "vth": int(rng.integers(0, 60)),
    }
    words["cum_error"] = bool(rng.random() < 0.5)
    if name == "sigma_delta":
        words |= {"bias": int(rng.integers(-40, 41)), "relu": bool(rng.random() < 0.5)}
    return words


def connected(rng, net, parts, shapes, source, target) -> list:
    """Connect two populations in a random way; (source, target, input, matrices [post, pre] by lag, shift, wraps)."""
    n, m = parts[source][2], parts[target][2]
    kind = str(rng.choice(["static", "mantissas", "mantissas", "convolution", "in time"]))
    mode, exponent, bits = str(rng.choice(list(BITS))), int(rng.integers(-8, 8)), int(rng.integers(1, 9))
    receptors = TWO.get(parts[target][0], ())
    receptor = int(rng.integers(0, 2)) if receptors else 0
    named = {"receptor": receptors[receptor]} if receptors else {}
    low, high = BITS[mode] if kind == "mantissas" else (-127, 127)
    if len(shapes[source]) == len(shapes[target]) == 3 and rng.random() < 0.7:
        shape = (shapes[target][0], shapes[source][0], 2, 2)
        weight = rng.integers(low, high + 1, shape)
        rule, matrix, delay = neuro.grid(kernel=(2, 2)), correlated(weight, shapes[source]), int(rng.integers(1, 65))
        described = weight.ravel()
        matrices = {delay: matrix}
    else:
        pre, post = np.nonzero(rng.random((n, m)) < 0.7) if rng.random() < 0.7 else np.divmod(np.arange(n * m), m)
        if n == m and rng.random() < 0.3:
            pre = post = np.arange(n)
            rule = neuro.one_to_one()
        else:
            rule = neuro.all_to_all() if pre.size == n * m else neuro.pairs(pre=pre, post=post)
        described = rng.integers(low, high + 1, pre.size)
        delay = rng.integers(1, 65, pre.size) if rng.random() < 0.5 else int(rng.integers(1, 5))
        matrices = {}
        for lag in np.unique(delay) if pre.size else ():
            here = np.broadcast_to(delay, pre.size) == lag
            matrices[int(lag)] = np.zeros((m, n), dtype=np.int64)
            np.add.at(matrices[int(lag)], (post[here], pre[here]), described[here])
    delays = delay.astype(float) if isinstance(delay, np.ndarray) else float(delay)
    shift, wraps = 0, kind == "convolution"
    if kind == "static":
        synapse, described = neuro.static(**named), 2 * described
        matrices = {lag: 2 * w for lag, w in matrices.items()}
    elif kind == "mantissas":
        synapse = neuro.loihi2_static(weight_exp=exponent, num_weight_bits=bits, sign_mode=mode, **named)
        lost, sign = 8 - bits + (mode == "mixed"), -1 if mode == "inhibitory" else 1
        kept = {lag: sign * (sign * w >> lost << lost) for lag, w in matrices.items()}
        matrices, shift = {lag: w << max(exponent, 0) for lag, w in kept.items()}, max(-exponent, 0)
    else:
        synapse = neuro.loihi2_convolution(wraps=wraps, **named)
    name = f"{source}{target}{len(net.projections)}"
    net.connect(str(source), str(target), rule, synapse, weight=described.astype(float), delay=delays, name=name)
    return [(source, target, receptor, matrices, shift, wraps)]


def correlated(weight: np.ndarray, shape: tuple) -> np.ndarray:
    """The matrix [post, pre] of a kernel of 2 x 2 over maps in the order of ids."""
    maps, channels = weight.shape[:2]
    _, rows, columns = shape
    matrix = np.zeros((maps, rows - 1, columns - 1, channels, rows, columns), dtype=np.int64)
    for r in range(rows - 1):
        for c in range(columns - 1):
            matrix[:, r, c, :, r : r + 2, c : c + 2] = weight
    return matrix.reshape(maps * (rows - 1) * (columns - 1), -1)


def wrapped(values, bits: int = 32):
    """A two's complement."""
    half = 1 << bits - 1
    return (values + half & (1 << bits) - 1) - half


def share(value, factor):
    """value x factor / 4096, truncated towards 0."""
    product = value * factor
    return np.sign(product) * (abs(product) >> 12)


def twin(parts: list, wires: list) -> tuple[list[np.ndarray], list[dict[str, np.ndarray]]]:
    """What each population sends, and its registers, shape (steps + 1, neurons)."""
    sent = [parts[0][1]] + [np.zeros((STEPS + 1, n), dtype=np.int64) for _, _, n in parts[1:]]
    states = [{}] + [{s: np.zeros((STEPS + 1, n), dtype=np.int64) for s in REGISTERS[name]} for name, _, n in parts[1:]]
    for k in range(1, STEPS + 1):
        inputs = [np.zeros((2, n), dtype=np.int64) for _, _, n in parts]
        for source, target, receptor, matrices, shift, wraps in wires:
            for lag, matrix in matrices.items():
                if lag <= k:
                    total = wrapped(matrix @ sent[source][k - lag])
                    total = wrapped(total, 24) if wraps else total
                    inputs[target][receptor] = wrapped(inputs[target][receptor] + (total >> shift))
        for at, (name, words, _) in enumerate(parts[1:], 1):
            before = {s: values[k - 1] for s, values in states[at].items()}
            sent[at][k], after = step(name, words, inputs[at], before, k)
            for s, values in after.items():
                states[at][s][k] = values
    return sent, states


def step(name: str, w: dict, inputs: np.ndarray, s: dict, k: int) -> tuple[np.ndarray, dict]:
    """What a population sends in step k, and its registers then."""
    a, b = inputs
    if name in ("loihi2_lif", "loihi2_ternary_lif"):
        reset = w["reset_interval"] and (k - w["reset_offset"]) % w["reset_interval"] == 0
        u, v = (0 * s["u"], 0 * s["v"]) if reset else (s["u"], s["v"])
        u = wrapped(share(u, 4095 - w["du"]) + wrapped(a << 6), 24)
        u = np.where(u == -(2**23), 2**23, u)
        v = np.clip(share(v, 4096 - w["dv"]) + u + (w["bias_mant"] << w["bias_exp"]), -LIMIT, LIMIT)
        if name == "loihi2_lif":
            out = (v > w["vth"] << 6).astype(int)
        else:
            out = (v > w["vth_hi"] << 6).astype(int) - (v < w["vth_lo"] * 64)
        return out, {"u": u, "v": np.where(out != 0, 0, v)}
    if name in ("loihi2_rf", "loihi2_rf_iz"):
        c, d, e = w["cos_decay"], w["sin_decay"], w["state_exp"]
        re = np.clip(share(s["real"], c) - share(s["imag"], d) + wrapped(a << e), -LIMIT, LIMIT)
        im = np.clip(share(s["real"], d) + share(s["imag"], c) + wrapped(b << e), -LIMIT, LIMIT)
        vth = w["vth"] << e
        if name == "loihi2_rf":
            return ((re >= vth) & (im >= 0) & (s["imag"] < 0)).astype(int), {"real": re, "imag": im}
        out = (im >= vth).astype(int)
        return out, {"real": np.where(out, 0, re), "imag": np.where(out, vth - 1, im)}
    if name == "graded_product":
        product = wrapped(a * b) >> w["exp"]
        return np.where(wrapped(abs(product)) > w["vth"], product, 0), {}
    if name == "graded_vector":
        return np.where((a if w["relu"] else wrapped(abs(a))) > w["vth"], a, 0), {}
    if name == "sigma_decoder":
        total = wrapped(s["sigma"] + a)
        return total, {"sigma": total}
    unit = w["spike_exp"] + w["state_exp"]
    after, y = {}, wrapped(a << unit)
    if name == "sigma_delta":
        after["sigma"] = wrapped(s["sigma"] + a)
        y = wrapped(after["sigma"] + (w["bias"] << unit))
        y = np.maximum(y, 0) if w["relu"] else y
    delta = wrapped(y - s["act"] + s["residue"])
    error = wrapped(s["error"] + delta)
    out = np.where(wrapped(abs(error if w["cum_error"] else delta)) >= w["vth"] << unit, delta, 0)
    after |= {
        "act": y,
        "residue": wrapped(delta - out),
        "error": np.where(out == 0, error, 0) if w["cum_error"] else s["error"],
    }
    return out >> w["state_exp"], after
