"""SpiNNaker's neurons and learning once more, in plain integers of Python, slow and without any array.

A synapse keeps all events of its post neuron that are still in the history; nothing is shared with the kernels.
`network` draws networks that learn, with their extremes, and `Learning` is the twin of one.
"""

import math
from dataclasses import replace

import numpy as np

import neuro
from neuro.model.synapses import stdp, stdp_dopa, stdp_nn_restr, stdp_nn_symm, stdp_triplet, vogels_sprekeler

ONE, ENTRIES = 2048, 16


def low(x, bits):
    """The low bits of a number, signed."""
    x &= (1 << bits) - 1
    return x - (1 << bits) if x >> (bits - 1) else x


def cut(x):
    """The low 32 bits, signed."""
    return low(x, 32)


def fine(a, b):
    return low(a, 16) * low(b, 16) >> 11


def product(a, b):
    """s16.15, floor."""
    return a * b >> 15


def scaled(a, s):
    return cut(product(a, 16 * s))


class Table:
    """What an exponential leaves after some ticks, in s4.11."""

    def __init__(self, tau, shift=0):
        self.tau, self.shift = tau, shift
        self.length = 2 * math.ceil(math.log(2048) * tau / 2**shift / 2)

    def __call__(self, ticks):
        k = ticks >> self.shift
        return math.floor(2048 * math.exp(-(k << self.shift) / self.tau)) if 0 <= k < self.length else 0


class Windows:
    """Windows of the recurrent rule, drawn by the generator that all cores begin with."""

    def __init__(self, draws, mean):
        self.draws, self.mean = draws, mean

    def draw(self):
        a, b, c, d = self.draws
        a = (314527869 * a + 1234567) % 2**32
        b ^= (b << 5) % 2**32
        b ^= b >> 7
        b ^= (b << 22) % 2**32
        d, c = divmod(4294584393 * c + d, 2**32)
        self.draws[:] = a, b, c, d
        return math.floor(-self.mean * math.log(1.0 - (a + b + c) % 2**32 % 2048 / 2048))


class Neuron:
    """A post neuron: the last 15 events as [tick, o1, o2, spike, dopamine], and which are dopamine."""

    def __init__(self, rule):
        self.rule = rule
        self.entries, self.marks = [[0, 0, 0, 0, 0]], [False]

    def append(self, t, concentration=None):
        then, o1, o2, spike, level = self.entries[-1]
        rule = self.rule
        if rule.timing == "recurrent":
            new = [t, rule.minus.draw(), 0, 0, 0]
        else:
            new = [t, fine(o1, rule.minus(t - then)) + ONE * (concentration is None), o2, spike, 0]
        if rule.timing == "nearest":
            new[1] = 0
        if rule.timing == "triplet":
            new[2] = fine(o2 + ONE, rule.y(t - spike)) if spike else fine(o2, rule.y(t - then))
            new[3] = t
        if rule.taught:
            new[4] = low(fine(level, rule.d(t - then)) + (concentration or 0), 16)
        new[1] = low(new[1], 16)
        if len(self.entries) == ENTRIES:
            del self.entries[1]
            self.marks = [*self.marks[1:], False][:-1]
        self.entries.append(new)
        self.marks.append(concentration is not None)


class Rule:
    """Constants of a rule, in integers, and its tables."""

    def __init__(self, timing, multiplicative, taus, **numbers):
        self.timing, self.multiplicative, self.taught = timing, multiplicative, "c" in taus
        shifts = {"plus": 0, "minus": 0, "x": 2, "y": 2, "c": 4, "d": 2}
        for name, tau in taus.items():
            setattr(self, name, Table(tau, shifts[name]))
        if timing == "recurrent":
            draws = [123456789, 234567891, 345678912, 456789123]
            self.plus, self.minus = Windows(draws, taus["plus"]), Windows(draws, taus["minus"])
        for name in ("low", "high", "up", "down", "up3", "down3", "alpha", "least", "most", "gain", "w_low", "w_high"):
            setattr(self, name, numbers.get(name, 0))

    def pot(self, w, x, x3=0):
        if self.multiplicative:
            return low(w + scaled(cut(product(cut(self.high - w), self.up)), x), 32)
        return min(low(w + scaled(self.up, x) + scaled(self.up3, x3), 32), self.high)

    def dep(self, w, x, x3=0):
        if self.multiplicative:
            return low(w - scaled(cut(product(cut(w - self.low), self.down)), x), 32)
        return max(low(w - scaled(self.down, x) - scaled(self.down3, x3), 32), self.low)


