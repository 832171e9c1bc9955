"""Kernels of Loihi's learning engine: traces, rules, rounding; integers only.

In a step of learning: every trace decays, spikes add their impulses, and at the end of an epoch the rule is applied.

* A trace v keeps v numerator / denominator, rounded up with the probability of the fraction; a spike then adds the
  impulse, up to 127. The rule therefore reads traces with the impulses of the very step (Brian2Loihi and lava agree).
* A product gated by x0 reads all traces at the step of the last pre spike of the epoch, one gated by y0 at that of the
  last post spike, one gated by u_k at the end of the epoch (lava; with epochs of one step they are all the same).
  r1 and r2, which come from outside, are read at the end of the epoch.
* dw and dt are worked out from the values before either is applied (both agree).
* A product is scaled exactly, cut towards 0 to 2^-7 of a mantissa and to 16 bits, and added to the variable in a 16-bit
  accumulator that saturates (lava). The sum is rounded once, by a keyed draw, to the resolution of the weight
  (`AWAY`: see `LearningRule.rounding`), and the weight is clipped to its sign mode's range.

Where references differ:
* Decay per step: 1 - 1/tau in Brian2Loihi (the default of `loihi_learning`), exp(-1/tau) in lava. Both are here.
* Draws: Brian2Loihi draws for each synapse and trace, from the fraction of the value before the impulse; lava takes one
  number for all neurons and traces. Here each neuron and trace has its own draw, from the fraction of its own value.
* Changes below a mantissa: Brian2Loihi rounds them away from 0 (and then, for products of spikes, to the weight's step
  towards 0, since its draw is made before the spikes arrive), lava stochastically from 7 bits. Here: `rounding`.
* Products of several factors: lava drops their low bits without making up for it, so its scale is not what the rule
  says; Brian2Loihi keeps fractions. Here the scale is as written and bits below 2^-7 are cut.
* Several spikes of a neuron in an epoch: lava moves all but the last to its beginning; here each counts when it comes.
* Delays: Brian2Loihi delays x0, x1 and x2 with the current; lava learns without delays. Here traces take no delay: the
  chip delays what a synapse adds to the current, behind its learning engine.
* Tags reach -257 in lava; here they are 9-bit, -256 to 255. Brian2Loihi has no tags, epochs or accumulator.
"""

# mypy: ignore-errors
import numpy as np

from neuro.core.keyed_random import NEURON_STRIDE
from neuro.kernels.draws import mix, step_word
from neuro.kernels.jit import inlined, kernel

GATE, MASK, MANTISSA, SHIFT, SIZE, FIRST = range(6)
"""Columns of a product: gate; 2^k - 1; scale; number of factors; then (factor, constant) pairs."""
X0, Y0, U = range(3)
FACTORS = 4
COLUMNS = FIRST + 2 * FACTORS
EPOCH, PRECISION, LOW, HIGH, AWAY, NEEDS_TAG, OF_WEIGHT = range(7)
"""Settings: steps of an epoch; step of a weight; its bounds; rounding; whether products with u_k are 0 where the tag
is; how many products are of dw (they come first)."""
EVALUATED, CHANGED, WEIGHT_SATURATED, TAG_CHANGED, TAG_SATURATED, OVERFLOWS = range(6)
"""Counts: synapses that the rule was applied to; weights written; weights that met a bound; the same of tags; products
and sums that exceeded the accumulator."""
LAST = 32767
_NEURON = np.uint64(NEURON_STRIDE)
_HALF = np.uint64(32)


@inlined
def draw(base, index, below):
    """A whole number in [0, below), below <= 2^24."""
    return np.int64(((mix(base + np.uint64(index) * _NEURON) >> _HALF) * np.uint64(below)) >> _HALF)


