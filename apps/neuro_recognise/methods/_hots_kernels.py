# mypy: ignore-errors
"""Compiled loops of `neuro_recognise.methods.hots`: one layer and one recording.

A map stores, for each pixel and channel, exp((T - begin) / tau) of the last event there at time T. Divided by
exp((t - begin) / tau), the map is the time surface at t, so each event needs a single exponential. `begin` is moved
forward before the values exceed double precision.

A layer that learns compares each event's surface with its centres. In a layer that does not learn, an event changes one
value of the map, so the inner products of all surrounding surfaces with the centres change by a multiple of the
centres. These products are stored for all pixels, and the operations per event are proportional to the pixels of the
neighbourhood, whatever the number of channels. All terms are positive, so the sums stay exact to a few last bits.
"""

from math import exp, sqrt
from typing import Any, NamedTuple

from neuro.apps import kernel, subkernel

LONGEST = 30.0
"""Number of time constants after which `begin` is moved forward."""
NOTHING = 1e-200
"""Smaller values are set to 0, because operations on denormal numbers (below 1e-308) are slow."""


class Seen(NamedTuple):
    """The map of a layer and its parameters.

    Attributes:
        map: float64[(height + 2 margin) * (width + 2 margin) * channels], initially 0; the margin is the radius, or 0
            for `find`.
        width: width of the sensor, px.
        radius: radius of a neighbourhood, px.
        channels: int.
        tau: time constant, us.
    """

    map: Any
    width: int
    radius: int
    channels: int
    tau: float


@subkernel
def shrink(numbers, factor):
    """Multiply values >= 0 in place."""
    for i in range(numbers.size):
        value = numbers[i] * factor
        numbers[i] = value if value > NOTHING else 0.0


@subkernel
def add(row, taps, change):
    """Add a multiple of taps to a row of the same length. Callers pass slices, so that numba vectorises the loop."""
    for j in range(taps.size):
        row[j] += change * taps[j]


@subkernel
def closest(products, first, scale, squares):
    """Return the centre k closest to a surface S: the smallest ``|C_k|^2 - 2 S C_k``, the first of equal ones.

    products: float64[...], inner product of S and centre k at first + k, to be multiplied by scale; squares:
    float64[centres].
    """
    nearest, smallest = 0, squares[0] - 2.0 * scale * products[first]
    for k in range(1, squares.size):
        distance = squares[k] - 2.0 * scale * products[first + k]
        if distance < smallest:
            nearest, smallest = k, distance
    return nearest


@kernel
def find(t, x, y, channel, layer, products, turned, squares, out):
    """Find the centre closest to the time surface of each event.

    t: int64[n], us; x, y: uint16[n], px; channel: int64[n], polarity or centre of the layer before; layer: `Seen`;
    products: float64[(height + 2 radius) * (width + 2 radius) * centres], initially 0; turned: float64[channels, rows *
    columns * centres], centres rotated by 180 degrees; squares: float64[centres], the squared lengths of centres; out:
    int64[n], the centre of each event.
    """
    surface_map, width, radius, channels, tau = layer
    n, side = squares.size, 2 * radius + 1
    stride, span = (width + 2 * radius) * n, side * n
    begin = float(t[0]) if t.size else 0.0
    for e in range(t.size):
        time = float(t[e])
        if time - begin > LONGEST * tau:
            factor = exp((begin - time) / tau)
            shrink(surface_map, factor)
            shrink(products, factor)
            begin = time
        growth = exp((time - begin) / tau)
        place = (y[e] * width + x[e]) * channels + channel[e]
        change = growth - surface_map[place]
        surface_map[place] = growth
        corner = y[e] * stride + x[e] * n
        taps = turned[channel[e]]
        for i in range(side):
            add(products[corner + i * stride : corner + i * stride + span], taps[i * span : (i + 1) * span], change)
        out[e] = closest(products, corner + radius * (stride + n), 1.0 / growth, squares)


