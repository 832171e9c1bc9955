"""AEDAT 2.0 of jAER and AEDAT 3.1 of cAER: lines of text, then events of 8 bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events
from neuro_events.formats._format import Damage, Format, Limits, Size
from neuro_events.formats._reading import write_words
from neuro_events.formats._words import (
    HALF,
    OTHER,
    PERIOD,
    SECOND,
    Decoder,
    Field,
    Layout,
    Odd,
    SeekingReader,
    State,
    WordReader,
    encoded,
    first_state,
)
from neuro_events.source import Bytes, Source

word_kernels = LazyModule("neuro_events.formats._word_kernels")

MAGIC_2 = b"#!AER-DAT2.0"
WORD = 8
LOOK = 1 << 14
"""Number of bytes at the beginning of a block to search for an event and its time."""
END_2 = b"#End Of ASCII Header"
"""Beginning of the last header line, in files that have one."""

Addresses = npt.NDArray[np.uint32]

_CHIP = re.compile(rb"# *AEChip: *([\w.$]+)")
_SIZE = re.compile(rb"# Sensor size: (\d{1,5})x(\d{1,5})\r?\n")


@dataclass(frozen=True, slots=True)
class _Chip:
    """A camera and its layout of words.

    Attributes:
        name: short name, such as "DAVIS346".
        title: name of jAER's class, for the header.
        name_pattern: pattern of the names of jAER's classes with this layout, in lower case.
        size: width and height of the sensor, px.
        layout: layout of the words. Words that are not events are counted in two kinds: samples are the first kind,
            external events the second.
    """

    name: str
    title: str
    name_pattern: str
    size: Size
    layout: Layout

    @property
    def is_turned(self) -> bool:
        """True if addresses count columns from the right and rows from the bottom."""
        return self.layout.x.backwards > 0

    def foreign(self, addresses: Addresses) -> npt.NDArray[np.bool_]:
        """Return True for addresses that no word of this chip can have."""
        layout = self.layout
        is_sample = addresses & np.uint32(layout.first) != 0
        bits = sum(((1 << field.bits) - 1) << field.shift for field in (layout.x, layout.y, layout.p))
        external = layout.odd.mask & ~(layout.first | layout.none)
        impossible = ~np.uint32(bits | external)
        return np.asarray(addresses & np.where(is_sample, np.uint32(layout.none), impossible) != 0)


def _layout(x: Field, y: Field, p: Field, sample: int, external: int, none: int = 0) -> Layout:
    """Return the layout of a big-endian address and a big-endian time.

    The bits `sample` and `external` of an address mark words that are not events. The bits `none` are always 0.
    """
    odd = Odd(sample | external | none)
    return Layout(WORD, Field(0, 32, byte=4), x, y, p, odd, none=none, first=sample, rule=HALF, is_big=True)


def _davis(name: str, title: str, name_pattern: str, size: Size) -> _Chip:
    columns, rows = Field(12, 10, backwards=size[0]), Field(22, 9, backwards=size[1])
    layout = _layout(columns, rows, Field(11, 1), sample=1 << 31, external=1 << 10)
    return _Chip(name, f"eu.seebetter.ini.chips.davis.{title}", name_pattern, size, layout)


_DVS128 = _Chip(
    "DVS128", "ch.unizh.ini.jaer.chip.retina.DVS128", "dvs128|tmpdiff128", (128, 128),
    _layout(
        Field(1, 7), Field(8, 7), Field(0, 1, backwards=2), sample=0, external=1 << 31 | 1 << 15, none=0x7FFF0000
    ),
)  # fmt: skip
_DAVIS346 = _davis("DAVIS346", "Davis346blue", r"davi[a-z]*346", (346, 260))
_CHIPS = (
    _DVS128,
    _davis("DAVIS240", "DAVIS240C", r"davi[a-z]*240|dvs240|sbret10", (240, 180)),
    _DAVIS346,
    _davis("DAVIS640", "Davis640", r"davi[a-z]*640|cdavis", (640, 480)),
)
"""Cameras whose layouts the writer uses, by the size of the sensor."""
_READABLE = (
    *_CHIPS,
    _davis("DAVIS128", "Davis128", r"davi[a-z]*128", (128, 128)),
    _davis("DAVIS208", "Davis208PixelParade", r"davi[a-z]*208", (208, 192)),
    _Chip(
        "DVS640", "ch.unizh.ini.jaer.chip.retina.DVS640", "dvs640", (640, 480),
        _layout(
            Field(1, 10, backwards=640), Field(11, 10, backwards=480), Field(0, 1), sample=0, external=1 << 31,
            none=0x7FE00000,
        ),
    ),
)  # fmt: skip
"""Cameras whose layouts are read. If two of them have the same size, the first that fits the addresses is used."""
_SIZES = ", ".join(dict.fromkeys("{}x{}".format(*chip.size) for chip in sorted(_READABLE, key=lambda chip: chip.size)))
_NAMES = ", ".join(chip.name.lower() for chip in _READABLE)
_WAY_OUT = (
    f"sensor_size=(346, 260), or --sensor 346x260, chooses the camera by its sensor ({_SIZES}; 128x128 is the DVS128), "
    f"format='aedat2:davis128', or --from aedat2:davis128, by its name ({_NAMES})"
)
_NO_NAME = "no line '# AEChip:' names the camera"


class Aedat2(SeekingReader):
    """A reader of AEDAT 2.0 files.

    ``metadata`` has the ``chip`` and, for the part that was read, the number of ``other_words`` (samples of pixels and
    of the inertial sensor) and of ``external_events``. Both are skipped.

    A file has lines that begin with ``#`` and end with CR LF, then words of a big-endian 32-bit address and a
    big-endian 32-bit time in us. After each wrap of the time 2^32 us are added.

    DVS128 address: bit 0 polarity (0 = ON), bits 1-7 x, bits 8-14 y, bit 15 or 31 set for an external event.
    DAVIS address: bit 31 clear, y in bits 22-30, x in bits 12-21, bit 11 polarity (1 = ON); bit 10 marks an external
    event, and bit 31 a sample of the pixels or of the inertial sensor.

    The header may name the chip. Without a name the chip is a DVS128 if the first 16 KiB contain only addresses that
    are possible for a DVS128 and impossible for a DAVIS. `camera` or `use_sensor` choose another chip.

    x of events grows to the right and y downwards. Addresses of DAVIS count columns from the right and rows from the
    bottom, e.g. address x 245, y 209 of a DAVIS346 is the event at x 100, y 50. Addresses of the DVS128 equal the
    event's x and y, as in the published arrays of POKER-DVS, which are upright. The pixels of DavisRGBW640 have the
    addresses of a DAVIS640.

    v2e names no chip. Its files of 640x480 have addresses of jAER's DVS640: bit 0 polarity (1 = ON), x in bits 1-10,
    y in bits 11-20, with columns and rows reversed as for DAVIS.

    Args:
        source: the file.
        camera: name of the camera, such as "davis346", which overrides the header; "": as the header states.

    Source: "AEDAT 2.0" at docs.inivation.com; names of the chips, columns and rows of DAVIS, external events: jAER,
        ``DavisBaseCamera.DavisEventExtractor``, ``DVS128``, ``DVS640`` and v2e, ``aedat2_output.py``; polarity and axes
        of the DVS128 as in the published arrays of POKER-DVS.
    """

    way_out = _WAY_OUT

    def __init__(self, source: Source, camera: str = "") -> None:
        lines, _ = header(source, MAGIC_2, END_2)
        self.source, self.start = source, len(lines)
        size, match = _size(lines), _CHIP.search(lines)
        name = match.group(1).decode("ascii", "replace") if match else ""
        chip = _find_chip(camera or name)
        if camera and chip is None:
            raise Damage(f"the camera is given as {camera!r:.40}, expected one of {_NAMES}", None)
        self._is_known = chip is not None
        self._is_certain = self._is_known and bool(camera or size)
        self._unknown = (f"unknown chip {name}", match.start(1)) if match else None
        self._use(chip or _DVS128, size)

    @property
    def sensor_size(self) -> Size | None:
        """Width and height of the sensor, px.

        Raises:
            Damage: the camera is unknown, because `use_sensor` was not called, and the header names an unknown chip.
                The same applies if the header names no chip, and the first addresses may be from another chip than a
                DVS128.
        """
        if not self._is_known:
            if self._unknown:
                raise Damage(f"{self._unknown[0]}: {_WAY_OUT}", self._unknown[1])
            addresses = self._first_addresses()
            foreign = _DVS128.foreign(addresses)
            if foreign.any():
                k = int(foreign.argmax())
                problem = f"{_NO_NAME}, and address 0x{addresses[k]:08x} is impossible for a DVS128"
                raise Damage(f"{problem}: {_WAY_OUT}", self.start + WORD * k)
            if addresses.size and not _DAVIS346.foreign(addresses).any():
                problem = f"{_NO_NAME}, and the addresses may be from a DVS128 or a DAVIS"
                raise Damage(f"{problem}: {_WAY_OUT}", self.start)
        return self._size

    def _use(self, chip: _Chip, size: Size | None) -> None:
        self._chip, self._size, self.layout = chip, size or chip.size, chip.layout
        self.metadata = {"chip": chip.name, "other_words": 0, "external_events": 0}

    def use_sensor(self, size: Size) -> None:
        """Use the layout of the camera with this sensor; see `Sized`.

        The layout of the chip that the header names is kept if no camera of this sensor size fits the addresses.
        """
        if self._is_certain or (self._is_known and size == self._size):
            return
        is_small = size[0] <= _DVS128.size[0] and size[1] <= _DVS128.size[1]
        chips = [_DVS128] if is_small else [chip for chip in _READABLE if chip.size == size]
        addresses = self._first_addresses()
        fitting = [chip for chip in chips if not chip.foreign(addresses).any()]
        if not self._is_known:
            if not chips:
                problem = self._unknown[0] if self._unknown else _NO_NAME
                raise Damage(f"{problem}, and no camera has a sensor of {size[0]}x{size[1]}: {_WAY_OUT}", self.start)
            self._use((fitting or chips)[0], size)
            self._is_known = True
        elif (
            fitting
            and fitting[0].size == size
            # Any address of a DVS128 is also possible for a DVS640. In this case the name decides.
            and (fitting[0].is_turned == self._chip.is_turned or self._chip.foreign(addresses).any())
        ):
            self._use(fitting[0], size)

    def _first_addresses(self) -> Addresses:
        return _addresses(np.frombuffer(self.source.head(self.start + LOOK)[self.start :], np.uint8))

    def clocks(self, step: int) -> Iterator[tuple[int, int]]:
        """Yield the first byte and the time of the first event of each block that begins with events.

        Other words are skipped, because their times may run back.
        """
        mask = np.uint32(self.layout.odd.mask & ~self.layout.none)
        for place, data in self.source.samples(self.start, step, min(step, LOOK)):
            events = np.flatnonzero((_addresses(data) & mask) == 0)
            if events.size:
                at = WORD * int(events[0])
                yield place, int.from_bytes(data[at + 4 : at + 8].tobytes(), "big")

    def count(self, state: State) -> None:
        """Update the numbers of skipped words in the metadata; see `WordReader`."""
        self.metadata |= {"other_words": int(state[OTHER]), "external_events": int(state[SECOND])}

    def stop_reason(self, rest: Bytes) -> str:
        """Return the fault at which the decoder stopped; see `WordReader`."""
        return f"address 0x{_addresses(rest[:WORD])[0]:08x} is impossible for a {self._chip.name}: {_WAY_OUT}"


def _addresses(data: Bytes) -> Addresses:
    words = data[: data.size // WORD * WORD].tobytes()
    return np.frombuffer(words, ">u4")[::2].astype(np.uint32)


def _find_chip(name: str) -> _Chip | None:
    """Return the chip for a name, such as a class of jAER, or None."""
    last = re.split(r"[.$]", name)[-1].lower()
    return next((chip for chip in _READABLE if re.match(chip.name_pattern, last)), None)


def _size(lines: bytes) -> Size | None:
    """Return the sensor size that `write` stores in the header, or None."""
    match = _SIZE.search(lines)
    if match is None:
        return None
    width, height = int(match.group(1)), int(match.group(2))
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise Damage(f"sensor size {width}x{height}, expected 1x1 to 65536x65536", match.start(1))
    return width, height


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as AEDAT 2.0 of the smallest camera with room for the sensor. The header states the size."""
    write_words(parts, path, _new_header, _encode_part)