class Row:
    """A source: its last packet, its traces and its synapses as [neuron, delay, word, tag]."""

    def __init__(self, rule, synapses):
        self.rule, self.synapses, self.last, self.r1, self.r2 = rule, synapses, 0, 0, 0

    def packet(self, t, neurons, shift):
        rule, p, r1 = self.rule, self.last, self.r1
        if rule.timing == "recurrent":
            self.r1 = rule.plus.draw()
        else:
            self.r1 = 0 if rule.timing == "nearest" else low(fine(r1, rule.plus(t - p)) + ONE, 16)
        if rule.timing == "triplet":
            self.r2 = low(fine(self.r2 + ONE, rule.x(t - p)), 16) if p else 0
        self.last = t
        for synapse in self.synapses:
            self.update(synapse, neurons[synapse[0]], t, p, r1, shift)

    def update(self, synapse, neuron, t, p, r1, shift):
        rule, d = self.rule, synapse[1]
        entries, n = neuron.entries, len(neuron.entries)
        first, last = max(p - d, 0), max(t - d, 0)
        before = max([k for k in range(1, n) if entries[k][0] <= first], default=0)
        window = [k for k in range(before + 1, n) if entries[k][0] <= last]
        w, c, level, at = synapse[2] << shift, synapse[3] << shift, 0, p
        value = c if rule.taught else w

        def elapse(w, c, until):
            left = rule.c(until - at)
            if level:
                lost = low(fine(left, rule.d(until - at)) - ONE, 16)
                w = low(w + scaled(scaled(product(c, rule.gain), level), lost), 32)
            return w, scaled(c, left)

        if rule.taught and before:
            level = fine(entries[before][4], rule.d(p - entries[before][0]))
        for place, k in enumerate(window):
            u = entries[k][0] + d
            if rule.taught:
                w, value = elapse(w, value, u)
                at, level = u, entries[k][4]
            slipped = n - len(window) + place
            if rule.timing == "recurrent":
                if u - p < r1:
                    synapse[3] += 1
                    if synapse[3] > rule.most:
                        synapse[3], value = 0, rule.pot(value, ONE)
            elif not (slipped < n and neuron.marks[slipped]):
                x = rule.plus(u - p)
                if rule.timing == "nearest":
                    value = rule.pot(value, x if entries[k - 1][0] <= p and u - entries[k - 1][0] >= u - p else 0)
                else:
                    x = fine(r1, x)
                    value = rule.pot(value, x, fine(x, entries[k][2]) if rule.timing == "triplet" else 0)
        newest = window[-1] if window else before
        if newest:
            if rule.taught:
                w, value = elapse(w, value, t)
            since = t - entries[newest][0] - d
            x = 0 if rule.timing == "recurrent" else rule.minus(since)
            if rule.timing == "recurrent":
                if since < entries[newest][1]:
                    synapse[3] -= 1
                    if synapse[3] < rule.least:
                        synapse[3], value = 0, rule.dep(value, ONE)
            elif rule.timing == "nearest":
                value = rule.dep(value, x)
            else:
                x = fine(entries[newest][1], x)
                if rule.timing == "vogels":
                    value = rule.pot(value, x - rule.alpha)
                else:
                    value = rule.dep(value, x, fine(x, self.r2) if rule.timing == "triplet" else 0)
        if rule.taught:
            synapse[2] = (min(max(w, rule.w_low), rule.w_high) >> shift) & 65535
            synapse[3] = (value >> shift) & 65535
        else:
            synapse[2] = (value >> shift) & 65535


