"""Loihi's compartments and learning engine once more, in plain numbers of Python, slow and without any array.

`network` draws networks that learn, with their extremes, and `Learning` is the twin of one.
"""

from fractions import Fraction

import numpy as np

import neuro
from make_sums import drawn_sum
from neuro.chips.loihi_registers import bounds, grain_of
from neuro.core import keyed_random
from neuro.model.synapses.loihi_registers import SIGN_MODES
from neuro.model.synapses.loihi_rule import MODULATORY, POST, PRE, Factor, Term, Trace
from spinnaker_twin import patterns


def loihi_word(m: int, weight_exp: int, num_weight_bits: int, sign_mode: str) -> int:
    """What a spike adds to u: the lowest bits of |m| are dropped, m is shifted (floor), then x 64 and clipped."""
    lost = 8 - num_weight_bits + (sign_mode == "mixed")
    kept = (abs(m) >> lost) << lost
    kept = kept if m >= 0 else -kept
    shifted = kept * 2**weight_exp if weight_exp >= 0 else kept // 2**-weight_exp
    return max(-(2**21) + 64, min(2**21 - 64, shifted * 64))


def decayed(x: int, keep: int) -> int:
    """x keep / 4096, cut towards 0."""
    return (1 if x >= 0 else -1) * ((abs(x) * keep) >> 12)


def wrapped(x: int, bits: int) -> int:
    """x as a two's complement of so many bits."""
    return (x + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)


class Compartments:
    """Compartments as dictionaries of Python integers, which cannot overflow."""

    def __init__(self, registers: list[dict[str, int]], synapses: list[tuple[str, int, int, int, int]]):
        self.r, self.synapses = registers, synapses
        self.u, self.v, self.held = ([0] * len(registers) for _ in range(3))
        self.due: dict[int, list[tuple[int, int]]] = {}

    def run(self, spikes, steps: int):
        """States and spikes of steps 0..; `spikes` are the sources that spike in each step."""
        rows = []
        for k in range(steps):
            fired = [self.step(k, i) for i in range(len(self.r))]
            for kind, pre, post, add, delay in self.synapses:
                if pre in spikes[k] if kind == "in" else fired[pre]:
                    self.due.setdefault(k + 1 + delay, []).append((post, add))
            rows.append((list(self.u), list(self.v), fired))
        return dict(zip(("u", "v", "fired"), (np.array(column) for column in zip(*rows, strict=True)), strict=True))

    def step(self, k: int, i: int) -> bool:
        r = self.r[i]
        arrived = wrapped(sum(add for post, add in self.due.get(k, ()) if post == i), 22)
        self.u[i] = wrapped(decayed(self.u[i], 4096 - (r["du"] + 1)) + arrived, 24)
        drive = wrapped(self.u[i] + r["bias_mant"] * 2 ** r["bias_exp"], 24)
        v = decayed(self.v[i], 4096 - r["dv"]) + drive
        v = max(-(2**23) + 1, min(2**23 - 1, v))
        if self.held[i]:
            self.held[i], v = self.held[i] - 1, 0
        spike = v > r["vth"] * 64
        self.v[i] = 0 if spike else v
        if spike:
            self.held[i] = r["refractory"] - 1
        return spike


def cut(x: Fraction) -> Fraction:
    """Towards 0 to 2^-7."""
    return Fraction(int(abs(x) * 128), 128) * (1 if x > 0 else -1)


def held(x: Fraction) -> Fraction:
    return min(Fraction(32767, 128), max(Fraction(-256), x))


