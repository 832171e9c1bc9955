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
"""Bytes of a block in which an event is looked for, to learn its time."""
END_2 = b"#End Of ASCII Header"
"""How the last line begins, in files that have it."""

Addresses = npt.NDArray[np.uint32]

_CHIP = re.compile(rb"# *AEChip: *([\w.$]+)")
_SIZE = re.compile(rb"# Sensor size: (\d{1,5})x(\d{1,5})\r?\n")


@dataclass(frozen=True, slots=True)
class _Chip:
    """A camera.

    Attributes:
        named: pattern of the names that jAER's classes of this layout have, in lower case.
        layout: of its words; of those that are no events, the first kind are samples, the second external events.
    """

    name: str
    title: str
    named: str
    size: Size
    layout: Layout

    @property
    def is_turned(self) -> bool:
        """Whether addresses count columns from the right and rows from the bottom."""
        return self.layout.x.backwards > 0

    def foreign(self, addresses: Addresses) -> npt.NDArray[np.bool_]:
        """Return which addresses have bits that neither an event nor another word of this chip has."""
        layout = self.layout
        is_sample = addresses & np.uint32(layout.first) != 0
        bits = sum(((1 << field.bits) - 1) << field.shift for field in (layout.x, layout.y, layout.p))
        external = layout.odd.mask & ~(layout.first | layout.none)
        free = ~np.uint32(bits | external)
        return np.asarray(addresses & np.where(is_sample, np.uint32(layout.none), free) != 0)


def _layout(x: Field, y: Field, p: Field, sample: int, external: int, none: int = 0) -> Layout:
    """The layout of a big-endian address, in which some bits mark other words or are never set, and a time."""
    odd = Odd(sample | external | none)
    return Layout(WORD, Field(0, 32, byte=4), x, y, p, odd, none=none, first=sample, rule=HALF, is_big=True)


