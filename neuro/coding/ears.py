"""Sounds to spikes: a cochlea as a bank of half-wave rectified filters, and three codes for its output.

| step | by |
| --- | --- |
| sound to channels | `Cochlea` (gammatone filters, sample by sample), `MelBands` (bands of spectra, frame by frame) |
| channels to spikes | `HairCells` (integrate-and-fire), `crossings` (passed thresholds), rates |

Every step works on streams: a sound in pieces gives the same result as the whole sound. Rates are the levels times a
largest rate, and `neuro.coding.poisson` turns rates into spikes.

Source: gammatone filters: Slaney, Apple Computer Technical Report 35, 1993; mel scale: O'Shaughnessy, Speech
Communication, 1987; spikes of integrate-and-fire cells behind a half-wave rectifier: Cramer, Stradmann, Schemmel &
Zenke, IEEE TNNLS 33(7):2744, 2022, whose cochlea is hydrodynamic; their parameters are not ours.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument, finite
from neuro.core.errors import ModelError
from neuro.kernels.jit import kernel

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]

BANDWIDTH = 1.019
"""Bandwidth of a gammatone filter in equivalent rectangular bandwidths (Patterson et al., 1992)."""
_SILENCE = 1e-12


class Cochlea:
    """Gammatone filters side by side, each followed by a half-wave rectifier, for a sound in pieces.

    Centres are evenly spaced in equivalent rectangular bandwidths (Glasberg and Moore, 1990). A tone of the amplitude 1
    at the centre of a channel gives half-waves of the amplitude 1 in that channel.

    Args:
        rate: sampling rate, Hz.
        channels: number of filters, 1 to 1024.
        low: centre of the lowest filter, Hz.
        high: centre of the highest filter, Hz, at most half of the rate.

    Attributes:
        centres: centres of the filters, Hz, ascending, shape (channels,).

    Raises:
        ModelError: a number is out of bounds.
    """

    def __init__(self, rate: float, channels: int = 64, low: float = 80.0, high: float = 3600.0) -> None:
        self.rate: float = argument("rate", rate, above=0)
        count: int = argument("channels", channels, kind="integer", at_least=1, at_most=1024)
        first: float = argument("low", low, above=0)
        last: float = argument("high", high, above=first, at_most=self.rate / 2.0)
        self.centres = (10.0 ** (np.linspace(_erbs(first), _erbs(last), count) / 21.4) - 1.0) / 0.00437
        self._filters = [_gammatone(float(centre), self.rate) for centre in self.centres]
        self.reset()

    def reset(self) -> None:
        """Discard all samples so far: the next sample is the first."""
        self._states = [np.zeros((4, 2)) for _ in self._filters]

    def hear(self, sound: npt.ArrayLike) -> Floats:
        """Return the output of the channels for the next samples.

        Args:
            sound: samples, shape (samples,).

        Returns:
            Half-waves, at least 0, shape (samples, channels).

        Raises:
            ModelError: `sound` is not a list of finite numbers.
        """
        from scipy.signal import sosfilt

        samples = _row(sound)
        output = np.empty((len(samples), len(self._filters)))
        if len(samples):
            for k, sections in enumerate(self._filters):
                output[:, k], self._states[k] = sosfilt(sections, samples, zi=self._states[k])
        return np.maximum(output, 0.0, out=output)


class HairCells:
    """A leaky integrate-and-fire cell for each channel: tau v' = drive - v. The cell spikes at v >= 1; v begins at 0.

    Args:
        channels: number of cells.
        rate: sampling rate, Hz.
        gain: factor on the drive.
        tau: time constant of the leak, ms.
        refractory: time after a spike in which a cell stays at 0, ms.

    Raises:
        ModelError: a number is out of bounds.
    """

    def __init__(
        self, channels: int, rate: float, gain: float = 50.0, tau: float = 5.0, refractory: float = 2.0
    ) -> None:
        self.channels: int = argument("channels", channels, kind="integer", at_least=1)
        self.rate: float = argument("rate", rate, above=0)
        self._gain: float = argument("gain", gain, above=0)
        self._keep = float(np.exp(-1000.0 / (argument("tau", tau, above=0) * self.rate)))
        self._rest = round(argument("refractory", refractory, at_least=0) * self.rate / 1000.0)
        self.reset()

    def reset(self) -> None:
        """Restart at the first sample, with all cells at 0."""
        self._v, self._until, self._sample = np.zeros(self.channels), np.zeros(self.channels, np.int64), 0

    def spikes(self, drive: npt.ArrayLike) -> tuple[Floats, Ints]:
        """Return the spikes for the next samples.

        Args:
            drive: output of channels, shape (samples, channels).

        Returns:
            Spike times in ms since the first sample after `reset`, ascending, and the channel of each spike.

        Raises:
            ModelError: the drive has another shape, or contains NaN or infinite numbers.
        """
        samples = finite(drive, "drive")
        if samples.ndim != 2 or samples.shape[1] != self.channels:
            raise ModelError(f"drive: found the shape {samples.shape}: expected (samples, {self.channels})")
        fired = np.zeros(samples.shape, dtype=np.bool_)
        _integrate(
            samples, self._gain * (1.0 - self._keep), self._keep, self._rest, self._sample, self._v, self._until, fired
        )
        sample, channel = fired.nonzero()
        times: Floats = (sample + self._sample + 1).astype(np.float64) * (1000.0 / self.rate)
        self._sample += len(samples)
        return times, channel.astype(np.int64)


@kernel
def _integrate(drive, gain, keep, rest, first, v, until, fired):  # type: ignore[no-untyped-def]
    """Advance all cells by the samples of `drive`, (samples, channels), and set `fired` to True at spikes."""
    for t in range(drive.shape[0]):
        for k in range(drive.shape[1]):
            if first + t < until[k]:
                continue
            v[k] = keep * v[k] + gain * drive[t, k]
            if v[k] >= 1.0:
                v[k] = 0.0
                until[k] = first + t + 1 + rest
                fired[t, k] = True


class MelBands:
    """Logarithmic energy in triangular bands, evenly spaced in mels, frame by frame, for a sound in pieces.

    The window of a frame ends with the frame, so no future sample is needed. Silence precedes the first sample.

    Args:
        rate: sampling rate, Hz.
        channels: number of bands, 1 to 1024.
        low: lower end of the lowest band, Hz.
        high: upper end of the highest band, Hz; by default half of the rate.
        window: length of a frame's Hann window, ms.
        hop: time from frame to frame, ms.

    Raises:
        ModelError: a number is out of bounds.
    """

    def __init__(
        self,
        rate: float,
        channels: int = 32,
        low: float = 60.0,
        high: float | None = None,
        window: float = 25.0,
        hop: float = 10.0,
    ) -> None:
        self.rate: float = argument("rate", rate, above=0)
        count: int = argument("channels", channels, kind="integer", at_least=1, at_most=1024)
        first: float = argument("low", low, at_least=0)
        half = self.rate / 2.0
        last: float = argument("high", half if high is None else high, above=first, at_most=half)
        width = round(argument("window", window, above=0) * self.rate / 1000.0)
        self._step = round(argument("hop", hop, above=0) * self.rate / 1000.0)
        if width < 2 or self._step < 1:
            raise ModelError(
                f"window = {window}, hop = {hop}: expected at least 2 samples and 1 sample of {1000 / self.rate:g} ms"
            )
        self._window = np.hanning(width)
        self._bins = 1 << (width - 1).bit_length()
        self._bands = _triangles(count, first, last, self._bins, self.rate)
        self.reset()

    def reset(self) -> None:
        """Discard all samples so far: the next sample is the first."""
        self._seen = np.zeros(len(self._window))

    def hear(self, sound: npt.ArrayLike) -> Floats:
        """Return the frames that end in the next samples.

        Args:
            sound: samples, shape (samples,).

        Returns:
            Energy of each band in dB, -120 for silence, shape (frames, channels).

        Raises:
            ModelError: `sound` is not a list of finite numbers.
        """
        samples, width = np.concatenate((self._seen, _row(sound))), len(self._window)
        frames = (len(samples) - width) // self._step
        starts = self._step * (1 + np.arange(frames))
        self._seen = samples[frames * self._step :]
        power = np.abs(np.fft.rfft(samples[starts[:, None] + np.arange(width)] * self._window, self._bins, axis=1)) ** 2
        energy = np.einsum("fb,bc->fc", power / (self._window**2).sum(), self._bands)  # frame by frame
        levels: Floats = 10.0 * np.log10(energy + _SILENCE)
        return levels


def crossings(levels: npt.ArrayLike, thresholds: npt.ArrayLike, before: npt.ArrayLike | None = None) -> Floats:
    """Return a spike for each threshold crossed by a channel between two frames, upward or downward.

    Args:
        levels: levels of the channels, shape (frames, channels).
        thresholds: ascending, shape (thresholds,), in the unit of the levels.
        before: frame before the first frame, shape (channels,), e.g. the last frame of the previous piece; by default
            its levels are below all thresholds.

    Returns:
        1 for a spike, else 0, shape (frames, 2, thresholds, channels): downward, then upward.

    Raises:
        ModelError: a shape is wrong, thresholds do not ascend, or a number is not finite.
    """
    values, bars = finite(levels, "levels"), finite(thresholds, "thresholds")
    if values.ndim != 2:
        raise ModelError(f"levels: found the shape {values.shape}: expected (frames, channels)")
    if bars.ndim != 1 or not len(bars) or (np.diff(bars) <= 0).any():
        raise ModelError("thresholds: expected ascending numbers in a row, at least one")
    previous = np.full(values.shape[1], -np.inf) if before is None else finite(before, "before")
    if previous.shape != values.shape[1:]:
        raise ModelError(f"before: found the shape {previous.shape}: expected ({values.shape[1]},)")
    is_above = np.concatenate((previous[None], values))[:, None, :] >= bars[:, None]
    change = np.diff(is_above.astype(np.int8), axis=0)
    return np.stack((change < 0, change > 0), axis=1).astype(np.float64)


def _row(sound: npt.ArrayLike) -> Floats:
    samples = finite(sound, "sound")
    if samples.ndim != 1:
        raise ModelError(
            f"sound: found the shape {samples.shape}: expected samples in a row", hint="take one channel of it"
        )
    return samples


def _erbs(f: float) -> float:
    """Return the number of equivalent rectangular bandwidths below a frequency in Hz (Glasberg and Moore, 1990)."""
    return float(21.4 * np.log10(1.0 + 0.00437 * f))


def _gammatone(centre: float, rate: float) -> Floats:
    """Return four filters of second order, whose product has the gain 1 at the centre (Slaney 1993)."""
    t, width = 1.0 / rate, 2.0 * np.pi * BANDWIDTH * 24.7 * (0.00437 * centre + 1.0)
    angle, decay = 2.0 * np.pi * centre * t, np.exp(-width * t)
    sections = np.zeros((4, 6))
    for row, (outer, inner) in zip(sections, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True):
        zero = np.cos(angle) + outer * np.sqrt(3.0 + inner * 2.0**1.5) * np.sin(angle)
        row[:] = 1.0, -zero * decay, 0.0, 1.0, -2.0 * np.cos(angle) * decay, decay**2
    z = np.exp(-1j * angle * np.arange(3))
    sections[:, :3] /= np.abs((sections[:, :3] @ z) / (sections[:, 3:] @ z))[:, None]
    return sections


def _triangles(channels: int, low: float, high: float, bins: int, rate: float) -> Floats:
    """Return the share of each frequency in each band, shape (frequencies, channels)."""
    mels = np.linspace(2595.0 * np.log10(1.0 + low / 700.0), 2595.0 * np.log10(1.0 + high / 700.0), channels + 2)
    edges = 700.0 * (10.0 ** (mels / 2595.0) - 1.0)
    f = np.arange(bins // 2 + 1)[:, None] * rate / bins
    rising = (f - edges[:-2]) / (edges[1:-1] - edges[:-2])
    falling = (edges[2:] - f) / (edges[2:] - edges[1:-1])
    return np.clip(np.minimum(rising, falling), 0.0, None)