@kernel
def decay(history, slot, keep, keys, step):
    """Let traces decay from the slot before (cyclic) into `slot`.

    Args:
        history: uint8 (slots, traces, neurons); one slot for each step of an epoch.
        slot: where this step belongs.
        keep: int64 (traces, 2): numerator and denominator of what a step leaves.
        keys: uint64, one for each trace.
        step: the step, for the draws.
    """
    # A ring of one slot for each step of an epoch: products read traces at the step of the last spike in it.
    before = (slot - 1) % history.shape[0]
    for k in range(history.shape[1]):
        base = step_word(keys[k], step)
        numerator, denominator = keep[k, 0], keep[k, 1]
        for i in range(history.shape[2]):
            v = np.int64(history[before, k, i])
            if v != 0:
                v *= numerator  # whole numbers, so that the fraction drawn for below is exact
                rest = v % denominator
                v //= denominator
                if rest != 0 and draw(base, i, denominator) < rest:
                    v += 1
            history[slot, k, i] = v


@kernel
def spike(history, slot, impulses, ids, flags, times):
    """Add the impulses of the neurons `ids`, which fired in this step, and note it; return how many saturated."""
    saturated = 0
    for n in range(ids.size):
        i = ids[n]
        for k in range(history.shape[1]):
            v = np.int64(history[slot, k, i]) + impulses[k]
            if v > 127:
                v = 127
                saturated += 1
            history[slot, k, i] = v
        flags[i] = 1
        times[i] = slot
    return saturated


@inlined
def factor(code, i, j, at, xs, ys, x0, y0, w, t):
    """The value of a factor; codes as in `neuro.model.synapses.loihi_rule.FACTORS`."""
    # The weight and the tag first: most rules multiply by one of them. A kernel has no table of values by name.
    if code == 9:
        return w
    if code == 10:
        return t
    if code == 0:
        return np.int64(x0[i])
    if code == 3:
        return np.int64(y0[j])
    if code < 3:
        return np.int64(xs[at, code - 1, i])
    if code < 7:
        return np.int64(ys[at, code - 4, j])
    return np.int64(ys[ys.shape[0] - 1, code - 4, j])


@inlined
def change(terms, first, end, number, i, j, xs, ys, tx, ty, x0, y0, w, t, value, counts):
    """The sum of the due products for one variable, in units of 2^-7, within what the accumulator holds."""
    # Seven bits below the mantissa: the accumulator keeps fractions of a weight until the end of the epoch's sum.
    begin = value << 7
    total = begin
    for n in range(first, end):
        gate = terms[n, GATE]
        if (number & terms[n, MASK]) != 0:  # u_k: not its epoch
            continue
        if gate == X0:
            if x0[i] == 0:
                continue
            at = np.int64(tx[i])
        elif gate == Y0:
            if y0[j] == 0:
                continue
            at = np.int64(ty[j])
        else:
            at = xs.shape[0] - 1
        v = terms[n, MANTISSA]
        for f in range(terms[n, SIZE]):
            v *= factor(terms[n, FIRST + 2 * f], i, j, at, xs, ys, x0, y0, w, t) + terms[n, FIRST + 2 * f + 1]
            if v == 0:
                break
        if v == 0:
            continue
        shift = terms[n, SHIFT]
        if shift >= 0:
            v <<= shift
        elif v > 0:  # a shift alone cuts downwards: a negative product would lose more than a positive one
            v >>= -shift
        else:
            v = -((-v) >> -shift)
        # the accumulator saturates at each sum, so the order of the products is part of the rule
        total += limited(v, counts)
        total = limited(total, counts)
    return total - begin


@inlined
def limited(v, counts):
    """A value as 16 bits hold it."""
    if v > LAST:
        counts[OVERFLOWS] += 1
        return LAST
    if v < -LAST - 1:
        counts[OVERFLOWS] += 1
        return -LAST - 1
    return v


@inlined
def rounded(delta, precision, away, base, e):
    """A change in units of 2^-7 as a multiple of the variable's step."""
    if away:
        size = (abs(delta) + 127) >> 7
        size -= size % precision
        return size if delta > 0 else -size
    step = precision << 7
    whole = delta // step
    rest = delta - whole * step
    if rest != 0 and draw(base, e, step) < rest:
        whole += 1
    return whole * precision


