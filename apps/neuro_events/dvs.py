"""A model of the pixels of an event camera: events from images with times, and images of scenes."""

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

Found = tuple[npt.NDArray[np.int64], npt.NDArray[np.int32], npt.NDArray[np.uint8]]

Box = tuple[int, int, int, int]

_KINDS = ("uint8", "uint16", "float16", "float32", "float64")

_FEW = 48
"""Up to so many events are put in order one by one."""


class DVS:
    """An event camera that is shown images one after the other.

    Between two images the log intensity of a pixel is taken to go in a straight line, so events have
    times of their own between those of the images. A pixel compares with its intensity at its last
    event; leak is a slow rise of that difference. Every draw depends on seed, pixel and the count of
    draws only: the same images give the same events. Only pixels that change, or whose leak or noise
    is due, are worked on.

    Args:
        sensor_size: width and height, px.
        parameters: of the pixels; None takes the defaults.
        seed: of thresholds and noise, not negative.

    Raises:
        ModelError: the size or the seed cannot be.

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
        self._whole = (0, 0, *self.sensor_size)
        self.parameters = parameters or DVSParameters()
        self.seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget all images; the camera is as new."""
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
        looked = np.zeros(blocks), *np.zeros((2, blocks), np.int64)
        picked = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
        self._pixels = kernels.Pixels(fixed, state, levels, np.zeros(n), *looked, *picked)
        self._out = _room(max(1024, n // 4))
        self._old: npt.NDArray[Any] | None = None
        self._origin = self._t = 0

    def see(self, image: Image, t_us: int, *, changed: Box | None = None) -> Events:
        """Show the next image.

        Args:
            image: (height, width) intensities, linear in light and not negative: uint8 or uint16, whose
                largest value is full scale, or floats of which 1 is full scale (there may be more).
            t_us: its time, us; more than that of the image before.
            changed: first column and row, and column and row behind the last, of the part that may differ
                from the image before; a promise that saves the comparison of the rest. What differs
                outside is seen then or with a later image. Nothing is asked of the first image.

        Returns:
            The events between the image before and this one, by time; none for the first image.

        Raises:
            ModelError: another shape or type than before, time not later, an intensity that is
                negative or not finite, or `changed` not on the image; the camera is then as it was.
        """
        new, t = self._checked(image, t_us)
        box = self._whole if changed is None else self._inside(changed, t)
        first = self._old is None
        if self._old is None:
            self._start(new.dtype, t)
        assert self._old is not None
        t0, t1 = float(self._t - self._origin), float(t - self._origin)
        pixels = self._pixels
        blocks, bad = kernels.look(new, self._old, first, box, self.sensor_size[0], self._curve.scale, t1, pixels)
        if bad >= 0:
            self._old = None if first else self._old
            raise self._impossible(new, bad, t)
        count = kernels.pick(new, self._old, first, blocks, self._calm, self._curve, t1, pixels)
        found: list[Found] = []
        if first:
            kernels.begin(pixels)
        elif count:
            done = 0
            while done < count:
                n, done = kernels.advance(done, count, t0, t1, self._origin, pixels, self._out)
                found.append((self._out[0][:n], self._out[1][:n], self._out[2][:n]))
                if done < count:
                    self._out = _room(4 * len(self._out[0]))
        kernels.settle(blocks, new, self._old, pixels)
        before, self._t = self._t, t
        return self._sorted(found, before, t)

    def watch(self, images: Iterable[tuple[int, Image]]) -> Iterator[Events]:
        """Show images as they come.

        Args:
            images: time (us) and image, as for `see`; more than one call goes on where the last ended.

        Yields:
            The events before each image but the first.
        """
        for t, image in images:
            first = self._old is None
            events = self.see(image, t)
            if not first:
                yield events

    def record(self, images: Iterable[tuple[int, Image]]) -> Events:
        """All events of `watch` as one recording.

        Args:
            images: as for `watch`.
        """
        columns = joined_columns(e._columns for e in self.watch(images))
        return Events._trusted(*columns, self.sensor_size, {})

    def _checked(self, image: Image, t_us: int) -> tuple[npt.NDArray[Any], int]:
        """The image as a flat array, and its time."""
        array, t = np.asarray(image), int(t_us)
        width, height = self.sensor_size
        where = f"image at {t_us} us"
        if t != t_us:
            raise ModelError(f"{where}: expected a time in whole us")
        if array.shape != (height, width):
            hint = "one grey value for each pixel; mix colours first" if array.ndim == 3 else ""
            raise ModelError(f"{where} has shape {array.shape}, expected ({height}, {width})", hint=hint)
        known = self._old is not None and array.dtype == self._old.dtype
        if not known and str(array.dtype) not in _KINDS:
            raise ModelError(
                f"{where} has type {array.dtype}, expected one of {', '.join(_KINDS)}",
                hint="integers have their type's largest value as full scale, floats have 1",
            )
        if not known and array.dtype == np.float16:
            array = array.astype(np.float32)
        if self._old is not None:
            if array.dtype != self._old.dtype:
                raise ModelError(f"{where} has type {array.dtype}, expected {self._old.dtype} like the one before")
            if t <= self._t:
                raise ModelError(f"{where}: expected a time later than that of the image before, {self._t} us")
        return np.ascontiguousarray(array).reshape(-1), t

    def _inside(self, changed: Box, t: int) -> Box:
        """The part that changed, if it is on the image."""
        width, height = self.sensor_size
        x0, y0, x1, y1 = box = tuple(int(edge) for edge in changed)
        if box != tuple(changed) or not (0 <= x0 <= x1 <= width and 0 <= y0 <= y1 <= height):
            expected = f"x0, y0, x1, y1 with 0 <= x0 <= x1 <= {width} and 0 <= y0 <= y1 <= {height}"
            raise ModelError(f"image at {t} us: changed is {tuple(changed)}, expected {expected}")
        return x0, y0, x1, y1

    def _start(self, kind: np.dtype[Any], t: int) -> None:
        """Take on the type and the time of the first image."""
        self._old = np.zeros(len(self._pixels.due), kind)
        self._origin = self._t = t
        levels = np.arange(np.iinfo(str(kind)).max + 1 if kind.kind == "u" else 0).astype(kind)
        scale = 1.0 / (len(levels) - 1) if len(levels) else 1.0
        self._curve = kernels.Curve(self.parameters.log_intensity(shares(levels)), scale, *self.parameters.curve())

    def _impossible(self, image: npt.NDArray[Any], bad: int, t: int) -> ModelError:
        y, x = divmod(int(bad), self.sensor_size[0])
        text = f"image at {t} us: intensity at x {x}, y {y} is {image[bad]}, expected a finite number of at least 0"
        return ModelError(text)

    def _sorted(self, found: list[Found], before: int, now: int) -> Events:
        """What the kernel wrote, by time and then by pixel."""
        t, pixel, p = found[0] if len(found) == 1 else _joined(found or [_room(0)])
        n, width = len(t), self.sensor_size[0]
        out = empty_columns(n)
        if n <= _FEW:
            kernels.few_in_order(t, pixel, p, width, *out)
        else:
            key = (t - before).astype(np.uint16) if now - before < 65536 else t
            kernels.in_order(t, pixel, p, width, np.argsort(key, kind="stable"), *out)
        return Events._trusted(*out, self.sensor_size, {})


def dvs_events(
    t_us: npt.ArrayLike, images: npt.ArrayLike, parameters: DVSParameters | None = None, *, seed: int = 0
) -> Events:
    """The events of a sequence of images.

    Args:
        t_us: (n,) increasing times, us.
        images: (n, height, width), as for `DVS.see`.
        parameters: of the pixels; None takes the defaults.
        seed: of thresholds and noise.

    Returns:
        All events, by time.

    Raises:
        ModelError: as of `DVS.see`.
    """
    stack, times = np.asarray(images), np.asarray(t_us)
    if stack.ndim != 3 or times.shape != stack.shape[:1]:
        expected = f"({len(times)}, height, width)" if times.ndim == 1 else "(n, height, width) and (n,) times"
        raise ModelError(f"images have shape {stack.shape}, expected {expected}")
    camera = DVS((stack.shape[2], stack.shape[1]), parameters, seed=seed)
    return camera.record(zip(times.tolist(), stack, strict=True))


def _room(n: int) -> Found:
    """Buffers for times, pixels and polarities."""
    return np.empty(n, np.int64), np.empty(n, np.int32), np.empty(n, np.uint8)


def _joined(found: list[Found]) -> Found:
    t, pixel, p = zip(*found, strict=True)
    return np.concatenate(t), np.concatenate(pixel), np.concatenate(p)


Image = npt.NDArray[Any]

LOWEST_THRESHOLD = 0.01
"""A drawn threshold is never less, log units. Source: v2e, emulator.py (`torch.clamp`)."""

GREYS = 255.0
"""v2e's full scale, in whose units its lin-log curve is written."""


@dataclass(frozen=True, slots=True)
class DVSParameters:
    """What the pixels of an event camera are like; the names are v2e's where the meaning is.

    Attributes:
        pos_thres: rise of the natural log of the intensity that makes an ON event.
        neg_thres: fall that makes an OFF event, as a positive number.
        sigma_thres: standard deviation of both from pixel to pixel, log units; none is below 0.01.
        refractory_period_s: time after an event in which the pixel sees nothing, s; its reference is
            what it sees when it wakes.
        leak_rate_hz: ON events of a pixel that looks at nothing, Hz.
        noise_rate_cov_decades: standard deviation of the decimal log of a pixel's leak rate.
        shot_noise_rate_hz: further events at random times, ON and OFF alike, of a pixel in the dark, Hz.
        shot_noise_bright: share of them that is left at full scale; straight in between.
        cutoff_hz: bandwidth (-3 dB) of a pixel at full scale, Hz; lower where it is darker, in
            proportion to the intensity + 8 %; 0 for no limit.
        linear_below: intensity below which the curve is a straight line through 0 in place of the log,
            as a share of full scale; 0 for none.
        floor: intensity that is added to all light (dark current), as a share of full scale.

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
                hint="the log of black is not finite",
            )

    @classmethod
    def ideal(cls, **changes: Any) -> DVSParameters:
        """Equal pixels without noise, leak, refractory period and limit of bandwidth.

        Args:
            **changes: parameters that differ from that.
        """
        nothing = ("sigma_thres", "refractory_period_s", "leak_rate_hz", "shot_noise_rate_hz")
        return cls(**{**dict.fromkeys(nothing, 0.0), **changes})

    def log_intensity(self, light: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """The curve of a pixel: the log of the intensity, a straight line where it is dark.

        Args:
            light: intensities as shares of full scale, any shape.

        Returns:
            Natural log of the share; at `linear_below` both parts meet.

        Source: v2e, emulator_utils.py, `lin_log`: x ln(T)/T up to T = 20 of 255, ln(x) above.
        """
        floor, knee, slope, height = self.curve()
        seen = np.asarray(light, np.float64) + floor
        above = np.log(np.maximum(seen, knee))
        return np.asarray(np.where(seen > knee, above, seen * slope + height))

    def curve(self) -> tuple[float, float, float, float]:
        """What is added to the light, where the log begins, slope and height at 0 of the line below it."""
        knee = self.linear_below
        if knee == 0.0:
            return self.floor, 0.0, 0.0, 0.0
        return self.floor, knee, log(GREYS * knee) / knee, -log(GREYS)


def shares(image: Image) -> npt.NDArray[np.float64]:
    """An image's intensities as shares of full scale.

    Args:
        image: as for `DVS.see`.
    """
    top = float(np.iinfo(str(image.dtype)).max) if image.dtype.kind == "u" else 1.0
    return np.asarray(image, np.float64) / top


Scene = Callable[[int], Image]
"""Time, us, to the image at it."""


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
    """Images of a scene for `DVS.record` or `DVS.watch`, at fixed or at fitting steps.

    Between two images the camera takes the log intensity to go in a straight line. With `change` an
    interval in which any pixel changes by more is halved until it does not; a change that is over
    within one `step_us` is not seen.

    Args:
        scene: called with a time, us; gives an image as for `DVS.see`.
        start_us: of the first image.
        stop_us: of the last one, even where the steps do not fall on it.
        step_us: between images; the longest where `change` is given.
        change: largest change of log intensity from image to image; None for fixed steps. Half a
            threshold gives event times that hardly depend on it.
        shortest_us: no interval is made shorter than this, even where an edge jumps.
        parameters: whose curve makes the log; None takes the defaults.

    Yields:
        Time, us, and image.

    Raises:
        ModelError: a number is out of its range.

    Source: the idea of fitting the steps to the change of brightness: Rebecq, Gehrig, Scaramuzza,
        "ESIM", CoRL 2018, section 3.2; here by halving, so that nothing but the scene is needed.
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
    image = np.array(scene(start))
    yield start, image
    at, log = start, _log(image, change, parameters)
    ahead: list[tuple[int, Image, npt.NDArray[np.float64]]] = []
    while at < stop:
        if not ahead:
            ahead.append(_look(scene, min(at + step, stop), change, parameters))
        while change is not None and ahead[-1][0] - at >= 2 * shortest and np.abs(ahead[-1][2] - log).max() > change:
            ahead.append(_look(scene, (at + ahead[-1][0]) // 2, change, parameters))
        at, image, log = ahead.pop()
        yield at, image


def _look(
    scene: Scene, t: int, change: float | None, parameters: DVSParameters
) -> tuple[int, Image, npt.NDArray[np.float64]]:
    image = np.array(scene(t))
    return t, image, _log(image, change, parameters)


def _log(image: Image, change: float | None, parameters: DVSParameters) -> npt.NDArray[np.float64]:
    """The log intensity, where it is asked for; of impossible intensities the camera tells."""
    if change is None:
        return np.zeros(0)
    return parameters.log_intensity(np.clip(shares(image), 0.0, 1e300))