@subkernel
def counted_from(begin, now, tau, surface_map):
    """Return `begin`; if it is too long ago, first shrink the map to the present and move `begin` to now."""
    if now - begin > LONGEST * tau:
        shrink(surface_map, exp((begin - now) / tau))
        return now
    return begin


@subkernel
def compared(surface_map, corner, stride, span, side, scale, centres, products):
    """Compute the inner products of the time surface with all centres; return the surface's squared length.

    surface_map: float64[...], flat; corner: index of the neighbourhood's first value; stride: distance between rows;
    span: values in a row of the neighbourhood; scale: 1 / exp((t - begin) / tau); products: float64[centres], written.
    """
    products[:] = 0.0
    square = 0.0
    for i in range(side):
        row = surface_map[corner + i * stride : corner + i * stride + span]
        for j in range(span):
            if row[j] != 0.0:
                value = row[j] * scale
                square += value * value
                add(products, centres[i * span + j], value)
    return square


@subkernel
def moved(surface_map, corner, stride, span, side, scale, centres, k, keep, alpha):
    """Move centre k: ``C = keep C + alpha S``; return its squared length."""
    square = 0.0
    for i in range(side):
        first = corner + i * stride
        for j in range(span):
            value = keep * centres[i * span + j, k] + alpha * scale * surface_map[first + j]
            centres[i * span + j, k] = value
            square += value * value
    return square


@kernel
def learn(t, x, y, channel, layer, centres, squares, products, wins, rates):
    """Move the centre closest to the time surface of each event towards it; algorithm 13 of the thesis.

    Arguments as in `find`, except centres: float64[rows * columns * channels, centres], changed; squares: changed;
    products: float64[centres], scratch; wins: int64[centres], p_k, changed; rates: rate and slow of alpha = rate / (1 +
    p_k / slow).
    """
    surface_map, width, radius, channels, tau = layer
    rate, slow = rates
    side = 2 * radius + 1
    stride, span = (width + 2 * radius) * channels, side * channels
    begin = float(t[0]) if t.size else 0.0
    for e in range(t.size):
        time = float(t[e])
        begin = counted_from(begin, time, tau, surface_map)
        growth = exp((time - begin) / tau)
        corner = y[e] * stride + x[e] * channels
        surface_map[corner + radius * (stride + channels) + channel[e]] = growth
        scale = 1.0 / growth
        square = compared(surface_map, corner, stride, span, side, scale, centres, products)
        k = closest(products, 0, 1.0, squares)
        alpha = rate / (1.0 + wins[k] / slow)
        beta = products[k] / sqrt(squares[k] * square) if squares[k] > 0.0 else 0.0
        squares[k] = moved(surface_map, corner, stride, span, side, scale, centres, k, 1.0 - alpha * beta, alpha)
        wins[k] += 1


@kernel
def surfaces(t, x, y, channel, layer, indices, out):
    """Write the time surfaces of some events, used as initial centres.

    Arguments as in `learn`; indices: int64[k], ascending indices of events; out: float64[rows * columns * channels, k].
    """
    surface_map, width, radius, channels, tau = layer
    side = 2 * radius + 1
    stride, span = (width + 2 * radius) * channels, side * channels
    begin, column = float(t[0]) if t.size else 0.0, 0
    for e in range(t.size):
        time = float(t[e])
        begin = counted_from(begin, time, tau, surface_map)
        growth = exp((time - begin) / tau)
        corner = y[e] * stride + x[e] * channels
        surface_map[corner + radius * (stride + channels) + channel[e]] = growth
        if column < indices.size and indices[column] == e:
            for i in range(side):
                for j in range(span):
                    out[i * span + j, column] = surface_map[corner + i * stride + j] / growth
            column += 1


@kernel
def count(x, y, centre, cell, columns, out):
    """Count centres by cell: out, int64[cells, centres], at (y // cell) * columns + x // cell."""
    for e in range(centre.size):
        out[(y[e] // cell) * columns + x[e] // cell, centre[e]] += 1
