"""The learning engines of Loihi: microcode that visits the synapses of neurons that fired and changes weight and tag.

`microcode` builds the kernel of a family from the functions in which Loihi 1 and 2 differ: a product, the base of an
epoch's random draws, and the rounding of a sum.

Loihi 2 follows lava, which calls its rules "bit approximate":

* Each factor is clipped to its bits and signed. The product of the factors, of 32 bits, is multiplied by the scale's
  mantissa, shifted down by its largest possible excess over 15 bits, shifted up by the exponent + 7, and clipped.
* Weight and tag have 7 fractional bits in the sum of the products. A single random number rounds all sums of an epoch.

Loihi 1, in each step: every trace decays, spikes add their impulses, and at the end of an epoch the rule is applied.

* A trace v becomes v numerator / denominator, rounded up with the probability of the fraction. A spike then adds the
  impulse, up to 127. The rule therefore reads traces with the impulses of the same step (Brian2Loihi and lava agree).
* A product gated by x0 reads all traces at the step of the epoch's last pre spike, a product gated by y0 at the step of
  its last post spike, and a product gated by u_k at the end of the epoch (lava). With epochs of one step all three are
  equal. r1 and r2, which come from outside, are read at the end of the epoch.
* dw and dt are computed from the values before either change is applied (both references agree).
* A product is scaled exactly, truncated towards 0 to multiples of 2^-7 of a mantissa, clipped to 16 bits, and added to
  the variable in a 16-bit accumulator that saturates (lava). The sum is rounded once, by a keyed draw, to the
  resolution of the weight (`AWAY`: see `LearningRule.rounding`), and the weight is clipped to the range of its sign
  mode.

Differences between the references:
* Decay per step: 1 - 1/tau in Brian2Loihi (the default of `loihi_learning`), exp(-1/tau) in lava. Both are available.
* Draws: Brian2Loihi draws for each synapse and trace, from the fraction of the value before the impulse. lava draws a
  single number for all neurons and traces. Here each neuron and trace has its own draw, from the fraction of its own
  value.
* Changes below a mantissa: Brian2Loihi rounds away from 0. It then rounds products of spikes towards 0 to the weight's
  step, because its draw is made before the spikes arrive. lava rounds stochastically from 7 bits. Here: `rounding`.
* Products of several factors: lava drops low bits without compensation, so that its scale differs from that of the
  rule. Brian2Loihi keeps fractions. Here the scale is exact, and bits below 2^-7 are truncated.
* Several spikes of a neuron in an epoch: lava moves all but the last to the beginning of the epoch. Here each acts at
  its own step.
* Delays: Brian2Loihi delays x0, x1 and x2 together with the current; lava learns without delays. Here traces are not
  delayed, because the chip delays the input of a synapse behind the learning engine.
* Tags reach -257 in lava; here they have 9 bits, -256 to 255. Brian2Loihi has no tags, epochs or accumulator.
"""

# mypy: ignore-errors
from typing import Any, NamedTuple

import numpy as np

from neuro.core.keyed_random import NEURON_STRIDE
from neuro.kernels.draws import mix, step_word
from neuro.kernels.jit import inlined, kernel
from neuro.model.synapses.loihi_rule import FACTORS, WIDTHS

GATE, MASK, MANTISSA, SHIFT, SIZE, DOWN, FIRST = range(7)
"""Columns of a product: gate; 2^k - 1; scale; number of factors; bits by which Loihi 2 shifts it down; then (factor,
constant) pairs."""
X0, Y0, U = range(3)
LARGEST_SIZE = 4
COLUMNS = FIRST + 2 * LARGEST_SIZE
EPOCH, PRECISION, LOW, HIGH, TAG_LOW, TAG_HIGH, AWAY, NEEDS_TAG, OF_WEIGHT = range(9)
"""Settings: steps of an epoch; step of a weight; bounds of weight and tag; rounding; whether all products with u_k have
the tag as a factor; number of products of dw, which come first."""
EVALUATED, CHANGED, WEIGHT_SATURATED, TAG_CHANGED, TAG_SATURATED, OVERFLOWS = range(6)
"""Counts: synapses to which the rule was applied; weights written; weights at a bound; tags written; tags at a bound;
products and sums that exceeded the accumulator."""
LAST = 32767
BITS = np.array([(WIDTHS | {"x0": 1, "y0": 1})[name] for name in FACTORS])
"""Bits of each factor."""
_NEURON = np.uint64(NEURON_STRIDE)
_HALF = np.uint64(32)
i32 = np.int32


