"""A pixel model of event cameras: events from timed images, and images from scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, argument, check_fields
from neuro.extend import quantity
from neuro_events._events import Events, checked_size, empty_columns, joined_columns

kernels = LazyModule("neuro_events._dvs_kernels")

__all__ = ["DVS", "DVSParameters", "dvs_events"]

RawEvents = tuple[npt.NDArray[np.int64], npt.NDArray[np.int32], npt.NDArray[np.uint8]]
"""Times (us), pixel numbers (row by row) and polarities."""

Box = tuple[int, int, int, int]
"""First column, first row, end column and end row (both exclusive), px."""

_KINDS = ("uint8", "uint16", "float16", "float32", "float64")

_FEW = 48
"""Largest number of events that are sorted by insertion."""


class DVS:
    """A model of an event camera that receives one image after another.

    Between two images the log intensity of a pixel is assumed to change linearly, so events occur at times between the
    images. A pixel compares the log intensity with the value at its last event. Leak slowly raises the difference.
    Every random draw depends only on the seed, the pixel and the number of earlier draws, so the same images give the
    same events. Only pixels whose intensity changes, or for which a leak or noise event is due, are computed.

    Args:
        sensor_size: width and height, px.
        parameters: parameters of the pixels. None: the defaults.
        seed: seed of thresholds and noise, not negative.

    Raises:
        ModelError: invalid size or seed.

    Example:
        >>> import numpy as np
        >>> camera = DVS((2, 1), DVSParameters.ideal())
        >>> len(camera.see(np.array([[0.1, 0.1]]), 0))
        0
        >>> camera.see(np.array([[0.1, 0.2]]), 1000).t
        array([288, 577, 865])
    """

    def __init__(self, sensor_size: tuple[int, int], parameters: DVSParameters | None = None, *, seed: int = 0) -> None:
        argument("seed", seed, whole=True, at_least=0)
        self.sensor_size = checked_size(sensor_size)
        self._full_box = (0, 0, *self.sensor_size)
        self.parameters = parameters or DVSParameters()
        self.seed = seed
        self.reset()

    def reset(self) -> None:
        """Reset the camera to its initial state."""
        p, n = self.parameters, self.sensor_size[0] * self.sensor_size[1]
        state, levels, blocks = np.zeros(n, kernels.PIXEL), np.zeros((n, 4)), -(-n // kernels.BLOCK)
        spread = (
            np.random.default_rng([self.seed, 1]).normal(0.0, p.sigma_thres, (2, n)) if p.sigma_thres else (0.0, 0.0)
        )
        levels[:, kernels.ON] = np.maximum(p.pos_thres + spread[0], LOWEST_THRESHOLD)
        levels[:, kernels.OFF] = np.maximum(p.neg_thres + spread[1], LOWEST_THRESHOLD)
        if p.leak_rate_hz:
            decades = np.random.default_rng([self.seed, 4]).normal(0.0, p.noise_rate_cov_decades, n)
            state["leak"] = 1e-6 * p.leak_rate_hz * levels[:, kernels.ON] * 10.0**decades
        self._calm = not (p.leak_rate_hz or p.shot_noise_rate_hz or p.cutoff_hz or p.refractory_period_s)
        wait = 1e6 / p.shot_noise_rate_hz if p.shot_noise_rate_hz else np.inf
        cutoff, blind = 2e-6 * np.pi * p.cutoff_hz, 1e6 * p.refractory_period_s
        fixed = np.array([(cutoff, blind, wait, 1.0 - p.shot_noise_bright, self.seed % 2**63)], kernels.FIXED)
        look_arrays = np.zeros(blocks), *np.zeros((2, blocks), np.int64)
        pick_arrays = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
        self._pixels = kernels.Pixels(fixed, state, levels, np.zeros(n), *look_arrays, *pick_arrays)
        self._out = _buffers(max(1024, n // 4))
        self._old: npt.NDArray[Any] | None = None
        self._origin = self._t = 0

    def see(self, image: Image, t_us: int, *, changed: Box | None = None) -> Events:
        """Process the next image.

        Args:
            image: (height, width) intensities, linear in light and not negative: uint8 or uint16, with the largest
                value of the type as full scale, or floats with 1 as full scale (larger values are allowed).
            t_us: time of the image, us, later than that of the image before.
            changed: (first column, first row, end column, end row), the part that may differ from the image before. The
                rest is not compared, because the caller promises that it is unchanged. If the rest differs
                nevertheless, the camera notices the difference now or with a later image. Ignored for the first image.

        Returns:
            The events between the image before and this one, ordered by time. No events for the first image.

        Raises:
            ModelError: shape or type differ from the image before, the time is not later, an intensity is negative or
                not finite, or `changed` is not on the image. The state of the camera is then unchanged.
        """
        flat, t = self._checked(image, t_us)
        box = self._full_box if changed is None else self._inside(changed, t)
        first = self._old is None
        if self._old is None:
            self._start(flat.dtype, t)
        assert self._old is not None
        t0, t1 = float(self._t - self._origin), float(t - self._origin)
        pixels = self._pixels
        blocks, bad = kernels.look(flat, self._old, first, box, self.sensor_size[0], self._curve.scale, t1, pixels)
        if bad >= 0:
            self._old = None if first else self._old
            raise self._impossible(flat, bad, t)
        count = kernels.pick(flat, self._old, first, blocks, self._calm, self._curve, t1, pixels)
        batches: list[RawEvents] = []
        if first:
            kernels.begin(pixels)
        elif count:
            n_done = 0
            while n_done < count:
                n, n_done = kernels.advance(n_done, count, t0, t1, self._origin, pixels, self._out)
                batches.append((self._out[0][:n], self._out[1][:n], self._out[2][:n]))
                if n_done < count:
                    self._out = _buffers(4 * len(self._out[0]))
        kernels.settle(blocks, flat, self._old, pixels)
        previous, self._t = self._t, t
        return self._sorted(batches, previous, t)

    def watch(self, images: Iterable[tuple[int, Image]]) -> Iterator[Events]:
        """Process images as they arrive.

        Args:
            images: time (us) and image, as for `see`. A second call of `watch` continues after these images.

        Yields:
            The events before each image but the first.
        """
        for t, image in images:
            first = self._old is None
            events = self.see(image, t)
            if not first:
                yield events

    def record(self, images: Iterable[tuple[int, Image]]) -> Events:
        """Return all events of `watch` as one recording.

        Args:
            images: see `watch`.
        """
        columns = joined_columns(e._columns for e in self.watch(images))
        return Events._trusted(*columns, self.sensor_size, {})

    def _checked(self, image: Image, t_us: int) -> tuple[npt.NDArray[Any], int]:
        """Check an image and its time, and return the flat image and the time."""
        array, t = np.asarray(image), int(t_us)
        width, height = self.sensor_size
        place = f"image at {t_us} us"
        if t != t_us:
            raise ModelError(f"{place}: expected a time in whole us")
        if array.shape != (height, width):
            hint = "one grey value for each pixel; mix colours first" if array.ndim == 3 else ""
            raise ModelError(f"{place} has shape {array.shape}, expected ({height}, {width})", hint=hint)
        has_type_of_last = self._old is not None and array.dtype == self._old.dtype
        if not has_type_of_last and str(array.dtype) not in _KINDS:
            raise ModelError(
                f"{place} has type {array.dtype}, expected one of {', '.join(_KINDS)}",
                hint="integers have their type's largest value as full scale, floats have 1",
            )
        if not has_type_of_last and array.dtype == np.float16:
            array = array.astype(np.float32)
        if self._old is not None:
            if array.dtype != self._old.dtype:
                raise ModelError(f"{place} has type {array.dtype}, expected {self._old.dtype} like the one before")
            if t <= self._t:
                raise ModelError(f"{place}: expected a time later than that of the image before, {self._t} us")
        return np.ascontiguousarray(array).reshape(-1), t

    def _inside(self, changed: Box, t: int) -> Box:
        """Check that the changed part lies on the image, and return it."""
        width, height = self.sensor_size
        x0, y0, x1, y1 = box = tuple(int(edge) for edge in changed)
        if box != tuple(changed) or not (0 <= x0 <= x1 <= width and 0 <= y0 <= y1 <= height):
            expected = f"x0, y0, x1, y1 with 0 <= x0 <= x1 <= {width} and 0 <= y0 <= y1 <= {height}"
            raise ModelError(f"image at {t} us: changed is {tuple(changed)}, expected {expected}")
        return x0, y0, x1, y1

    def _start(self, kind: np.dtype[Any], t: int) -> None:
        """Initialise the arrays that depend on the type and the time of the first image."""
        self._old = np.zeros(len(self._pixels.due), kind)
        self._origin = self._t = t
        levels = np.arange(np.iinfo(str(kind)).max + 1 if kind.kind == "u" else 0).astype(kind)
        scale = 1.0 / (len(levels) - 1) if len(levels) else 1.0
        self._curve = kernels.Curve(self.parameters.log_intensity(shares(levels)), scale, *self.parameters.curve())

    def _impossible(self, image: npt.NDArray[Any], bad: int, t: int) -> ModelError:
        y, x = divmod(int(bad), self.sensor_size[0])
        text = f"image at {t} us: intensity at x {x}, y {y} is {image[bad]}, expected a finite number of at least 0"
        return ModelError(text)

    def _sorted(self, batches: list[RawEvents], begin: int, end: int) -> Events:
        """Sort the events of the kernel by time and then by pixel."""
        t, pixel, p = batches[0] if len(batches) == 1 else _joined(batches or [_buffers(0)])
        n, width = len(t), self.sensor_size[0]
        out = empty_columns(n)
        if n <= _FEW:
            kernels.few_in_order(t, pixel, p, width, *out)
        else:
            key = (t - begin).astype(np.uint16) if end - begin < 65536 else t
            kernels.in_order(t, pixel, p, width, np.argsort(key, kind="stable"), *out)
        return Events._trusted(*out, self.sensor_size, {})


def dvs_events(
    t_us: npt.ArrayLike, images: npt.ArrayLike, parameters: DVSParameters | None = None, *, seed: int = 0
) -> Events:
    """Return the events of a sequence of images.

    Args:
        t_us: (n,) increasing times, us.
        images: (n, height, width), as for `DVS.see`.
        parameters: parameters of the pixels. None: the defaults.
        seed: seed of thresholds and noise.

    Returns:
        All events, ordered by time.

    Raises:
        ModelError: see `DVS.see`.
    """
    stack, times = np.asarray(images), np.asarray(t_us)
    if stack.ndim != 3 or times.shape != stack.shape[:1]:
        expected = f"({len(times)}, height, width)" if times.ndim == 1 else "(n, height, width) and (n,) times"
        raise ModelError(f"images have shape {stack.shape}, expected {expected}")
    camera = DVS((stack.shape[2], stack.shape[1]), parameters, seed=seed)
    return camera.record(zip(times.tolist(), stack, strict=True))


def _buffers(n: int) -> RawEvents:
    """Return uninitialised arrays for times, pixels and polarities."""
    return np.empty(n, np.int64), np.empty(n, np.int32), np.empty(n, np.uint8)


def _joined(batches: list[RawEvents]) -> RawEvents:
    t, pixel, p = zip(*batches, strict=True)
    return np.concatenate(t), np.concatenate(pixel), np.concatenate(p)


Image = npt.NDArray[Any]

LOWEST_THRESHOLD = 0.01
"""Lower limit of drawn thresholds, log units. Source: v2e, emulator.py (`torch.clamp`)."""

GREYS = 255.0
"""Full scale of intensities in v2e, which defines its lin-log curve for intensities from 0 to 255."""


@dataclass(frozen=True, slots=True)
class DVSParameters:
    """Parameters of the pixels of an event camera. Names are those of v2e if the meaning is the same.

    Attributes:
        pos_thres: rise of the natural log of the intensity that triggers an ON event.
        neg_thres: fall that triggers an OFF event, as a positive number.
        sigma_thres: standard deviation of both thresholds from pixel to pixel, log units. Thresholds are at least 0.01.
        refractory_period_s: dead time of a pixel after an event, s. The intensity at the end of the dead time is the
            new reference.
        leak_rate_hz: rate of ON events of a pixel with constant light, Hz.
        noise_rate_cov_decades: standard deviation of the decimal log of a pixel's leak rate.
        shot_noise_rate_hz: rate of noise events of a dark pixel, Hz. Their times are random, and ON and OFF are equally
            likely.
        shot_noise_bright: rate of noise events at full scale relative to the rate in the dark; linear in between.
        cutoff_hz: bandwidth (-3 dB) of a pixel at full scale, Hz. The bandwidth of darker pixels is lower, in
            proportion to the intensity + 8 %. 0: no limit.
        linear_below: intensity below which a line replaces the log, as a share of full scale. 0: no line.
        floor: intensity added to all light (dark current), as a share of full scale.

    Raises:
        ModelError: a value is out of its range.

    Source: Hu, Liu, Delbruck, "v2e", CVPRW 2021, section 4, and its emulator_utils.py (curve, low
        pass, noise). Sizes of the defaults: Lichtsteiner et al., IEEE JSSC 43:566, 2008 (thresholds,
        mismatch); Nozaki and Delbruck, IEEE TED 64:3239, 2017 (leak).

    Example:
        >>> DVSParameters.ideal(pos_thres=0.1).leak_rate_hz
        0.0
    """

    pos_thres: float = quantity(0.2, at_least=LOWEST_THRESHOLD)
    neg_thres: float = quantity(0.2, at_least=LOWEST_THRESHOLD)
    sigma_thres: float = quantity(0.03, at_least=0)
    refractory_period_s: float = quantity(1e-4, "s", at_least=0)
    leak_rate_hz: float = quantity(0.1, "Hz", at_least=0)
    noise_rate_cov_decades: float = quantity(0.1, at_least=0)
    shot_noise_rate_hz: float = quantity(0.1, "Hz", at_least=0)
    shot_noise_bright: float = quantity(0.25, at_least=0, at_most=1)
    cutoff_hz: float = quantity(0.0, "Hz", at_least=0)
    linear_below: float = quantity(20.0 / GREYS, at_least=0, at_most=1)
    floor: float = quantity(0.0, at_least=0)

    def __post_init__(self) -> None:
        check_fields(self)
        if 0.0 < self.linear_below <= 2.0 / GREYS:
            raise ModelError(f"linear_below is {self.linear_below}, expected 0 or more than 2/255")
        if self.linear_below == 0.0 and self.floor < 1e-9:
            raise ModelError(
                f"linear_below is 0 and floor is {self.floor}, expected at least 1e-9 of one",
                hint="raise one of them, because the log of black is infinite",
            )

    @classmethod
    def ideal(cls, **changes: Any) -> DVSParameters:
        """Return parameters of identical pixels without noise, leak, refractory period and limit of the bandwidth.

        Args:
            **changes: parameters with other values.
        """
        zeros = ("sigma_thres", "refractory_period_s", "leak_rate_hz", "shot_noise_rate_hz")
        return cls(**{**dict.fromkeys(zeros, 0.0), **changes})

    def log_intensity(self, light: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the log intensity: the natural log of the intensity, and a line for dark pixels.

        Args:
            light: intensities as shares of full scale, any shape.

        Returns:
            Natural log of the share. Both parts of the curve meet at `linear_below`.

        Source: v2e, emulator_utils.py, `lin_log`: x ln(T)/T up to T = 20 of 255, ln(x) above.
        """
        floor, knee, slope, offset = self.curve()
        total_light = np.asarray(light, np.float64) + floor
        above = np.log(np.maximum(total_light, knee))
        return np.asarray(np.where(total_light > knee, above, total_light * slope + offset))

    def curve(self) -> tuple[float, float, float, float]:
        """Return the floor, the intensity above which the log begins, and the slope and offset of the line below."""
        knee = self.linear_below
        if knee == 0.0:
            return self.floor, 0.0, 0.0, 0.0
        return self.floor, knee, log(GREYS * knee) / knee, -log(GREYS)