def _smallest(size: Size) -> _Chip:
    """Return the smallest camera with at least this sensor size, else the largest camera."""
    return next((chip for chip in _CHIPS if size[0] <= chip.size[0] and size[1] <= chip.size[1]), _CHIPS[-1])


def _encode_part(n_before: int, events: Events) -> bytes:
    chip = _smallest(events.sensor_size)
    Limits(PERIOD, *chip.size).check(events, n_before)
    return encoded(chip.layout, events).tobytes()


def _new_header(sensor: Size | None) -> bytes:
    chip = _DVS128 if sensor is None else _smallest(sensor)
    size = "" if sensor is None else f"# Sensor size: {sensor[0]}x{sensor[1]}\r\n"
    text = (
        "#!AER-DAT2.0\r\n"
        "# This is a raw AE data file - do not edit\r\n"
        "# Data format is int32 address, int32 timestamp (8 bytes total), repeated for each event\r\n"
        "# Timestamps tick is 1 us\r\n"
        f"# AEChip: {chip.title}\r\n{size}{END_2.decode()}\r\n"
    )
    return text.encode("ascii")


AEDAT2 = Format(
    "aedat2", "AEDAT 2.0", (".aedat", ".aedat2"), lambda head: head.startswith(MAGIC_2), Aedat2, write,
    holds=lambda events, last: Limits(PERIOD, *_smallest(events.sensor_size).size).holds(events),
    grows=True, inside=Aedat2,
)  # fmt: skip
"""AEDAT 2.0, read and written."""