class Neurons:
    """Neurons of SpiNNaker as dictionaries of Python integers."""

    def __init__(self, registers, shifts, synapses, delta=False):
        self.r, self.shifts, self.synapses, self.delta = registers, shifts, synapses, delta
        self.v = [r["v_init"] for r in registers]
        self.g = [[0, 0] for _ in registers]
        self.held = [0] * len(registers)
        self.ring: dict[tuple[int, int, int], int] = {}

    def run(self, spikes, ticks):
        rows = []
        for t in range(ticks):
            states = [self.tick(t, i) for i in range(len(self.r))]
            for kind, pre, post, add, delay in self.synapses:
                if pre in spikes[t] if kind == "in" else states[pre][3]:
                    self.send(t + delay, post, abs(add), add < 0)
            rows.append(list(zip(*states, strict=True)))
        names = ("v", "g_exc", "g_inh", "fired")
        return dict(zip(names, (np.array(column) for column in zip(*rows, strict=True)), strict=True))

    def send(self, t, post, word, inhibits):
        """Add a word to a slot."""
        slot = (t, post, int(inhibits))
        self.ring[slot] = min(65535, self.ring.get(slot, 0) + word)

    def tick(self, t, i):
        r, g = self.r[i], self.g[i]
        if self.delta:
            return self.tick_of_delta(t, i, r)
        for k, word in enumerate(("exc", "inh")):
            arrived = self.ring.get((t, i, k), 0) << self.shifts[k]
            g[k] = cut(g[k] + (arrived * r[f"{word}_init"] >> 32))
        used = tuple(g)
        if self.held[i] <= 0:
            alpha = cut(product(cut(g[0] - g[1] + r["i_offset"]), r["r_m"]) + r["v_rest"])
            self.v[i] = cut(alpha - product(r["exp_tc"], cut(alpha - self.v[i])))
        else:
            self.held[i] -= 1
        spike = self.v[i] >= r["v_thresh"]
        if spike:
            self.v[i], self.held[i] = r["v_reset"], r["t_refract"]
        for k, word in enumerate(("exc", "inh")):
            g[k] = cut((g[k] * r[f"{word}_decay"]) >> 32)
        return self.v[i], *used, spike

    def tick_of_delta(self, t, i, r):
        exc, inh = (self.ring.get((t, i, k), 0) << self.shifts[k] for k in (0, 1))
        if self.held[i] > 0:
            self.held[i] -= 1
            return self.v[i], 0, 0, False
        above = product(cut(self.v[i] - r["v_rest"]), r["exp_tc"])
        self.v[i] = cut(r["v_rest"] + above + r["i_offset"] + exc - inh)
        spike = self.v[i] >= r["v_thresh"]
        if spike:
            self.v[i], self.held[i] = r["v_reset"], r["t_refract"]
        return self.v[i], 0, 0, spike


STEPS = 150
"""Ticks of a network."""
RULES = (
    stdp(mu_plus=0.0, mu_minus=0.0),
    stdp(),
    stdp_nn_symm(mu_plus=0.0, mu_minus=0.0),
    stdp_nn_restr(pre_at_start=True),
    stdp_triplet(),
    vogels_sprekeler(),
    stdp_dopa(dopamine="d"),
    stdp_dopa(signal="r"),
)
"""A rule for each program that a network reaches."""