class Traces(NamedTuple):
    """The traces and spikes of the neurons on both sides of a projection.

    Attributes:
        xs: traces of the sources (x1, x2), shape (steps of an epoch, traces, neurons).
        ys: traces of the targets (y1, y2, y3, r1, r2), of the same shape.
        tx, ty: step in the epoch, from 1, in which each source and target fired last; 0 if it has not fired.
    """

    xs: Any
    ys: Any
    tx: Any
    ty: Any


class Synapses(NamedTuple):
    """The synapses of a projection that learns.

    Attributes:
        weights, tags: int16, in the order of `targets`.
        row_ends, targets: source i has the synapses row_ends[i] : row_ends[i + 1].
        column_ends, incoming, sources: target j has the synapses incoming[column_ends[j] : column_ends[j + 1]], with
            their sources at the same positions of `sources`.
    """

    weights: Any
    tags: Any
    row_ends: Any
    targets: Any
    column_ends: Any
    incoming: Any
    sources: Any


@inlined
def draw(base, index, below):
    """Return a random whole number in [0, below), below <= 2^24."""
    return np.int64(((mix(base + np.uint64(index) * _NEURON) >> _HALF) * np.uint64(below)) >> _HALF)


@kernel
def decay(history, slot, keep, keys, step):
    """Write the decayed traces of the previous slot (cyclic) to `slot`.

    Args:
        history: uint8 (slots, traces, neurons); one slot for each step of an epoch.
        slot: slot of this step.
        keep: int64 (traces, 2): numerator and denominator of the decay factor per step.
        keys: uint64, one per trace.
        step: the step, for the draws.
    """
    # The ring has a slot for each step of an epoch, because products read traces at the step of the last spike.
    previous = (slot - 1) % history.shape[0]
    for k in range(history.shape[1]):
        base = step_word(keys[k], step)
        numerator, denominator = keep[k, 0], keep[k, 1]
        for i in range(history.shape[2]):
            v = np.int64(history[previous, k, i])
            if v != 0:
                v *= numerator  # whole numbers, so that the fraction below is exact
                remainder = v % denominator
                v //= denominator
                if remainder != 0 and draw(base, i, denominator) < remainder:
                    v += 1
            history[slot, k, i] = v


@kernel
def spike(history, slot, impulses, ids, times):
    """Add the impulses of the neurons `ids`, which fired in this step; store the step and return the saturations."""
    saturated = 0
    for n in range(ids.size):
        i = ids[n]
        for k in range(history.shape[1]):
            v = np.int64(history[slot, k, i]) + impulses[k]
            if v > 127:
                v = 127
                saturated += 1
            history[slot, k, i] = v
        times[i] = slot + 1
    return saturated


@inlined
def factor(code, slot, i, j, traces, w, t):
    """Return the value of a factor; codes are those of `neuro.model.synapses.loihi_rule.FACTORS`."""
    # Weight and tag come first, because most rules multiply by the weight or the tag.
    if code == 9:
        return w
    if code == 10:
        return t
    if code == 0:
        return np.int64(traces.tx[i] > 0)
    if code == 3:
        return np.int64(traces.ty[j] > 0)
    if code < 3:
        return np.int64(traces.xs[slot, code - 1, i])
    if code < 7:
        return np.int64(traces.ys[slot, code - 4, j])
    return np.int64(traces.ys[traces.ys.shape[0] - 1, code - 4, j])


@inlined
def limited(v, lowest, counts):
    """Return a value clipped to the accumulator."""
    if v > LAST:
        counts[OVERFLOWS] += 1
        return LAST
    if v < lowest:
        counts[OVERFLOWS] += 1
        return lowest
    return v


