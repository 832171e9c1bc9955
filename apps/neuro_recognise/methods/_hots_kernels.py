# mypy: ignore-errors
"""Compiled loops of `neuro_recognise.methods.hots`: one layer and one recording.

For each pixel and channel, a map stores exp((T - begin) / tau), with T the time of the last event there. The time
surface at t is the map divided by exp((t - begin) / tau), so each event needs a single exponential. `begin` is moved
forward before the values exceed double precision.

A layer that learns compares the surface of each event with the centres of the layer. In a layer that does not learn,
the centres are constant. An event changes one value of the map, so the inner products of all surrounding surfaces with
the centres change by a multiple of the centres. These products are stored for all pixels. The operations per event
are then proportional to the pixels of the neighbourhood, and do not depend on the number of channels. All terms are
positive, so the sums stay exact to a few last bits.
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
        map: float64[(height + 2 margin) * (width + 2 margin) * channels], initially 0. The margin is 0 for `find`, else
            the radius.
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
    """Multiply values >= 0 by a factor in place, and set results up to `NOTHING` to 0."""
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
    """Return the index k of the centre C_k closest to a surface S, which has the smallest ``|C_k|^2 - 2 S C_k``.

    Of several equal centres the first is returned. products: float64[...], scale * products[first + k] is the inner
    product of S and centre k; squares: float64[centres], ``|C_k|^2``.
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
    """Return `begin`. If `begin` is too long ago, scale the map so that it counts from now, and return now."""
    if now - begin > LONGEST * tau:
        shrink(surface_map, exp((begin - now) / tau))
        return now
    return begin


@subkernel
def compared(surface_map, corner, stride, span, side, scale, centres, products):
    """Compute the inner products of the time surface with all centres, and return the surface's squared length.

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
    """Move centre k to ``keep C + alpha S``, with S the time surface, and return the new squared length."""
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
    """For each event, move the centre closest to its time surface towards this surface; thesis algorithm 13.

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
    """Count the events of each centre in each cell.

    cell: side of a cell, px; out: int64[cells, centres], with the cell's index (y // cell) * columns + x // cell.
    """
    for e in range(centre.size):
        out[(y[e] // cell) * columns + x[e] // cell, centre[e]] += 1
