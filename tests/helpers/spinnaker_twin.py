"""SpiNNaker's learning and delta neurons once more, in plain integers of Python, slow and without any array.

A synapse keeps all events of its post neuron that are still in the history; nothing is shared with the kernels.
"""

import math

ONE, ENTRIES = 2048, 16


def low(x, bits):
    """The low bits of a number, signed."""
    x &= (1 << bits) - 1
    return x - (1 << bits) if x >> (bits - 1) else x


def fine(a, b):
    return low(a, 16) * low(b, 16) >> 11


def product(a, b):
    return low(a * b >> 15, 32)


def scaled(a, s):
    return product(a, 16 * s)


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
            return low(w + scaled(product(low(self.high - w, 32), self.up), x), 32)
        return min(low(w + scaled(self.up, x) + scaled(self.up3, x3), 32), self.high)

    def dep(self, w, x, x3=0):
        if self.multiplicative:
            return low(w - scaled(product(low(w - self.low, 32), self.down), x), 32)
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
                    value = rule.pot(value, x if entries[k - 1][0] <= p - 0 and u - entries[k - 1][0] >= u - p else 0)
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