def network(seed):
    """A network of a number, which learns, the values of its signal by step, and the largest of them."""
    rng = np.random.default_rng(seed)
    rule = RULES[seed % len(RULES)]
    net = neuro.Network("learner", resolution=1.0)
    n, m = int(rng.integers(1, 13)), int(rng.integers(1, 6))
    if seed % 11 == 10:  # so many that a neuron has 32 slots, and longer delays are held back
        n, m = 3, 130
    net.population("a", n, neuro.spike_generator(spike_times=patterns(rng, n)))
    net.population("d", 2, neuro.spike_generator(spike_times=patterns(rng, 2)))
    delta = bool(rng.random() < 0.6)
    unit = 1.0 if delta else 150.0
    words = {"tau_m": 15.0, "t_ref": float(rng.integers(0, 3)), "tau_minus": float(rng.uniform(5.0, 60.0))}
    words["I_e"] = float(rng.choice([0.0, 380.0, 420.0, 8000.0]))
    net.population("b", m, (neuro.iaf_psc_delta if delta else neuro.iaf_psc_exp)(**words))
    net.signal("r", to="b")
    synapse, sign = drawn(rng, rule, unit, words["tau_minus"]), -1.0 if isinstance(rule, vogels_sprekeler) else 1.0
    source = "b" if rng.random() < 0.4 else "a"
    ends = sorted((getattr(synapse, "Wmin", 0.0), sign * 6.0 * unit))
    weight = (
        ends[0] if rng.random() < 0.1 else ends[1] if rng.random() < 0.2 else neuro.uniform(low=ends[0], high=ends[1])
    )
    delay = float(rng.choice([1, 2, 3, 4, 7, 8, 16, 31, 32, 40] if m < 130 else [31, 32, 40, 63, 64, 100]))
    delay = neuro.uniform(low=1.0, high=delay + 0.4) if rng.random() < 0.5 else delay
    rules = [neuro.all_to_all(), neuro.fixed_indegree(int(rng.integers(1, 4))), neuro.pairwise_bernoulli(p=0.6)]
    net.connect(source, "b", rules[int(rng.integers(3))], synapse, weight=weight, delay=delay, name="ab")
    net.connect("a", "b", neuro.all_to_all(), weight=3.0 * unit, delay=float(rng.integers(1, 20)), name="static")
    told = {int(k): rng.normal(0.0, 0.02, m) for k in rng.choice(STEPS, 8, replace=False)}
    return net, told if synapse.name == "stdp_dopa" and synapse.dopamine is None else {}


def drawn(rng, rule, unit, tau_minus):
    """A rule with numbers of its own, from slow to one that reaches its bounds with each pair."""
    strength = float(10.0 ** rng.uniform(-1.7, 0.0))
    taus = {name: float(rng.uniform(5.0, 60.0)) for name in ("tau_plus", "tau_plus_triplet", "tau_minus_triplet")}
    numbers = {"Wmax": 6.0 * unit, "lambda_": strength, "alpha": float(rng.uniform(0.3, 1.5)), "eta": strength * unit}
    numbers |= {"tau": tau_minus, "A_plus": strength * unit, "A_minus": strength * unit / 2, "c_min": 0.0}
    numbers |= {"tau_c": float(rng.uniform(20.0, 400.0)), "tau_n": float(rng.uniform(20.0, 100.0))}
    numbers |= {f"A{side}": strength * unit * float(rng.uniform(0.3, 1.0)) for side in ("plus", "minus")}
    numbers |= {f"A{side}_triplet": strength * unit * float(rng.uniform(0.3, 1.0)) for side in ("plus", "minus")}
    if isinstance(rule, vogels_sprekeler):
        numbers["Wmax"] = -numbers["Wmax"]
    if isinstance(rule, stdp_dopa):
        numbers["Wmin"] = float(rng.choice([0.0, unit]))
    return replace(rule, **{name: value for name, value in (taus | numbers).items() if hasattr(rule, name)})


def patterns(rng, n):
    """Spike times of some sources: none, all at once, several in a tick, in each tick, or now and then."""
    kind, ticks = rng.integers(6), np.arange(1.0, STEPS)
    times = [ticks[rng.random(ticks.size) < rng.choice([0.03, 0.2])] for _ in range(n)]
    if kind == 0:
        times = [[]] * n
    elif kind == 1:
        times = [times[0]] * n
    elif kind == 2:
        times = [np.sort(np.concatenate([each, each[::2], each[::3]])) for each in times]
    elif kind == 3:
        times[0] = ticks
    return [[float(t) for t in each] for each in times]