def microcode(product, base_of, rounded, lowest):
    """Return the kernel that applies rules, built from the functions of a family, which are inlined.

    Args:
        product: product(terms, n, slot, i, j, traces, w, t) returns the value of product n in units of 2^-7.
        base_of: base_of(keys, k, step) returns the base of the draws for weights (k = 0) or tags (k = 1).
        rounded: rounded(value, change, precision, low, high, away, base, e) returns the new value of a variable of
            synapse e from its change in units of 2^-7, not yet clipped to its bounds.
        lowest: the smallest value of the accumulator.
    """

    @inlined
    def change(terms, first, end, number, i, j, traces, state, k, counts):
        # The change of state[k], where `state` is weight and tag. The accumulator has seven bits below the mantissa,
        # for fractions of a weight in the sum of an epoch.
        begin = state[k] << 7
        total = begin
        for n in range(first, end):
            gate = terms[n, GATE]
            if (number & terms[n, MASK]) != 0:  # u_k does not act in this epoch
                continue
            if gate == X0:
                slot = np.int64(traces.tx[i]) - 1
            elif gate == Y0:
                slot = np.int64(traces.ty[j]) - 1
            else:
                slot = traces.xs.shape[0] - 1
            if slot < 0:
                continue
            # The accumulator saturates at each sum, so the order of the products matters.
            total += limited(product(terms, n, slot, i, j, traces, *state), lowest, counts)
            total = limited(total, lowest, counts)
        return total - begin

    @inlined
    def apply(terms, settings, number, i, j, e, traces, synapses, bases, counts):
        counts[EVALUATED] += 1
        state = w, t = np.int64(synapses.weights[e]), np.int64(synapses.tags[e])
        # Both changes follow from the values before either is applied.
        dw = change(terms, 0, settings[OF_WEIGHT], number, i, j, traces, state, 0, counts)
        dt = change(terms, settings[OF_WEIGHT], terms.shape[0], number, i, j, traces, state, 1, counts)
        if dw != 0:
            low, high = settings[LOW], settings[HIGH]
            new = rounded(w, dw, settings[PRECISION], low, high, settings[AWAY] != 0, bases[0], e)
            if new > high or new < low:
                counts[WEIGHT_SATURATED] += 1
                new = min(high, max(low, new))
            if new != w:
                counts[CHANGED] += 1
                synapses.weights[e] = new
        if dt != 0:
            low, high = settings[TAG_LOW], settings[TAG_HIGH]
            new = rounded(t, dt, 1, low, high, False, bases[1], e)
            if new > high or new < low:
                counts[TAG_SATURATED] += 1
                new = min(high, max(low, new))
            if new != t:
                counts[TAG_CHANGED] += 1
                synapses.tags[e] = new

    @kernel
    def learn(terms, settings, traces, synapses, keys, step, counts):
        """Apply the rule at the end of an epoch and clear its spikes.

        If a spike gates a product, the rows of the pre neurons that fired are visited, then the columns of the post
        neurons that fired. In an epoch with a u_k product all synapses are visited. If all u_k products have t as a
        factor, synapses without a spike whose tag is 0 are skipped.

        Args:
            terms: the products, in the columns above.
            settings: the settings above.
            traces: traces and spikes of both sides.
            synapses: the synapses of the projection; weights and tags are changed.
            keys: keys of the draws.
            step: the last step of the epoch.
            counts: the counts above; increased.
        """
        number = step // settings[EPOCH]
        bases = base_of(keys, 0, step), base_of(keys, 1, step)
        tx, ty, tags = traces.tx, traces.ty, synapses.tags
        row_ends, targets, sources = synapses.row_ends, synapses.targets, synapses.sources
        column_ends, incoming = synapses.column_ends, synapses.incoming
        sweep = gated_x = gated_y = False
        for n in range(terms.shape[0]):
            if (number & terms[n, MASK]) == 0:
                sweep |= terms[n, GATE] == U
                gated_x |= terms[n, GATE] == X0
                gated_y |= terms[n, GATE] == Y0
        if sweep:
            idle = settings[NEEDS_TAG] != 0
            for i in range(tx.size):
                for e in range(row_ends[i], row_ends[i + 1]):
                    if idle and tags[e] == 0 and tx[i] == 0 and ty[targets[e]] == 0:
                        counts[EVALUATED] += 1  # the chip does visit it
                        continue
                    apply(terms, settings, number, i, targets[e], e, traces, synapses, bases, counts)
        else:
            if gated_x:
                for i in range(tx.size):
                    if tx[i] != 0:
                        for e in range(row_ends[i], row_ends[i + 1]):
                            j = targets[e]
                            apply(terms, settings, number, i, j, e, traces, synapses, bases, counts)
            if gated_y:
                for j in range(ty.size):
                    if ty[j] != 0:
                        for n in range(column_ends[j], column_ends[j + 1]):
                            # synapses of sources that fired have already been visited along rows
                            i, e = sources[n], incoming[n]
                            if tx[i] == 0 or not gated_x:
                                apply(terms, settings, number, i, j, e, traces, synapses, bases, counts)
        tx[:] = 0
        ty[:] = 0

    return learn