MAGIC_3 = b"#!AER-DAT3.1"
END_3 = b"#!END-HEADER"
EVENT = 8
LAYOUT_3 = Layout(EVENT, Field(0, 32, byte=4), Field(17, 15), Field(2, 15), Field(1, 1), Odd(1, 1), is_signed=True)
SIZES = {"DVS128": (128, 128), "DAVIS128": (128, 128), "DAVIS208": (208, 192), "DAVIS240": (240, 180),
         "DAVIS346": (346, 260), "DAVIS640": (640, 480)}  # fmt: skip
"""Sensor sizes, px, by the beginning of a camera's name."""

_FORMAT = re.compile(rb"#Format: *(\S+)")
_CAMERA = re.compile(rb"\n#Source (\d{1,5}): *([\w-]+)")
_START = re.compile(rb"#Start-Time: *([\x20-\x7e]+)")


class Aedat3(WordReader):
    """A reader of AEDAT 3.1 files.

    ``metadata`` has ``camera`` and ``start``, if stated, and, for the part that was read, the numbers of skipped
    ``other_events`` and ``invalid_events``.

    A file has lines that begin with ``#``, the last ``#!END-HEADER``, then packets of little-endian numbers: a header
    of 28 bytes (type and camera, int16; size of an event, offset of its time, overflows of the time, capacity, number
    and number of valid events, int32), then the events. Type 1 is polarity events of 8 bytes: bit 0 valid, bit 1
    polarity (1 = ON), bits 2-16 y downwards, bits 17-31 x, then the time in us (31 bits), to which each overflow of the
    packet adds 2^31.

    Events of other types and invalid events are skipped and counted. If a file has several cameras, only the first one
    is read. Packets must be uncompressed ("#Format: RAW").

    Source: "AEDAT 3.1" at docs.inivation.com; the bits also as in the README of DVS Gesture (Amir et al., CVPR 2017).
    """

    def __init__(self, source: Source) -> None:
        lines, has_end = header(source, MAGIC_3, END_3)
        if not has_end:
            raise Damage(f"the header does not end, expected a line {END_3.decode()}", len(lines))
        match = _FORMAT.search(lines)
        if match and match.group(1) != b"RAW":
            coding = match.group(1).decode("ascii", "replace")
            raise Damage(f"packets are stored as {coding}, expected RAW", match.start(1))
        self.source, self.start = source, len(lines)
        cameras = [(int(number), name.decode()) for number, name in _CAMERA.findall(lines)]
        self._camera = cameras[0][0] if len(cameras) > 1 else -1
        self.sensor_size: Size | None = None
        self.metadata = {"other_events": 0, "invalid_events": 0}
        if cameras:
            name = cameras[0][1]
            self.metadata["camera"] = name
            self.sensor_size = next((size for prefix, size in SIZES.items() if name.upper().startswith(prefix)), None)
        if start := _START.search(lines):
            self.metadata["start"] = start.group(1).decode()

    def decoder(self) -> Decoder:
        """Return a new decoder; see `WordReader`."""
        state = first_state(more=3)
        state[word_kernels.CAMERA] = self._camera
        return Decoder(word_kernels.packet_decoder(LAYOUT_3), state, EVENT, unit=1)

    def count(self, state: State) -> None:
        """Update the numbers of skipped events in the metadata; see `WordReader`."""
        self.metadata |= {"other_events": int(state[SECOND]), "invalid_events": int(state[OTHER])}

    def stop_reason(self, rest: Bytes) -> str:
        """Return the fault at which the decoder stopped; see `WordReader`."""
        return "expected the header of a packet"

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """Check the end of the file; see `WordReader`."""
        if missing := int(decoder.state[word_kernels.SKIP] + decoder.state[word_kernels.LEFT] * EVENT):
            raise Damage(f"the last packet is cut, {missing - rest.size} bytes are missing", end)
        if rest.size:
            raise Damage(f"{rest.size} bytes left over after the last packet", end)


