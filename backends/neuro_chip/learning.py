"""Kernels of Loihi's learning engine: traces, rules, rounding; integers only.

In a step of learning: every trace decays, spikes add their impulses, and at the end of an epoch the rule is applied.

* A trace keeps v numerator / denominator, rounded up with the probability of the fraction; a spike then adds the
  impulse, up to 127. The rule therefore reads traces with the impulses of the very step (Brian2Loihi and lava agree).
* A product gated by x0 reads all traces at the step of the last pre spike of the epoch, one gated by y0 at that of the
  last post spike, one gated by u_k at the end of the epoch (lava; with epochs of one step they are all the same).
* dw and dt are worked out from the values before either is applied (both agree).
* A product is scaled exactly, cut towards 0 to 2^-7 of a mantissa and to 16 bits, and added to the variable in a 16-bit
  accumulator that saturates (lava). The sum is rounded once, by a keyed draw, to the resolution of the weight
  (`AWAY`: see `LearningRule.rounding`), and the weight is clipped to its sign mode's range.

Where references differ, and what is chosen: `docs` of this backend.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import mix, step_word
from neuro.kernels.jit import inner, kernel
from neuro.keyed import NEURON_STRIDE

TARGET, GATE, MASK, MANTISSA, SHIFT, SIZE, FIRST = range(7)
"""Columns of a term: 0 weight or 1 tag; gate; 2^k - 1; scale; number of factors; then (factor, constant) pairs."""
X0, Y0, U = range(3)
FACTORS = 4
COLUMNS = FIRST + 2 * FACTORS
EPOCH, PRECISION, LOW, HIGH, AWAY, NEEDS_TAG = range(6)
"""Settings: steps of an epoch; step of a weight; its bounds; rounding; whether u_k terms are 0 where the tag is."""
EVALUATED, CHANGED, WEIGHT_SATURATED, TAG_CHANGED, TAG_SATURATED, OVERFLOWS = range(6)
"""Counts: synapses that the rule was applied to; weights written; weights that met a bound; the same of tags; products
and sums that exceeded the accumulator."""
LAST = 32767
_NEURON = np.uint64(NEURON_STRIDE)
_HALF = np.uint64(32)


@inner
def draw(base, index, below):
    """A whole number in [0, below), below <= 2^16."""
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
    before = (slot - 1) % history.shape[0]
    for k in range(history.shape[1]):
        base = step_word(keys[k], step)
        numerator, denominator = keep[k, 0], keep[k, 1]
        for i in range(history.shape[2]):
            v = np.int64(history[before, k, i])
            if v != 0:
                v *= numerator
                rest = v % denominator
                v //= denominator
                if rest != 0 and draw(base, i, denominator) < rest:
                    v += 1
            history[slot, k, i] = v


@kernel
def spike(history, slot, impulses, ids, flags, times):
    """Add impulses of the neurons `ids`, which have fired in this step; note that and when. Return how many saturated."""
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


@inner
def factor(code, i, j, at, xs, ys, x0, y0, w, t):
    """The value of a factor; codes as in `neuro.chips.learning.FACTORS`."""
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
    return np.int64(ys[at, code - 4, j])


@inner
def change(terms, target, number, i, j, xs, ys, tx, ty, x0, y0, w, t, value, counts):
    """The sum of the due products for one variable, in units of 2^-7, within what the accumulator holds."""
    begin = value << 7
    total = begin
    for n in range(terms.shape[0]):
        gate = terms[n, GATE]
        if terms[n, TARGET] != target or (number & terms[n, MASK]) != 0:
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
        elif v > 0:
            v >>= -shift
        else:
            v = -((-v) >> -shift)
        total += limited(v, counts)
        total = limited(total, counts)
    return total - begin


@inner
def limited(v, counts):
    """A value as 16 bits hold it."""
    if v > LAST:
        counts[OVERFLOWS] += 1
        return LAST
    if v < -LAST - 1:
        counts[OVERFLOWS] += 1
        return -LAST - 1
    return v


@inner
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


@inner
def apply(terms, settings, number, i, j, e, xs, ys, tx, ty, x0, y0, weights, tags, base_w, base_t, counts):
    """Apply the rule to synapse `e` from neuron `i` to `j`."""
    counts[EVALUATED] += 1
    w, t = np.int64(weights[e]), np.int64(tags[e])
    dw = change(terms, 0, number, i, j, xs, ys, tx, ty, x0, y0, w, t, w, counts)
    dt = change(terms, 1, number, i, j, xs, ys, tx, ty, x0, y0, w, t, t, counts)
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

    Args:
        terms: int64 (terms, COLUMNS); settings: int64, see above.
        xs, ys: traces of the sources (x1, x2) and of the targets (y1, y2, y3, r1, r2), uint8 (epoch, traces, neurons).
        x0, y0: uint8, who has fired in the epoch; tx, ty: uint8, slot of the last spike.
        weights, tags: int16 mantissas and tags in the order of `targets`.
        row_ends, targets: synapses of source i are row_ends[i] : row_ends[i + 1].
        column_ends, incoming, sources: synapses onto target j, and their sources, are column_ends[j] : column_ends[j + 1]
            of the other two.
        keys: uint64, for weights and for tags.
        step: the step that ends the epoch, a multiple of its length.
        counts: int64 (6,), added to.
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
                    counts[EVALUATED] += 1
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
                        if x0[sources[n]] == 0 or not gated_x:
                            apply(terms, settings, number, sources[n], j, incoming[n], xs, ys, tx, ty, x0, y0,
                                  weights, tags, base_w, base_t, counts)  # fmt: skip
    x0[:] = 0
    y0[:] = 0
