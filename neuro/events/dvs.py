"""A model of the pixels of an event camera: events from images with times."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from neuro.events._events import EVENT, Events

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16] | npt.NDArray[np.floating]

Found = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.uint8]]

_MIN_THRESHOLD = 0.01
_NONE: Found = (np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint8))


@dataclass(frozen=True, slots=True)
class DVSParameters:
    """What the pixels of an event camera are like.

    Attributes:
        threshold_on: rise of the natural log of the intensity that makes an ON event (C of eq. 20).
        threshold_off: fall that makes an OFF event (C of eq. 21), as a positive number.
        mismatch: standard deviation of the thresholds from pixel to pixel, log units; a threshold is
            never less than 0.01.
        refractory: time after an event in which the pixel sees nothing, us; its reference is what it
            sees when it wakes.
        leak: ON events of a pixel that looks at nothing, Hz.
        noise: further events at random times, ON and OFF alike, Hz per pixel.
        floor: intensity added before the logarithm (dark current), as a share of full scale.

    Raises:
        ValueError: a value is out of its range.

    Source: thesis eqs 20-21, lines 796-800. Sizes of the defaults: Lichtsteiner et al., IEEE JSSC
        43:566, 2008 (thresholds, mismatch); Nozaki and Delbruck, IEEE TED 64:3239, 2017 (leak).
    """

    threshold_on: float = 0.2
    threshold_off: float = 0.2
    mismatch: float = 0.03
    refractory: float = 100.0
    leak: float = 0.1
    noise: float = 0.1
    floor: float = 0.005

    def __post_init__(self) -> None:
        lowest = {"threshold_on": _MIN_THRESHOLD, "threshold_off": _MIN_THRESHOLD, "floor": 1e-9}
        for field in fields(self):
            value, low = getattr(self, field.name), lowest.get(field.name, 0.0)
            if not low <= value < np.inf:
                raise ValueError(f"{field.name} is {value}, expected a number of at least {low}")


class DVS:
    """An event camera that is shown images one after the other.

    Between two images the log intensity of a pixel is taken to go in a straight line, so events have
    times of their own between those of the images. A pixel compares with its intensity at its last
    event; leak is a slow rise of that difference. Every draw depends on seed, pixel and the count of
    draws only: the same images give the same events.

    Args:
        sensor_size: width and height, px.
        parameters: of the pixels; None takes the defaults.
        seed: of thresholds and noise, not negative.

    Example:
        >>> import numpy as np
        >>> camera = DVS((2, 1), DVSParameters(mismatch=0.0, noise=0.0, leak=0.0, refractory=0.0))
        >>> len(camera.feed(0, np.array([[0.1, 0.1]])))
        0
        >>> camera.feed(1000, np.array([[0.1, 0.2]])).t
        array([298, 597, 896])
    """

    def __init__(self, sensor_size: tuple[int, int], parameters: DVSParameters | None = None, *, seed: int = 0) -> None:
        if seed < 0:
            raise ValueError(f"seed is {seed}, expected 0 or more")
        self.sensor_size = (int(sensor_size[0]), int(sensor_size[1]))
        self.parameters = parameters or DVSParameters()
        self.seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget all images; the camera is as new."""
        n = self.sensor_size[0] * self.sensor_size[1]
        p = self.parameters
        spread = np.random.default_rng([self.seed, 1]).normal(0.0, p.mismatch, (2, n))
        self._on = np.maximum(p.threshold_on + spread[0], _MIN_THRESHOLD)
        self._off = np.maximum(p.threshold_off + spread[1], _MIN_THRESHOLD)
        self._change = np.zeros(n)
        self._listen = np.full(n, -np.inf)
        self._noise_time = np.full(n, np.inf)
        self._noise_number = np.zeros(n, np.int64)
        self._log: npt.NDArray[np.float64] | None = None
        self._t = 0

    def feed(self, t_us: int, image: Image) -> Events:
        """Show the next image.

        Args:
            t_us: its time, us; more than that of the image before.
            image: (height, width) intensities, linear in light: integers, whose type's largest value
                is full scale, or floats of which 1 is full scale. Not negative.

        Returns:
            The events between the image before and this one, by time; none for the first image.

        Raises:
            ValueError: another shape, time not later, or an intensity that is negative or not finite.
        """
        log1 = self._log_intensity(image)
        if self._log is None:
            if self.parameters.noise:
                self._noise_time[:] = float(t_us)
            self._t, self._log = int(t_us), log1
            return _events([_NONE], self.sensor_size)
        if not t_us > self._t:
            raise ValueError(f"image at {t_us} us, expected later than the one before, at {self._t} us")
        found = self._advance(self._log, log1, int(t_us))
        self._t, self._log = int(t_us), log1
        return _events(found, self.sensor_size)

    def _advance(self, log0: npt.NDArray[np.float64], log1: npt.NDArray[np.float64], t1: int) -> list[Found]:
        from neuro.events._dvs_kernels import advance

        p = self.parameters
        noise_mean = 1e6 / p.noise if p.noise else np.inf
        found: list[Found] = []
        pixel, room = 0, max(1024, len(log0) // 4)
        while pixel < len(log0):
            t, i, on = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.uint8)
            n, pixel = advance(
                pixel, log0, log1, self._t, t1, self._change, self._listen, self._on, self._off,
                float(p.refractory), 1e-6 * p.leak, self.seed % 2**63, noise_mean,
                self._noise_time, self._noise_number, t, i, on,
            )  # fmt: skip
            found.append((t[:n], i[:n], on[:n]))
            room *= 4
        return found

    def _log_intensity(self, image: Image) -> npt.NDArray[np.float64]:
        width, height = self.sensor_size
        if image.shape != (height, width):
            raise ValueError(f"image has shape {image.shape}, expected ({height}, {width})")
        values = np.asarray(image, np.float64).ravel()
        if image.dtype.kind in "ui":
            values = values / float(np.iinfo(str(image.dtype)).max)
        if not (values.min() >= 0.0 and values.max() < np.inf):
            raise ValueError("image has a negative or infinite intensity, expected 0 or more")
        log_intensity: npt.NDArray[np.float64] = np.log(values + self.parameters.floor)
        return log_intensity


def dvs_events(
    t_us: npt.ArrayLike, images: npt.ArrayLike, parameters: DVSParameters | None = None, *, seed: int = 0
) -> Events:
    """The events of a sequence of images.

    Args:
        t_us: (n,) increasing times, us.
        images: (n, height, width), as for `DVS.feed`.
        parameters: of the pixels; None takes the defaults.
        seed: of thresholds and noise.

    Returns:
        All events, by time.

    Raises:
        ValueError: as of `DVS.feed`.
    """
    stack = np.asarray(images)
    if stack.ndim != 3 or len(stack) != len(np.asarray(t_us)):
        raise ValueError(f"images have shape {stack.shape}, expected ({len(np.asarray(t_us))}, height, width)")
    camera = DVS((stack.shape[2], stack.shape[1]), parameters, seed=seed)
    parts = [camera.feed(int(t), image).records() for t, image in zip(np.asarray(t_us), stack, strict=True)]
    out = np.concatenate(parts) if parts else np.empty(0, EVENT)
    return Events(out["t"], out["x"], out["y"], out["p"], camera.sensor_size)


def _events(found: list[Found], sensor_size: tuple[int, int]) -> Events:
    """What the kernel wrote, by time and then by pixel."""
    t, pixel, p = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(t, kind="stable")
    y, x = np.divmod(pixel[order], sensor_size[0])
    return Events(t[order], x.astype(np.uint16), y.astype(np.uint16), p[order], sensor_size)