AEDAT3 = Format(
    "aedat3", "AEDAT 3.1", (".aedat", ".aedat3"), lambda head: head.startswith(MAGIC_3), Aedat3,
    untested="no recording of this format was available; made from the specification",
)  # fmt: skip
"""AEDAT 3.1, read only."""


HEADER_STEP = 1 << 16
"""Number of bytes to search first for the end of the header; doubled until the header ends."""

_HEADER_LINE = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n")
_PART_OF_LINE = re.compile(rb"(#[\t\x20-\x7e\x80-\xff]*\r?)?")


def header(source: Source, magic: bytes, last: bytes) -> tuple[bytes, bool]:
    """Return the lines before the data.

    Data may begin with the byte of ``#``, but a line of text has no control characters.

    Args:
        source: the file.
        magic: beginning of the first line.
        last: beginning of the line that ends the header.

    Returns:
        The lines, and True if the last one ends the header.

    Raises:
        Damage: the first line differs from `magic` or does not end.
    """
    beginning = source.head(len(magic))
    if beginning != magic:
        raise Damage(f"begins with {beginning!r}, expected the line {magic.decode()}", 0)
    count = HEADER_STEP
    while True:
        text = source.head(count)
        has_end, length = _lines(text, last)
        if has_end or len(text) < count or not _PART_OF_LINE.fullmatch(text, length):
            break
        count *= 2
    if length == 0:
        raise Damage("the first line does not end", len(magic))
    return text[:length], has_end


def _lines(text: bytes, last: bytes) -> tuple[bool, int]:
    """Return whether the text has the line that ends the header, and the length of the header lines."""
    begin = 0
    while line := _HEADER_LINE.match(text, begin):
        begin = line.end()
        if line.group().startswith(last):
            return True, begin
    return False, begin
