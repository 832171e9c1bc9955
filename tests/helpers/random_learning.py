"""Random networks that learn on Loihi 2, with two and with three factors, and a plain twin of their integers.

A twin has one object for each synapse and each neuron, and draws by lava's generators one after the other.
"""

from math import exp, floor

import numpy as np

import neuro
from make_sums import drawn_sum
from neuro.chips import chip, quantise
from neuro.core import keyed_random
from neuro.extend import Neuron, Synapse
from random_loihi2 import BITS, step

STEPS = 60
POST = ("y1", "y2", "y3")
WIDTHS = {"x0": 1, "y0": 1, "w": 9, "t": 9}


def network(seed: int) -> tuple[neuro.Network, dict[int, np.ndarray]]:
    """A network of two layers that learn, the second one also from itself, and the signals that are set by step."""
    rng = np.random.default_rng(seed)
    three = bool(seed % 2)
    net = neuro.Network("learning", resolution=1.0)
    sizes = rng.integers(1, 5, 3)
    times = [np.flatnonzero(rng.random(STEPS) < 0.3) + 1.0 for _ in range(sizes[0])]
    net.population("0", int(sizes[0]), neuro.spike_generator(spike_times=times))
    for k in (1, 2):
        net.population(str(k), int(sizes[k]), described(rng) if three else in_registers(rng))
        if three:
            net.signal(f"n{k}", to=str(k))
    for source, target in ((0, 1), (1, 2), (2, 2)):
        synapse = rewarded(rng, target) if three else by_pairs(rng)
        low, high = (0, 60) if three else BITS[synapse.sign_mode]
        weight = rng.integers(low, high + 1, sizes[source] * sizes[target]).astype(float)
        delay = float(rng.integers(1, 6))
        rule = neuro.all_to_all()
        net.connect(str(source), str(target), rule, synapse, weight=weight, delay=delay, name=f"{source}{target}")
    signals = {int(k): rng.uniform(-0.03, 0.03, sizes[1:].max()) for k in rng.choice(STEPS, 6, replace=False)}
    return net, signals if three else {}


def in_registers(rng: np.random.Generator) -> Neuron:
    """A neuron that often fires."""
    words = {"du": int(rng.choice([0, 4095, 700])), "dv": int(rng.choice([0, 1, 4096, 300]))}
    return neuro.loihi2_lif(**words, bias_mant=int(rng.integers(0, 4096)), bias_exp=2, vth=int(rng.integers(1, 600)))


def described(rng: np.random.Generator) -> Neuron:
    """A neuron in mV that often fires."""
    words = {"E_L": 0.0, "V_reset": 0.0, "V_th": 20.0, "t_ref": 0.0, "tau_m": 20.0, "I_e": float(rng.integers(0, 600))}
    return (neuro.iaf_psc_exp if rng.random() < 0.5 else neuro.iaf_psc_delta)(**words)


def by_pairs(rng: np.random.Generator) -> Synapse:
    """A rule of two factors in registers."""
    every = int(rng.integers(0, 3))
    words = {word: drawn_sum(rng, every, 3) for word in ("dw", "dt")}
    words |= {f"{trace}_impulse": int(rng.integers(1, 128)) for trace in ("x1", "x2", *POST)}
    words |= {f"{trace}_tau": int(rng.integers(40)) for trace in ("x1", "x2", *POST)}
    words |= {"epoch": int(rng.choice([1, 2, 5])), "sign_mode": str(rng.choice(list(BITS)))}
    words |= {"weight_exp": int(rng.integers(-4, 5)), "num_weight_bits": int(rng.integers(4, 9))}
    return neuro.loihi2_learning(**words, rng_seed=int(rng.choice([-1, 7])))


def rewarded(rng: np.random.Generator, target: int) -> Synapse:
    """A rule of three factors in units of the language."""
    words = {word: float(rng.uniform(low, high)) for word, low, high in TAUS}
    words |= {"A_plus": float(rng.uniform(0.3, 2.0)), "A_minus": float(rng.uniform(-0.5, 1.5))}
    return neuro.stdp_dopa(**words, b=float(rng.uniform(-0.01, 0.01)), Wmax=120.0, signal=f"n{target}")


TAUS = (("tau_plus", 5.0, 40.0), ("tau_c", 20.0, 60.0), ("tau_n", 20.0, 60.0))