@inlined
def apply(terms, settings, number, i, j, e, xs, ys, tx, ty, x0, y0, weights, tags, base_w, base_t, counts):
    """Apply the rule to synapse `e` from neuron `i` to `j`."""
    counts[EVALUATED] += 1
    w, t = np.int64(weights[e]), np.int64(tags[e])
    # Both changes from the values before either is applied.
    dw = change(terms, 0, settings[OF_WEIGHT], number, i, j, xs, ys, tx, ty, x0, y0, w, t, w, counts)
    dt = change(terms, settings[OF_WEIGHT], terms.shape[0], number, i, j, xs, ys, tx, ty, x0, y0, w, t, t, counts)
    if dw != 0:
        new = w + rounded(dw, settings[PRECISION], settings[AWAY] != 0, base_w, e)
        if new > settings[HIGH] or new < settings[LOW]:
            counts[WEIGHT_SATURATED] += 1
            new = min(settings[HIGH], max(settings[LOW], new))
        if new != w:
            counts[CHANGED] += 1
            weights[e] = new
    if dt != 0:
        new = t + rounded(dt, 1, False, base_t, e)
        if new > 255 or new < -256:
            counts[TAG_SATURATED] += 1
            new = min(255, max(-256, new))
        if new != t:
            counts[TAG_CHANGED] += 1
            tags[e] = new


@kernel
def learn(
    terms, settings, xs, ys, x0, y0, tx, ty, weights, tags,
    row_ends, targets, column_ends, incoming, sources, keys, step, counts,
):  # fmt: skip
    """Apply the rule at the end of an epoch and forget its spikes.

    Synapses are visited where a spike gates a product: along the rows of the pre neurons that fired, then along the
    columns of the post neurons that fired. All are visited where a product with u_k is due; those whose tag is 0 and
    that saw no spike are passed over if every such product has t as a factor.

    Terms and settings are laid out as above. `xs` are the traces of the sources (x1, x2), `ys` those of the targets
    (y1, y2, y3, r1, r2), uint8 (epoch, traces, neurons); x0 and y0 tell which have fired in the epoch and tx, ty in
    which slot last (uint8). Mantissas and tags are int16, in the order of `targets`; synapses of source i are
    row_ends[i] : row_ends[i + 1]; those onto target j and their sources are column_ends[j] : column_ends[j + 1] of
    `incoming` and `sources`. `keys` are those of the weights' and the tags' draws, `step` ends the epoch, and `counts`
    is added to.
    """
    number = step // settings[EPOCH]
    base_w, base_t = step_word(keys[0], step), step_word(keys[1], step)
    sweep = gated_x = gated_y = False
    for n in range(terms.shape[0]):
        if (number & terms[n, MASK]) == 0:
            sweep |= terms[n, GATE] == U
            gated_x |= terms[n, GATE] == X0
            gated_y |= terms[n, GATE] == Y0
    if sweep:
        idle = settings[NEEDS_TAG] != 0
        for i in range(x0.size):
            for e in range(row_ends[i], row_ends[i + 1]):
                if idle and tags[e] == 0 and x0[i] == 0 and y0[targets[e]] == 0:
                    counts[EVALUATED] += 1  # the chip does visit it
                    continue
                apply(terms, settings, number, i, targets[e], e, xs, ys, tx, ty, x0, y0, weights, tags,
                      base_w, base_t, counts)  # fmt: skip
    else:
        if gated_x:
            for i in range(x0.size):
                if x0[i] != 0:
                    for e in range(row_ends[i], row_ends[i + 1]):
                        apply(terms, settings, number, i, targets[e], e, xs, ys, tx, ty, x0, y0, weights, tags,
                              base_w, base_t, counts)  # fmt: skip
        if gated_y:
            for j in range(y0.size):
                if y0[j] != 0:
                    for n in range(column_ends[j], column_ends[j + 1]):
                        # those of sources that fired were visited along their rows: each once, from the same values
                        if x0[sources[n]] == 0 or not gated_x:
                            apply(terms, settings, number, sources[n], j, incoming[n], xs, ys, tx, ty, x0, y0,
                                  weights, tags, base_w, base_t, counts)  # fmt: skip
    x0[:] = 0
    y0[:] = 0