@inlined
def product_of_loihi(terms, n, slot, i, j, traces, w, t):
    """Return a product, truncated towards 0."""
    v = terms[n, MANTISSA]
    for f in range(terms[n, SIZE]):
        v *= factor(terms[n, FIRST + 2 * f], slot, i, j, traces, w, t) + terms[n, FIRST + 2 * f + 1]
        if v == 0:
            return v
    shift = terms[n, SHIFT]
    if shift >= 0:
        return v << shift
    # A shift alone rounds down, so a negative product would lose more than a positive one.
    return v >> -shift if v > 0 else -((-v) >> -shift)


@inlined
def base_of_loihi(keys, k, step):
    """Return the word of a step, from which each synapse has its own draw."""
    return step_word(keys[k], step)


@inlined
def rounded_by_loihi(value, change, precision, low, high, away, base, e):
    """Return a value plus its change, rounded to the variable's step."""
    if away:
        size = (abs(change) + 127) >> 7
        size -= size % precision
        return value + (size if change > 0 else -size)
    step = precision << 7
    quotient = change // step
    remainder = change - quotient * step
    if remainder != 0 and draw(base, e, step) < remainder:
        quotient += 1
    return value + quotient * precision


@inlined
def product_of_loihi2(terms, n, slot, i, j, traces, w, t):
    """Return a product of factors that are clipped to their bits, in 32 bits."""
    v = i32(1)
    for f in range(terms[n, SIZE]):
        code = terms[n, FIRST + 2 * f]
        limit = np.int64(1) << BITS[code]
        value = factor(code, slot, i, j, traces, w, t) + terms[n, FIRST + 2 * f + 1]
        v = i32(v * i32(min(max(value, -limit), limit - 1)))
    v = i32(i32(v * i32(terms[n, MANTISSA])) >> i32(terms[n, DOWN]))
    return np.int64(i32(v << i32(terms[n, SHIFT])))


@inlined
def base_of_loihi2(keys, k, step):
    """Return the single random number that rounds all weights and tags of an epoch."""
    return keys[k]


@inlined
def rounded_by_loihi2(value, change, precision, low, high, away, base, e):
    """Return a value plus its change, rounded to a whole number.

    A sum with the wrong sign is set to 0 before rounding.
    """
    change = max(change, -(value << 7)) if low == 0 else change
    change = min(change, -(value << 7)) if high == 0 else change
    quotient = change >> 7
    return value + quotient + np.int64(base < (change - (quotient << 7)) / 128.0)


learn_loihi = microcode(product_of_loihi, base_of_loihi, rounded_by_loihi, -LAST - 1)
learn_loihi2 = microcode(product_of_loihi2, base_of_loihi2, rounded_by_loihi2, -LAST - 2)
"""lava's accumulator reaches one below the smallest 16-bit number."""