def shares(image: Image) -> npt.NDArray[np.float64]:
    """Convert an image's intensities to shares of full scale.

    Args:
        image: see `DVS.see`.
    """
    top = float(np.iinfo(str(image.dtype)).max) if image.dtype.kind == "u" else 1.0
    return np.asarray(image, np.float64) / top


Scene = Callable[[int], Image]
"""Function from a time, us, to the image at this time."""


def frames_of(
    scene: Scene,
    start_us: int,
    stop_us: int,
    *,
    step_us: int = 1000,
    change: float | None = None,
    shortest_us: int = 10,
    parameters: DVSParameters | None = None,
) -> Iterator[tuple[int, Image]]:
    """Yield images of a scene for `DVS.record` or `DVS.watch`, at fixed or adaptive steps.

    Between two images the camera assumes that the log intensity changes linearly. With `change`, an interval is halved
    as long as the log intensity of a pixel changes by more than `change`. A change that reverts within one `step_us` is
    not noticed.

    Args:
        scene: function from a time, us, to an image as for `DVS.see`.
        start_us: time of the first image, us.
        stop_us: time of the last image, us, even if the steps do not end there.
        step_us: time between images, us; with `change` the longest time.
        change: largest change of the log intensity between images. None: fixed steps. Values below half a threshold
            hardly change the times of events.
        shortest_us: smallest interval, us, even if an edge jumps.
        parameters: parameters with the curve of the log. None: the defaults.

    Yields:
        Time, us, and image.

    Raises:
        ModelError: a number is out of its range.

    Source: the idea of adapting the steps to the change of brightness: Rebecq, Gehrig, Scaramuzza,
        "ESIM", CoRL 2018, section 3.2; here by halving, which needs only the scene.
    """
    for name, value in (("step_us", step_us), ("shortest_us", shortest_us)):
        argument(name, value, kind="microseconds", at_least=1)
    if stop_us < start_us:
        raise ModelError(f"stop_us is {stop_us}, expected at least start_us, {start_us}")
    argument("change", change, above=0, optional=True)
    return _frames(scene, start_us, stop_us, step_us, change, shortest_us, parameters or DVSParameters())