def _davis(name: str, title: str, named: str, size: Size) -> _Chip:
    columns, rows = Field(12, 10, backwards=size[0]), Field(22, 9, backwards=size[1])
    layout = _layout(columns, rows, Field(11, 1), sample=1 << 31, external=1 << 10)
    return _Chip(name, f"eu.seebetter.ini.chips.davis.{title}", named, size, layout)


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
"""Layouts that are written, by the size of the sensor."""
_READ = (
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
"""All layouts; of two with one size the first is taken that the addresses fit."""
_SIZES = ", ".join(dict.fromkeys("{}x{}".format(*chip.size) for chip in sorted(_READ, key=lambda chip: chip.size)))
_NAMES = ", ".join(chip.name.lower() for chip in _READ)
_WAY_OUT = (
    f"sensor_size=(346, 260), or --sensor 346x260, chooses the camera by its sensor ({_SIZES}; 128x128 is the DVS128), "
    f"format='aedat2:davis128', or --from aedat2:davis128, by its name ({_NAMES})"
)
_NO_NAME = "no line '# AEChip:' names the camera"


class Aedat2(SeekingReader):
    """An open AEDAT 2.0 file.

    ``metadata`` has ``chip`` and, for what was read so far, ``other_words``: samples of pixels and of the inertial
    sensor, and ``external_events``; both are left out.

    Lines that begin with ``#`` and end with CR LF, then words of a big-endian 32-bit address and a
    big-endian 32-bit time in us. The time wraps; from then on 2^32 us are added.

    DVS128 address: bit 0 polarity (0 = ON), bits 1-7 x, bits 8-14 y, bit 15 or 31 set for an external event.
    DAVIS address: bit 31 clear, y in bits 22-30, x in bits 12-21, bit 11 polarity (1 = ON); bit 10 marks an
    external event and bit 31 a sample of the pixels or of the inertial sensor.

    The header may name the chip. Without a name it is a DVS128 if the first 16 KiB have only addresses of that and are
    no possible addresses of a DAVIS; `camera` or `use_sensor` choose another.

    Events have x rightwards and y downwards. Addresses of DAVIS count columns from the right and rows from the bottom,
    e.g. address x 245, y 209 of a DAVIS346 is the event at x 100, y 50. Addresses of the DVS128 are the event's x and
    y: so the arrays published of POKER-DVS, which stand upright, have them. The pixels of DavisRGBW640 have the
    addresses of a DAVIS640.

    v2e names no chip. Its files of 640x480 have addresses of jAER's DVS640: bit 0 polarity (1 = ON), x in bits 1-10,
    y in bits 11-20, turned as those of DAVIS.

    Args:
        source: the file.
        camera: name of the camera, such as "davis346", whatever the header names; "": the header tells it.

    Source: "AEDAT 2.0" at docs.inivation.com; names of the chips, columns and rows of DAVIS, external events: jAER,
    ``DavisBaseCamera.DavisEventExtractor``, ``DVS128``, ``DVS640`` and v2e, ``aedat2_output.py``; polarity and axes of
    the DVS128 as in the published arrays of POKER-DVS.
    """

    way_out = _WAY_OUT

    def __init__(self, source: Source, camera: str = "") -> None:
        lines, _ = header(source, MAGIC_2, END_2)
        self.source, self.start = source, len(lines)
        size, match = _size(lines), _CHIP.search(lines)
        name = match.group(1).decode("ascii", "replace") if match else ""
        chip = _named(camera or name)
        if camera and chip is None:
            raise Damage(f"the camera is given as {camera!r:.40}, expected one of {_NAMES}", None)
        self._is_known = chip is not None
        self._is_certain = self._is_known and bool(camera or size)
        self._unknown = (f"chip {name} is not known", match.start(1)) if match else None
        self._use(chip or _DVS128, size)

    @property
    def sensor_size(self) -> Size | None:
        """Width and height.

        Raises:
            Damage: `use_sensor` was not called, and the header names an unknown chip, or none and the first addresses
                are not those of a DVS128 alone.
        """
        if not self._is_known:
            if self._unknown:
                raise Damage(f"{self._unknown[0]}: {_WAY_OUT}", self._unknown[1])
            addresses = self._first_addresses()
            foreign = _DVS128.foreign(addresses)
            if foreign.any():
                k = int(foreign.argmax())
                what = f"{_NO_NAME}, and address 0x{addresses[k]:08x} is none of a DVS128"
                raise Damage(f"{what}: {_WAY_OUT}", self.start + WORD * k)
            if addresses.size and not _DAVIS346.foreign(addresses).any():
                what = f"{_NO_NAME}, and the addresses may be those of a DVS128 or of a DAVIS"
                raise Damage(f"{what}: {_WAY_OUT}", self.start)
        return self._size

    def _use(self, chip: _Chip, size: Size | None) -> None:
        self._chip, self._size, self.layout = chip, size or chip.size, chip.layout
        self.metadata = {"chip": chip.name, "other_words": 0, "external_events": 0}

    def use_sensor(self, size: Size) -> None:
        """Take the layout of the camera with this sensor; see `Sized`.

        The chip that the header names stays if no camera, or none that the addresses fit, has a sensor of this size.
        """
        if self._is_certain or (self._is_known and size == self._size):
            return
        is_small = size[0] <= _DVS128.size[0] and size[1] <= _DVS128.size[1]
        chips = [_DVS128] if is_small else [chip for chip in _READ if chip.size == size]
        addresses = self._first_addresses()
        fitting = [chip for chip in chips if not chip.foreign(addresses).any()]
        if not self._is_known:
            if not chips:
                what = self._unknown[0] if self._unknown else _NO_NAME
                raise Damage(f"{what}, and no camera has a sensor of {size[0]}x{size[1]}: {_WAY_OUT}", self.start)
            self._use((fitting or chips)[0], size)
            self._is_known = True
        elif (
            fitting
            and fitting[0].size == size
            # Any address of a DVS128 is one of a DVS640, too: then the name decides.
            and (fitting[0].is_turned == self._chip.is_turned or self._chip.foreign(addresses).any())
        ):
            self._use(fitting[0], size)

    def _first_addresses(self) -> Addresses:
        return _addresses(np.frombuffer(self.source.head(self.start + LOOK)[self.start :], np.uint8))

    def clocks(self, step: int) -> Iterator[tuple[int, int]]:
        """The time of the first event of each block that has one; other words may have times that run back."""
        other = np.uint32(self.layout.odd.mask & ~self.layout.none)
        for place, data in self.source.samples(self.start, step, min(step, LOOK)):
            events = np.flatnonzero((_addresses(data) & other) == 0)
            if events.size:
                at = WORD * int(events[0])
                yield place, int.from_bytes(data[at + 4 : at + 8].tobytes(), "big")

    def count(self, state: State) -> None:
        """See `WordReader`."""
        self.metadata |= {"other_words": int(state[OTHER]), "external_events": int(state[SECOND])}

    def stop_reason(self, rest: Bytes) -> str:
        """See `WordReader`."""
        return f"address 0x{_addresses(rest[:WORD])[0]:08x} is none of a {self._chip.name}: {_WAY_OUT}"


def _addresses(data: Bytes) -> Addresses:
    whole = data[: data.size // WORD * WORD].tobytes()
    return np.frombuffer(whole, ">u4")[::2].astype(np.uint32)


def _named(name: str) -> _Chip | None:
    """Return the chip of a name, such as that of jAER's class, None where it is not known."""
    last = re.split(r"[.$]", name)[-1].lower()
    return next((chip for chip in _READ if re.match(chip.named, last)), None)


def _size(lines: bytes) -> Size | None:
    """The size that `write` puts into the header."""
    found = _SIZE.search(lines)
    if found is None:
        return None
    width, height = int(found.group(1)), int(found.group(2))
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise Damage(f"sensor size {width}x{height}, expected 1x1 to 65536x65536", found.start(1))
    return width, height


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as AEDAT 2.0 of the smallest camera that has the sensor's size, which a line of the header keeps."""
    write_words(parts, path, _new_header, _encoded)


def _smallest(size: Size) -> _Chip:
    """The chip of the smallest camera that has a sensor's size, else the largest."""
    return next((chip for chip in _CHIPS if size[0] <= chip.size[0] and size[1] <= chip.size[1]), _CHIPS[-1])


def _encoded(done: int, events: Events) -> bytes:
    chip = _smallest(events.sensor_size)
    Limits(PERIOD, *chip.size).check(events, done)
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
"""Read and written."""


MAGIC_3 = b"#!AER-DAT3.1"
END_3 = b"#!END-HEADER"
EVENT = 8
LAYOUT_3 = Layout(EVENT, Field(0, 32, byte=4), Field(17, 15), Field(2, 15), Field(1, 1), Odd(1, 1), is_signed=True)
SIZES = {"DVS128": (128, 128), "DAVIS128": (128, 128), "DAVIS208": (208, 192), "DAVIS240": (240, 180),
         "DAVIS346": (346, 260), "DAVIS640": (640, 480)}  # fmt: skip
"""px, by how the name of a camera begins."""

_FORMAT = re.compile(rb"#Format: *(\S+)")
_CAMERA = re.compile(rb"\n#Source (\d{1,5}): *([\w-]+)")
_START = re.compile(rb"#Start-Time: *([\x20-\x7e]+)")


class Aedat3(WordReader):
    """An open AEDAT 3.1 file.

    ``metadata`` has ``camera`` and ``start``, where stated, and, for what was read so far, ``other_events`` and
    ``invalid_events``, which are left out.

    Lines that begin with ``#``, the last ``#!END-HEADER``, then packets of little-endian numbers: a header of 28 bytes
    (type and camera, int16; bytes of an event, byte of its time, overflows of the time, room, number and number of
    valid events, int32), then the events. Those of type 1 are polarity events of 8 bytes: bit 0 valid, bit 1 polarity
    (1 = ON), bits 2-16 y downwards, bits 17-31 x, then the time in us (31 bits), to which each overflow of the packet
    adds 2^31.

    Events of other types and invalid ones are left out and counted. Of a file with several cameras, the first one's
    events are given. Packets must be stored as they are ("#Format: RAW").

    Source: "AEDAT 3.1" at docs.inivation.com; the bits also as in the README of DVS Gesture (Amir et al., CVPR 2017).
    """

    def __init__(self, source: Source) -> None:
        lines, ended = header(source, MAGIC_3, END_3)
        if not ended:
            raise Damage(f"the header does not end, expected a line {END_3.decode()}", len(lines))
        stored = _FORMAT.search(lines)
        if stored and stored.group(1) != b"RAW":
            what = stored.group(1).decode("ascii", "replace")
            raise Damage(f"packets are stored as {what}, expected RAW", stored.start(1))
        self.source, self.start = source, len(lines)
        cameras = [(int(number), name.decode()) for number, name in _CAMERA.findall(lines)]
        self._camera = cameras[0][0] if len(cameras) > 1 else -1
        self.sensor_size: Size | None = None
        self.metadata = {"other_events": 0, "invalid_events": 0}
        if cameras:
            name = cameras[0][1]
            self.metadata["camera"] = name
            self.sensor_size = next((size for known, size in SIZES.items() if name.upper().startswith(known)), None)
        if start := _START.search(lines):
            self.metadata["start"] = start.group(1).decode()

    def decoder(self) -> Decoder:
        """See `WordReader`."""
        state = first_state(more=3)
        state[word_kernels.CAMERA] = self._camera
        return Decoder(word_kernels.packet_decoder(LAYOUT_3), state, EVENT, unit=1)

    def count(self, state: State) -> None:
        """See `WordReader`."""
        self.metadata |= {"other_events": int(state[SECOND]), "invalid_events": int(state[OTHER])}

    def stop_reason(self, rest: Bytes) -> str:
        """See `WordReader`."""
        return "expected the header of a packet"

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """See `WordReader`."""
        if missing := int(decoder.state[word_kernels.SKIP] + decoder.state[word_kernels.LEFT] * EVENT):
            raise Damage(f"the last packet is cut, {missing - rest.size} bytes are missing", end)
        if rest.size:
            raise Damage(f"{rest.size} bytes left over after the last packet", end)


AEDAT3 = Format(
    "aedat3", "AEDAT 3.1", (".aedat", ".aedat3"), lambda head: head.startswith(MAGIC_3), Aedat3,
    untested="no recording of this format was at hand; read from the specification",
)  # fmt: skip
"""Only read."""


HEADER_STEP = 1 << 16
"""Bytes first looked at; doubled until the header ends."""

_HEADER_LINE = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n")
_BEGUN = re.compile(rb"(#[\t\x20-\x7e\x80-\xff]*\r?)?")


def header(source: Source, magic: bytes, last: bytes) -> tuple[bytes, bool]:
    """All lines before the data.

    Data may begin with the byte of ``#``, but a line of text has no control bytes.

    Args:
        source: the file.
        magic: how the first line begins.
        last: how the line begins that ends the header.

    Returns:
        The lines, and whether the one that ends the header was there.

    Raises:
        Damage: the first line is another or does not end.
    """
    begins = source.head(len(magic))
    if begins != magic:
        raise Damage(f"begins with {begins!r}, expected the line {magic.decode()}", 0)
    count = HEADER_STEP
    while True:
        text = source.head(count)
        ended, length = _lines(text, last)
        if ended or len(text) < count or not _BEGUN.fullmatch(text, length):
            break
        count *= 2
    if length == 0:
        raise Damage("the first line does not end", len(magic))
    return text[:length], ended


def _lines(text: bytes, last: bytes) -> tuple[bool, int]:
    begin = 0
    while line := _HEADER_LINE.match(text, begin):
        begin = line.end()
        if line.group().startswith(last):
            return True, begin
    return False, begin
