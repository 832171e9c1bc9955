"""Random networks of graded neurons, and a plain twin of their integers."""

import numpy as np

import neuro

STEPS = 24
KINDS = ("sigma_delta", "delta_encoder", "graded_vector")


def network(seed: int, chip: bool = False) -> tuple[neuro.Network, list, list]:
    """A network without loops that ends in a decoder; with what the twin needs: populations, and wires.

    Args:
        seed: of all that is drawn.
        chip: whether sums are shifted down, which float backends do not round.
    """
    rng = np.random.default_rng(seed)
    net, sizes = neuro.Network("graded", resolution=1.0), rng.integers(1, 7, 4)
    steps, ids = np.nonzero(rng.random((STEPS, sizes[0])) < 0.4)
    rows = np.stack([steps + 1, ids, rng.integers(-60, 61, ids.size)], axis=1)
    rows = rows[rows[:, 2] != 0]
    net.population("0", int(sizes[0]), neuro.graded_spike_train(spikes=rows))
    sent = np.zeros((STEPS + 1, sizes[0]), dtype=np.int64)
    sent[rows[:, 0], rows[:, 1]] = rows[:, 2]
    parts: list = [("listed", sent)]
    for k in (1, 2, 3):
        name = str(rng.choice(KINDS)) if k < 3 else "sigma_decoder"
        words = drawn(rng, name)
        net.population(str(k), int(sizes[k]), getattr(neuro, name)(**words))
        parts.append((name, words))
    wires = []
    for source, target in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3)):
        pre, post = np.nonzero(rng.random((sizes[source], sizes[target])) < 0.7)
        shift = int(rng.integers(0, 4)) if chip else 0
        weight = 2.0 * rng.integers(-9, 10, pre.size)
        delay = rng.integers(1, 5, pre.size) if rng.random() < 0.5 else np.full(pre.size, rng.integers(1, 4))
        synapse = neuro.loihi2_static(weight_exp=-shift) if chip else neuro.static()
        rule = neuro.pairs(pre=pre, post=post)
        delays = delay.astype(float) if len(set(delay)) > 1 else float(max(delay, default=1))
        net.connect(str(source), str(target), rule, synapse, weight=weight, delay=delays)
        wires.append((source, target, pre, post, weight.astype(np.int64), delay, shift))
    return net, parts, wires


def drawn(rng: np.random.Generator, name: str) -> dict:
    """Parameters of a model."""
    if name == "sigma_decoder":
        return {}
    if name == "graded_vector":
        return {"vth": int(rng.integers(0, 40)), "relu": bool(rng.random() < 0.5)}
    words = {
        "vth": int(rng.integers(0, 30)),
        "spike_exp": int(rng.integers(0, 3)),
        "state_exp": int(rng.integers(0, 3)),
    }
    words["cum_error"] = bool(rng.random() < 0.3)
    if name == "sigma_delta":
        words |= {"bias": int(rng.integers(-20, 21)), "relu": bool(rng.random() < 0.6)}
    return words


def twin(parts: list, wires: list) -> list[np.ndarray]:
    """The payloads of each population, shape (steps + 1, neurons), by the words of lava's processes."""
    sizes = [parts[0][1].shape[1]] + [0] * (len(parts) - 1)
    for source, target, pre, post, *_ in wires:
        sizes[source] = max(sizes[source], int(pre.max(initial=-1)) + 1)
        sizes[target] = max(sizes[target], int(post.max(initial=-1)) + 1)
    sent = [parts[0][1]] + [np.zeros((STEPS + 1, n), dtype=np.int64) for n in sizes[1:]]
    states = [{word: np.zeros(n, dtype=np.int64) for word in ("sigma", "act", "res", "err")} for n in sizes]
    for k in range(1, STEPS + 1):
        inputs = [np.zeros(n, dtype=np.int64) for n in sizes]
        for source, target, pre, post, weight, delay, shift in wires:
            for lag in np.unique(delay[delay <= k]):
                here, one = delay == lag, np.zeros(sizes[target], dtype=np.int64)
                np.add.at(one, post[here], weight[here] * sent[source][k - lag][pre[here]])
                inputs[target] += one >> shift
        for at, (name, words) in enumerate(parts[1:], 1):
            sent[at][k] = step(name, words, inputs[at], states[at])
    return sent


def step(name: str, words: dict, a: np.ndarray, s: dict[str, np.ndarray]) -> np.ndarray:
    """What a population sends in a step."""
    if name == "graded_vector":
        return np.where((a if words["relu"] else abs(a)) > words["vth"], a, 0)
    if name == "sigma_decoder":
        s["sigma"] += a
        return s["sigma"]
    unit = words["spike_exp"] + words["state_exp"]
    y = a << unit
    if name == "sigma_delta":
        s["sigma"] += a
        y = s["sigma"] + (words["bias"] << unit)
        y = np.maximum(y, 0) if words["relu"] else y
    delta = y - s["act"] + s["res"]
    compared = s["err"] + delta if words["cum_error"] else delta
    out = np.where(abs(compared) >= words["vth"] << unit, delta, 0)
    s["err"] = np.where(out == 0, compared, 0) if words["cum_error"] else s["err"]
    s["res"], s["act"] = delta - out, y
    return out >> words["state_exp"]