class Engine:
    """The learning engine with dictionaries and fractions; draws are those of `neuro.core.keyed_random`."""

    def __init__(self, rule, n_source, n_target, pairs, weights, bits, mode, seed, name):
        self.rule, self.seed, self.name, self.pairs = rule, seed, name, pairs
        self.w, self.t = [int(w) for w in weights], [0] * len(pairs)
        self.step_of_weight, self.bounds = grain_of(bits, mode == "mixed"), bounds(mode)[:2]
        sizes = {**dict.fromkeys(PRE, n_source), **dict.fromkeys((*POST, *MODULATORY), n_target)}
        self.trace = {name: [0] * size for name, size in sizes.items()}
        self.past: list[dict[str, list[int]]] = []
        self.fired: tuple[dict[int, int], dict[int, int]] = ({}, {})

    def draw(self, purpose, step, index, below):
        u = keyed_random.uniform(keyed_random.key(self.seed, purpose, self.name), step, np.array([index]))[0]
        return (int(u * 2.0**32) * below) >> 32

    def step(self, step, pre, post):
        for name, values in self.trace.items():
            trace = self.rule.traces.get(name, Trace(0, 0, 1))
            for i, v in enumerate(values):
                whole, rest = divmod(v * trace.numerator, trace.denominator)
                values[i] = whole + bool(rest and self.draw(name, step, i, trace.denominator) < rest)
            ids = pre if name in PRE else post if name in POST else ()
            for i in ids:
                values[i] = min(127, values[i] + trace.impulse)
        self.past.append({name: list(values) for name, values in self.trace.items()})
        for fired, ids in zip(self.fired, (pre, post), strict=True):
            fired.update(dict.fromkeys(map(int, ids), len(self.past) - 1))
        if step % self.rule.epoch == 0:
            for e, (i, j) in enumerate(self.pairs):
                self.learn(step, e, i, j)
            self.past, self.fired = [], ({}, {})

    def value(self, factor: Factor, e, i, j, at):
        name = factor.name
        known = {"w": self.w[e], "t": self.t[e], "x0": i in self.fired[0], "y0": j in self.fired[1]}
        if name in known:
            return int(known[name]) + factor.add
        return self.past[-1 if name in MODULATORY else at][name][i if name in PRE else j] + factor.add

    def change(self, terms: tuple[Term, ...], value, step, e, i, j):
        total = Fraction(value)
        for term in terms:
            at = {"x0": self.fired[0].get(i), "y0": self.fired[1].get(j), "u": self.rule.epoch - 1}[term.gate]
            if at is None or (step // self.rule.epoch) % 2**term.every:
                continue
            product = Fraction(term.mantissa) * Fraction(2) ** term.exponent
            for factor in term.factors:
                product *= self.value(factor, e, i, j, at)
            total = held(total + held(cut(product)))
        return total - value

    def rounded(self, delta, size, purpose, step, e):
        if self.rule.rounding == "away" and purpose == "w":
            whole = -(-abs(delta) // 1)
            return int(whole // size) * size * (1 if delta > 0 else -1)
        whole, rest = divmod(delta, size)
        units = int(rest * 128)
        return (int(whole) + bool(units and self.draw(purpose, step, e, size * 128) < units)) * size

    def learn(self, step, e, i, j):
        dw = self.change(self.rule.dw, self.w[e], step, e, i, j)
        dt = self.change(self.rule.dt, self.t[e], step, e, i, j)
        if dw:
            low, high = self.bounds
            self.w[e] = min(high, max(low, self.w[e] + self.rounded(dw, self.step_of_weight, "w", step, e)))
        if dt:
            self.t[e] = min(255, max(-256, self.t[e] + self.rounded(dt, 1, "t", step, e)))

    def modulate(self, values):
        """Set r1 and r2 of all targets to the positive and the negative part of n, in units of the traces."""
        for name, sign in zip(MODULATORY, (1, -1), strict=True):
            self.trace[name] = [int(min(127, max(0, np.rint(sign * v)))) for v in values]

    def release(self, targets):
        """Dopamine spikes reach some targets, each as often as it is listed."""
        for j in targets:
            self.trace["r1"][j] = min(127, self.trace["r1"][j] + self.rule.traces["r1"].impulse)


STEPS = 100
"""Steps of a network."""


def network(seed):
    """A network of a number, with two projections that learn, and the values of its signal by step."""
    rng = np.random.default_rng(seed)
    net = neuro.Network("learner", resolution=1.0)
    n, m = int(rng.integers(1, 8)), int(rng.integers(1, 5))
    net.population(
        "a", n, neuro.spike_generator(spike_times=[[t for t in each if t < STEPS] for each in patterns(rng, n)])
    )
    net.population(
        "d", 2, neuro.spike_generator(spike_times=[[t for t in each if t < STEPS] for each in patterns(rng, 2)])
    )
    if seed % 3:
        words = {"V_reset": 0.0, "E_L": 0.0, "V_th": 20.0, "t_ref": 0.0, "I_e": float(rng.choice([0.0, 300.0, 8000.0]))}
        cells = (neuro.iaf_psc_delta if rng.random() < 0.5 else neuro.iaf_psc_exp)(**words)
        unit = 5.0 if cells.name == "iaf_psc_delta" else 600.0
    else:
        words = {"du": int(rng.choice([0, 700, 4095])), "dv": int(rng.choice([0, 300, 4095])), "vth": 500}
        cells, unit = neuro.loihi_lif(**words, bias_mant=int(rng.choice([0, 900, 4095])), refractory=2), 1.0
    net.population("b", m, cells)
    net.signal("r", to="b")
    told = {}
    for k, name in enumerate(("ab", "bb")):
        synapse, ends = by_pairs(rng, k, unit) if seed % 3 else in_registers(rng)
        if k == 0 and synapse.name == "stdp_dopa" and synapse.dopamine is None:
            told = {int(at): rng.normal(0.0, 0.03, m) for at in rng.choice(STEPS, 8, replace=False)}
        low, high = (round(end) if unit == 1.0 else end for end in ends)
        weight = rng.uniform(low, high, (n, m)[k] * m) if rng.random() < 0.7 else np.full((n, m)[k] * m, float(high))
        weight = np.trunc(weight / 2.0) * 2.0 if unit == 1.0 else weight
        delay = float(rng.choice([1, 2, 7, 40]))
        net.connect(name[0], "b", neuro.all_to_all(), synapse, weight=weight, delay=delay, name=name)
    return net, told


def by_pairs(rng, k, unit):
    """A rule in units of the language, and bounds of its weights; the second projection has no dopamine."""
    words = {"tau_plus": float(rng.uniform(5.0, 40.0)), "Wmax": 4.0 * unit}
    if k or rng.random() < 0.3:
        mu = float(rng.integers(0, 2))
        rule = neuro.stdp(**words, lambda_=float(rng.uniform(0.02, 0.5)), mu_plus=mu, mu_minus=mu)
        return rule, (0.0, words["Wmax"])
    words |= {"A_plus": float(rng.uniform(0.3, 2.0)) * unit, "A_minus": float(rng.uniform(-0.5, 1.5)) * unit}
    words |= {"tau_c": float(rng.uniform(20.0, 200.0)), "tau_n": float(rng.uniform(20.0, 100.0))}
    dopamine = {"signal": "r"} if rng.random() < 0.5 else {"dopamine": "d", "dopamine_delay": float(rng.integers(1, 5))}
    return neuro.stdp_dopa(**words, **dopamine, b=float(rng.uniform(-0.01, 0.01))), (0.0, words["Wmax"])


def in_registers(rng):
    """A rule in registers, and the bounds of its mantissas."""
    words = {word: drawn_sum(rng, int(rng.integers(0, 3)), 3).replace("2^8", "2^7") for word in ("dw", "dt")}
    words |= {f"{trace}_impulse": int(rng.integers(1, 128)) for trace in (*PRE, *POST)}
    words |= {f"{trace}_tau": int(rng.integers(1, 40)) for trace in (*PRE, *POST)}
    words |= {"epoch": int(rng.choice([1, 2, 5])), "sign_mode": str(rng.choice(SIGN_MODES))}
    words |= {"weight_exp": int(rng.integers(-4, 5)), "num_weight_bits": int(rng.integers(4, 9))}
    words |= {"trace_decay": str(rng.choice(["first_order", "exponential"]))}
    words |= {"rounding": str(rng.choice(["stochastic", "away"]))}
    return neuro.loihi_learning(**words), bounds(words["sign_mode"])[:2]


class Learning:
    """A network of `network` as a twin; it takes registers, mantissas and rules from the quantised program.

    Args:
        net: the network.
        program, fixed: compiled and quantised.
    """

    def __init__(self, net, program, fixed):
        self.times = {name: net.populations[name].model.spike_times for name in "ad"}
        self.parts, self.wires, m = program.projections, fixed.projections, program.populations[2].size
        cells = fixed.populations[2]
        words = {name: np.broadcast_to(values, m) for name, values in cells.registers.items()}
        registers = [{name: int(values[i]) for name, values in words.items()} for i in range(m)]
        self.cells, self.engines, self.due = Compartments(registers, []), [], {}
        for index, (part, wires) in enumerate(zip(self.parts, self.wires, strict=True)):
            pairs = [*zip(*(each.tolist() for each in program.connections(index)), strict=True)]
            sizes = program.populations[part.source].size, m
            mantissas = np.broadcast_to(wires.mantissas, len(pairs))
            said = wires.rule, *sizes, pairs, mantissas, wires.bits, wires.sign_mode, program.seed, part.name
            self.engines.append(Engine(*said))

    def step(self, k):
        """Take a step, from 1; return who has fired."""
        fired = {name: [i for i, each in enumerate(times) if k in each] for name, times in self.times.items()}
        fired["b"] = [i for i in range(len(self.cells.r)) if self.cells.step(k, i)]
        for part, wires, engine in zip(self.parts, self.wires, self.engines, strict=True):
            pre = fired[part.name[0]]
            delays = np.broadcast_to(wires.delay, len(engine.pairs))
            for (i, j), w, delay in zip(engine.pairs, engine.w, delays, strict=True):
                if i in pre:
                    word = loihi_word(w, wires.exponent, wires.bits, wires.sign_mode)
                    self.cells.due.setdefault(k + 1 + int(delay), []).append((j, word))
            engine.step(k, pre, fired["b"])
            if part.dopamine >= 0:
                self.due.setdefault(k + part.dopamine_delay, []).extend([*range(len(self.cells.r))] * len(fired["d"]))
                engine.release(self.due.pop(k, ()))
        return fired