class Synapses:
    """A projection that learns: lava's engine, synapse by synapse."""

    def __init__(self, net: neuro.Network, seed: int, part, wires, shape: tuple[int, int]) -> None:
        self.rule, self.name, self.seed, self.shape = wires.rule, part.name, seed, shape
        self.w = [[int(w) for w in row] for row in np.broadcast_to(wires.mantissas, part.size).reshape(shape)]
        self.t = [[0] * shape[1] for _ in range(shape[0])]
        self.exponent, self.lag, self.n_scale = wires.exponent, int(wires.lag[0]), wires.n_scale
        self.low, self.high = BITS[wires.sign_mode]
        self.x = [{"x1": 0, "x2": 0} for _ in range(shape[0])]
        self.y = [dict.fromkeys(POST, 0) for _ in range(shape[1])]
        self.tx, self.ty = [0] * shape[0], [0] * shape[1]
        traces, own = self.rule.traces, -1
        self.impulse = {name: trace.impulse for name, trace in traces.items()}
        if self.rule.outgoing is None:
            numbers = part.synapse.parameters()
            self.keep = {n: exp(-1 / numbers[f"{n}_tau"]) if numbers[f"{n}_tau"] else 0.0 for n in ("x1", "x2", *POST)}
            own = numbers["rng_seed"]
        else:
            self.keep = {name: exp(-1 / traces[name].tau) for name in ("x1", "x2") if name in traces}
            self.keep |= dict.fromkeys(POST, exp(-1 / 65535))
            self.neurons = [dict.fromkeys(POST, 0) for _ in range(shape[1])]
        seeds = [keyed_random.key(seed, purpose, part.name) for purpose in "xyw"] if own < 0 else [own, own + 2, 2]
        self.draws = [np.random.default_rng(each) for each in seeds]
        self.drawn = [each.random() for each in self.draws]

    def sent(self, fired: list[int]) -> list[int]:
        """What arrives at each target for the spikes of a step."""
        total = [sum(self.w[i][j] for i in fired) for j in range(self.shape[1])]
        e = self.exponent
        return [v << e if e > 0 else v >> -e for v in total]

    def step(self, k: int, pre: list[int], post: list[int]) -> None:
        """Learn in a step."""
        now = (k - 1) % self.rule.epoch + 1
        if self.rule.outgoing is not None:
            self.send(k)
        for sides, times, ids in ((self.x, self.tx, pre), (self.y, self.ty, post)):
            for i in ids:
                if times[i] and (sides is self.x or self.rule.outgoing is None):
                    self.rise(sides[i])
                times[i] = now
        for n in (0, 0, 1, 1):
            self.drawn[n] = self.draws[n].random()
        if now == self.rule.epoch:
            self.drawn[2] = self.draws[2].random()
            self.end(k // self.rule.epoch)
        if self.rule.outgoing is not None:
            for j in post:
                self.neurons[j]["y1"] = min(127, self.neurons[j]["y1"] + self.impulse.get("y1", 0))

    def rise(self, traces: dict[str, int]) -> None:
        """Add the impulses of a spike."""
        for name in traces:
            traces[name] = min(127, traces[name] + self.impulse.get(name, 0))

    def send(self, k: int) -> None:
        """Let the neurons' own traces decay, and send y1, y2 and y3."""
        for j, traces in enumerate(self.neurons):
            for name in traces:
                if name in self.rule.traces:
                    trace = self.rule.traces[name]
                    whole, rest = divmod(traces[name] * trace.numerator, trace.denominator)
                    traces[name] = whole + (rest > 0 and self.of(name, k, j, trace.denominator) < rest)
                else:
                    traces[name] = 0
            amount = 128 * (traces["y2"] - traces["y3"]) - self.rule.outgoing.baseline
            draw = keyed_random.uniform(keyed_random.key(self.seed, "n", self.name), k, np.array([j]))[0]
            level = 8 * min(15, floor(abs(amount) / 2 ** (self.rule.outgoing.shift + 7) + draw))
            self.y[j] = {"y1": traces["y1"], "y2": level * (amount > 0), "y3": level * (amount < 0)}

    def of(self, purpose: str, k: int, j: int, below: int) -> int:
        """A whole number below some."""
        u = keyed_random.uniform(keyed_random.key(self.seed, purpose, self.name), k, np.array([j]))[0]
        return (int(u * 2.0**32) * below) >> 32

    def set(self, values: np.ndarray) -> None:
        """Set n of all targets."""
        for traces, value in zip(self.neurons, values, strict=False):
            units = int(np.rint(value / self.n_scale))
            traces["y2"], traces["y3"] = min(127, max(0, units)), min(127, max(0, -units))

    def history(self, traces: dict[str, int], time: int, draw: float, adds: bool) -> list[dict[str, int]]:
        """Return the traces of a neuron at the beginning and after each step of the epoch."""
        found = [traces]
        for at in range(1, self.rule.epoch + 1):
            left = {name: self.keep.get(name, 0.0) * v for name, v in found[-1].items()}
            found.append({name: floor(v) + (draw < v % 1) for name, v in left.items()})
            if at == time and adds:
                self.rise(found[-1])
        return found

    def end(self, number: int) -> None:
        """Apply the rule at the end of an epoch."""
        two = self.rule.outgoing is None
        xs = [self.history(*each, self.drawn[0], True) for each in zip(self.x, self.tx, strict=True)]
        ys = [self.history(*each, self.drawn[1], two) for each in zip(self.y, self.ty, strict=True)]
        for i, j in np.ndindex(self.shape):
            w, t = self.w[i][j], self.t[i][j]
            at = {"x0": self.tx[i], "y0": self.ty[j], "u": self.rule.epoch}
            values = {"x0": int(self.tx[i] > 0), "y0": int(self.ty[j] > 0), "w": w, "t": t}
            of = {gate: values | xs[i][k] | ys[j][k] for gate, k in at.items()}
            self.w[i][j] = self.changed(self.rule.dw, w, number, at, of, self.low, self.high)
            self.t[i][j] = self.changed(self.rule.dt, t, number, at, of, -257, 255)
        self.x = [each[-1] for each in xs]
        if two:
            self.y = [each[-1] for each in ys]
        self.tx, self.ty = [0] * self.shape[0], [0] * self.shape[1]

    def changed(self, terms, value: int, number: int, at: dict, of: dict, low: int, high: int) -> int:
        """Return a weight or a tag after its sum of products."""
        total = value << 7
        for term in terms:
            if not at[term.gate] or number % 2**term.every:
                continue
            product, bits = 1, 4
            for factor in term.factors:
                width = WIDTHS.get(factor.name, 7)
                bits += width
                product *= min(2**width - 1, max(-(2**width), of[term.gate][factor.name] + factor.add))
                product = (product + 2**31) % 2**32 - 2**31
            product = (product * term.mantissa + 2**31) % 2**32 - 2**31
            product = (((product >> max(0, bits - 15)) << (term.exponent + 7)) + 2**31) % 2**32 - 2**31
            total = min(32767, max(-32769, total + min(32767, max(-32769, product))))
        total = max(0, total) if low == 0 else min(0, total) if high == 0 else total
        return min(high, max(low, (total >> 7) + (self.drawn[2] < (total % 128) / 128)))


def twin(net: neuro.Network, signals: dict[int, np.ndarray], seed: int):
    """Yield after each step the weights and tags of each projection, and who has fired in each population."""
    program = neuro.compile(net, "loihi2", seed=seed).program
    fixed = quantise(program, chip("loihi2"))
    sizes = [part.size for part in program.populations]
    learning = [
        Synapses(net, seed, part, wires, (sizes[part.source], sizes[part.target]))
        for part, wires in zip(program.projections, fixed.projections, strict=True)
    ]
    times = net.populations["0"].model.spike_times
    states = [{name: np.zeros(n, dtype=np.int64) for name in ("u", "v")} for n in sizes]
    words = [{"reset_interval": 0, **cells.registers} for cells in fixed.populations]
    due = [np.zeros((STEPS + 80, n), dtype=np.int64) for n in sizes]
    for k in range(1, STEPS + 1):
        fired = [[i for i, each in enumerate(times) if float(k) in each]]
        for p in (1, 2):
            out, states[p] = step("loihi2_lif", words[p], np.array([due[p][k], due[p][k]]), states[p], k)
            fired.append(np.flatnonzero(out).tolist())
        for part, synapses in zip(program.projections, learning, strict=True):
            due[part.target][k + synapses.lag] += synapses.sent(fired[part.source])
            synapses.step(k, fired[part.source], fired[part.target])
            if k in signals:
                synapses.set(signals[k])
        yield [(synapses.w, synapses.t) for synapses in learning], fired