def _frames(
    scene: Scene, start: int, stop: int, step: int, change: float | None, shortest: int, parameters: DVSParameters
) -> Iterator[tuple[int, Image]]:
    """Yield the images of `frames_of`. The stack `pending` holds later images, the next image last."""
    image = np.array(scene(start))
    yield start, image
    time, log = start, _log(image, change, parameters)
    pending: list[tuple[int, Image, npt.NDArray[np.float64]]] = []
    while time < stop:
        if not pending:
            pending.append(_sample(scene, min(time + step, stop), change, parameters))
        while (
            change is not None and pending[-1][0] - time >= 2 * shortest and np.abs(pending[-1][2] - log).max() > change
        ):
            pending.append(_sample(scene, (time + pending[-1][0]) // 2, change, parameters))
        time, image, log = pending.pop()
        yield time, image


def _sample(
    scene: Scene, t: int, change: float | None, parameters: DVSParameters
) -> tuple[int, Image, npt.NDArray[np.float64]]:
    image = np.array(scene(t))
    return t, image, _log(image, change, parameters)


def _log(image: Image, change: float | None, parameters: DVSParameters) -> npt.NDArray[np.float64]:
    """Return the log intensity, or an empty array for fixed steps. `DVS.see` reports invalid intensities."""
    if change is None:
        return np.zeros(0)
    return parameters.log_intensity(np.clip(shares(image), 0.0, 1e300))