class Learning:
    """A network of `network` as a twin; it takes registers, words and constants from the quantised program.

    Args:
        net: the network.
        program, fixed: compiled and quantised.
    """

    def __init__(self, net, program, fixed):
        self.times = {name: net.populations[name].model.spike_times for name in "ad"}
        self.wires, synapse = fixed.projections[0], program.projections[0].synapse
        self.rule, self.synapse, m = self.wires.rule, synapse, program.populations[2].size
        self.neurons = self.cells(program, fixed, m)
        timing = {"stdp_triplet": "triplet", "vogels_sprekeler": "vogels"}.get(synapse.name, "pair")
        timing = "nearest" if synapse.name.startswith("stdp_nn") else timing
        taus = {"plus": getattr(synapse, "tau_plus", getattr(synapse, "tau", 20.0))}
        taus["minus"] = float(program.populations[2].parameters["tau_minus"][0])
        if timing == "triplet":
            taus |= {"x": synapse.tau_plus_triplet, "y": synapse.tau_minus_triplet}
        if self.rule.concentrations:
            taus |= {"c": synapse.tau_c, "d": synapse.tau_n}
        constants = [int(value) for value in self.rule.constants]
        numbers = dict(zip(("low", "high", "up", "down", "up3", "down3", "alpha"), constants[3:10], strict=True))
        numbers |= dict(zip(("gain", "w_low", "w_high"), constants[12:15], strict=True))
        self.twin = Rule(timing, getattr(synapse, "mu_plus", 0.0) == 1.0, taus, **numbers)
        self.histories = [Neuron(self.twin) for _ in range(m)]
        pre, post = program.connections(0)
        delays, words = (np.broadcast_to(x, pre.size) for x in (self.wires.delay, abs(self.wires.mantissas)))
        ends = zip(post, delays % self.rule.slots, words, strict=True)
        self.synapses = [[int(j), int(d), int(w), 0] for j, d, w in ends]
        self.source = program.populations[program.projections[0].source].name
        self.rows, self.packets = {}, {}
        for i, delay, made in zip(pre, delays, self.synapses, strict=True):
            held = (int(delay) - 1) // self.rule.slots * self.rule.slots
            self.rows.setdefault((held, int(i)), Row(self.twin, [])).synapses.append(made)

    def cells(self, program, fixed, m):
        """The neurons and the static synapses onto them."""
        cells, wires = fixed.populations[2], fixed.projections[1]
        words = {name: np.broadcast_to(values, m) for name, values in cells.registers.items()}
        words["v_init"] = np.broadcast_to(cells.initial["v"], m)
        registers = [{name: int(values[i]) for name, values in words.items()} for i in range(m)]
        ends = (
            *program.connections(1),
            *(np.broadcast_to(x, m * len(self.times["a"])) for x in (wires.words, wires.delay)),
        )
        static = [("in", *(int(x) for x in each)) for each in zip(*ends, strict=True)]
        shifts = [int(cells.registers[name][0]) for name in ("exc_shift", "inh_shift")]
        return Neurons(registers, shifts, static, delta=cells.kind == "spinnaker_delta")

    def step(self, k):
        """Take a step, from 1; return who has fired."""
        t, cells = k - 1, self.neurons
        fired = {
            name: [i for i, each in enumerate(times) for at in each if at == k] for name, times in self.times.items()
        }
        fired["b"] = [i for i in range(len(self.histories)) if cells.tick(t, i)[3]]
        for _, i, j, word, delay in cells.synapses:
            for _ in range(fired["a"].count(i)):
                cells.send(t + delay, j, abs(word), word < 0)
        for _ in fired["d"] if self.rule.concentrations and self.synapse.dopamine is not None else ():
            for history in self.histories:
                history.append(t, self.rule.concentrations[0])
        for j in fired["b"]:
            self.histories[j].append(t)
        for held, i in self.rows:
            self.packets.setdefault(t + held, []).extend([(held, i)] * fired[self.source].count(i))
        for key in sorted(self.packets.pop(t, ())):
            self.rows[key].packet(t, self.histories, self.rule.shift)
            for j, delay, word, _ in self.rows[key].synapses:
                if delay:
                    cells.send(t + delay, j, word, self.rule.inhibits)
        return fired

    def signal(self, k, values):
        """Bring dopamine to some values after k steps, by spikes of reward and punishment."""
        unit = self.rule.concentrations[0]
        for history, value in zip(self.histories, values, strict=True):
            then, *_, level = history.entries[-1]
            missing = round((value / self.wires.n_scale - (level * self.twin.d(k - then) >> 11)) / unit)
            for bit in range(5):
                if min(abs(missing), 31) >> bit & 1:
                    history.append(k, (unit << bit) * (1 if missing > 0 else -1))
