"""Chunks of HDF5 that are not as long as they should be, or lie beyond the end of the file."""

import io

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro.events.files as files
from event_tests import refusal
from neuro.events import EVENT, EventFileError, load, stream
from neuro.events.formats import _hdf5_recording

N = 60
K = np.arange(N)


def rows_file(**options):
    """Prophesee's layout with 16 events a chunk, and where the chunks lie."""
    rows = np.array(
        list(zip(K % 30, K % 34, K % 2, 1000 * K, strict=True)),
        [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")],
    )
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        file.attrs["geometry"] = "34x34"
        dataset = file.create_dataset("CD/events", data=rows, chunks=(16,), **options)
        chunks = [dataset.id.get_chunk_info(k) for k in range(dataset.id.get_num_chunks())]
    return data.getvalue(), chunks


def in_tree(data, chunk):
    """Where the B-tree has a chunk: its size, mask of filters, place in two axes, and address."""
    key = chunk.size.to_bytes(4, "little") + chunk.filter_mask.to_bytes(4, "little")
    key += chunk.chunk_offset[0].to_bytes(8, "little") + bytes(8) + chunk.byte_offset.to_bytes(8, "little")
    assert data.count(key) == 1
    return data.index(key)


def changed(data, at, value, size):
    return data[:at] + value.to_bytes(size, "little") + data[at + size :]


def read(data):
    parts = [np.zeros(0, EVENT)]
    parts += [part.records() for part in stream(data, name="a.h5")]
    return np.concatenate(parts)


@pytest.mark.parametrize("by", ["load", "stream"])
def test_a_chunk_that_is_too_short(by, monkeypatch):
    monkeypatch.setattr(files, "BLOCK", 16 * 13)
    data, chunks = rows_file()
    damaged = changed(data, in_tree(data, chunks[1]), 77, 4)
    assert refusal(lambda: load(damaged, name="a.h5") if by == "load" else read(damaged)) == (
        f"a.h5: byte {chunks[1].byte_offset}: the events from 16 on cannot be read: "
        "a chunk of /CD/events has 77 bytes, expected 224"
    )


def test_a_mask_that_says_that_a_chunk_is_not_packed():
    data, chunks = rows_file(compression="gzip", shuffle=True, fletcher32=True)
    assert len(load(data)) == N
    damaged = changed(data, in_tree(data, chunks[2]) + 4, 0b010, 4)
    with pytest.raises(
        EventFileError, match=r"the events from 32 on cannot be read: a chunk of /CD/events has .* expected 228"
    ):
        load(damaged)


def test_a_chunk_beyond_the_end_has_no_byte():
    data, chunks = rows_file()
    damaged = changed(data, in_tree(data, chunks[3]) + 24, 1 << 40, 8)
    with pytest.raises(EventFileError) as error:
        load(damaged, name="a.h5")
    assert error.value.offset is None
    assert str(error.value).startswith("a.h5: the events from 48 on cannot be read: ")


def test_a_fault_is_placed_in_its_chunk():
    data, chunks = rows_file()
    at = chunks[2].byte_offset + 14 * 3 + 4
    assert (
        refusal(load, changed(data, at, 700, 2), name="a.h5")
        == f"a.h5: byte {chunks[2].byte_offset}: event 35: p is 700, expected 1 for ON, and 0 or -1 for OFF"
    )


def test_times_of_an_unknown_kind(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in "xyp":
            file[f"events/{name}"] = K % 2
        kind = h5py.h5t.IEEE_F64LE.copy()
        kind.set_ebias(1 << 20)
        options = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        options.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        h5py.h5d.create(file["events"].id, b"t", kind, h5py.h5s.create_simple((N,)), options)
    assert "/events/t cannot be read: Insufficient precision" in refusal(load, path)


def test_the_first_chunk_tells_the_unit(monkeypatch):
    """Times that are whole at first are us for `load` as for `stream`, which sees no more of them."""
    monkeypatch.setattr(files, "BLOCK", 16 * 13)
    for t, right in ((np.where(K == 40, 40.5, K), False), (K + 0.5, True)):
        data = io.BytesIO()
        with h5py.File(data, "w") as file:
            for name, values in zip("txyp", (t, K % 30, K % 30, K % 2), strict=True):
                file.create_dataset(f"events/{name}", data=values, chunks=(16,))
        if right:
            assert np.array_equal(load(data.getvalue()).records(), read(data.getvalue()))
            continue
        messages = set()
        for by in (load, read):
            with pytest.raises(EventFileError, match=r"event 40: t is 40\.5, expected a whole number of us") as error:
                by(data.getvalue())
            messages.add(error.value.what)
        assert len(messages) == 1


@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "shuffle": True}], ids=["plain", "packed"])
def test_load_and_stream_agree(options, monkeypatch):
    monkeypatch.setattr(files, "BLOCK", 16 * 13)
    whole, _ = rows_file(**options)

    def result(by, data):
        try:
            return by(data)
        except EventFileError as error:
            return error.what

    @given(st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(1, 255)), min_size=1, max_size=3))
    @settings(max_examples=80, suppress_health_check=list(HealthCheck))
    def run(flips):
        data = bytearray(whole)
        for at, value in flips:
            data[at] ^= value
        loaded = result(lambda given: load(given, name="a.h5").records(), bytes(data))
        assert np.array_equal(loaded, result(read, bytes(data)))

    run()


def test_chunks_are_looked_up_one_by_one_only_where_one_is_damaged(monkeypatch):
    """HDF5 goes through all before one to find it: the square of their number for a whole file."""
    asked, whole = [], _hdf5_recording.check_chunks
    monkeypatch.setattr(_hdf5_recording, "check_chunks", lambda *given: asked.append(given[1:]) or whole(*given))
    data, chunks = rows_file()
    assert (len(read(data)), asked) == (N, [])
    with pytest.raises(EventFileError, match="a chunk of /CD/events has 77 bytes, expected 224"):
        read(changed(data, in_tree(data, chunks[1]), 77, 4))
    assert asked
