"""Our LZ4 decoder beside the package: what it unpacks is right, and it never writes or reads out of its arrays."""

import lz4.frame
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.events.formats._aedat4_kernels import HEADER, WIDE, frame

ROOM = 300_000
GUARD = 64
SIZES = (lz4.frame.BLOCKSIZE_MAX64KB, lz4.frame.BLOCKSIZE_MAX256KB)


def packed(data, linked=True, size=SIZES[0], level=0):
    return lz4.frame.compress(data, level, size, block_linked=linked, store_size=False)


def unpacked(data, after=WIDE, room=ROOM):
    """What our decoder makes of a frame, with bytes after it; None where it refuses."""
    whole, plain = np.frombuffer(data + bytes(after), np.uint8), np.full(room + WIDE + GUARD, 0xA5, np.uint8)
    count = frame(whole, 0, len(data), plain[: room + WIDE])
    assert np.all(plain[room + WIDE :] == 0xA5)
    assert -1 <= count <= room
    return None if count < 0 else plain[:count].tobytes()


def contents():
    """Bytes that repeat at short and long distances, with and without rests."""
    rng = np.random.default_rng(3)
    records = rng.integers(0, 4, (9000, 16), np.uint8)
    yield b""
    yield b"a"
    yield b"abcabcabc" * 3000
    yield bytes(100_000)
    yield rng.bytes(150_000)
    yield np.cumsum(records, 0, dtype=np.uint8).tobytes()
    for period in range(1, 40):
        yield rng.bytes(period) * 50 + rng.bytes(period)


@pytest.mark.parametrize("level", [0, 9])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("linked", [True, False])
def test_frames(linked, size, level):
    for data in contents():
        assert unpacked(packed(data, linked, size, level)) == data


def test_room_is_kept():
    data = next(part for part in contents() if len(part) == 9000 * 16)
    made = packed(data)
    assert unpacked(made, room=len(data)) in (data, None)
    assert unpacked(made, room=len(data) + 12) == data
    for room in (0, 1, 100, 65535, 65536, 65537, len(data) - 1):
        assert unpacked(made, room=room) is None


def test_a_match_before_the_frame_or_an_own_block_is_refused():
    first = bytes(range(256)) * 256
    made = packed(first + first[:1000])
    alone = made[:4] + bytes([made[4] | 0x20]) + made[5:]
    assert unpacked(made) == first + first[:1000]
    assert unpacked(alone) is None
    for back in (0, 2, 65535):
        block = b"\x14a" + back.to_bytes(2, "little") + b"\x80bbbbbbbb"
        assert unpacked(made[:HEADER] + len(block).to_bytes(4, "little") + block + bytes(4)) is None


@given(st.data())
@settings(max_examples=150)
def test_damaged_frames(data):
    """What is not refused is what the package makes of it."""
    rows = data.draw(st.lists(st.binary(min_size=1, max_size=20), min_size=1, max_size=8))
    times = data.draw(st.integers(1, 60))
    made = bytearray(packed(b"".join(rows) * times, data.draw(st.booleans())))
    for _ in range(data.draw(st.integers(1, 4))):
        made[data.draw(st.integers(HEADER, len(made) - 1))] = data.draw(st.integers(0, 255))
    made = bytes(made[: data.draw(st.integers(HEADER, len(made)) | st.just(len(made)))])
    try:
        expected = lz4.frame.decompress(made)
    except (RuntimeError, EOFError):
        expected = None
    for after in (0, WIDE):
        assert unpacked(made, after) in (None, expected)
