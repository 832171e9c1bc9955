import io

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from event_tests import damage_is_told, refusal
from neuro.events import EventFileWarning, load
from neuro.events.formats.mat import samples

ROWS = [(70, 3, 2, 1), (1000, 3, 400, 0), (1070, 5, 0, 1), (1070, 600, 9, 0), (9000, 0, 0, 1)]
T, X, Y, P = (np.array(values) for values in zip(*ROWS, strict=True))


def mat(variables, **options):
    data = io.BytesIO()
    savemat(data, variables, **options)
    return data.getvalue()


def td(**changed):
    """A struct of Orchard's scripts, in MATLAB's doubles: counted from 1, in rows as in DVS-BARREL."""
    return {"x": X + 1.0, "y": Y + 1.0, "p": 2.0 * P - 1, "ts": T.astype(float)} | changed


def of(variables, **options):
    return load(mat(variables, **options), name="f.mat")


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"oned_as": "column"}])
def test_vectors(options):
    events = of({"ts": T.astype(float), "x": X, "y": Y, "pol": P, "note": "a"}, **options)
    assert (events.records().tolist(), events.sensor_size) == (ROWS, (601, 401))
    assert events.metadata == {"format": "mat", "t0": 70, "counted_from": 0}


def test_dvs_barrel():
    """Original.mat: TD with x, y, p, ts, the first pixel being 1; Moving.mat: ROI, cells of such structs."""
    events = of({"TD": td()})
    assert events.records().tolist() == ROWS
    assert events.metadata == {"format": "mat", "t0": 70, "variable": "TD", "counted_from": 1}
    cells = np.empty((1, 3), object)
    for k in range(3):
        cells[0, k] = td(ts=T + 100.0 * k)
    data = mat({"ROI": cells})
    assert refusal(load, data, name="f.mat") == (
        "f.mat: has 3 recordings (ROI{1}, ROI{2}, ROI{3}), expected one; "
        "neuro.events.formats.mat.samples(path) returns all"
    )
    found = samples(data)
    assert list(found) == ["ROI{1}", "ROI{2}", "ROI{3}"]
    assert found["ROI{3}"].records().tolist() == [(t + 200, x, y, p) for t, x, y, p in ROWS]
    assert found["ROI{3}"].metadata["counted_from"] == 1


def test_polarities_of_read_ndataset():
    """1 means off, 2 means on."""
    assert of({"TD": td(p=P + 1.0)}).p.tolist() == P.tolist()


def test_a_struct_that_counts_from_0():
    events = of({"TD": td(x=X, y=Y)})
    assert (events.records().tolist(), events.metadata["counted_from"]) == (ROWS, 0)


def test_jaer():
    """AedatTools' aedat.data.polarity, which counts from 0."""
    polarity = {"timeStamp": T.astype("u4"), "x": X.astype("u2") + 1, "y": Y.astype("u2") + 1, "polarity": P > 0}
    events = of({"aedat": {"info": {"source": "Davis240"}, "data": {"polarity": polarity, "numEvents": 5}}})
    assert events.records().tolist() == [(t, x + 1, y + 1, p) for t, x, y, p in ROWS]
    assert events.metadata["variable"] == "aedat.data.polarity"


def test_seconds():
    assert of({"e": {"t": T / 1e6, "x": X, "y": Y, "p": P}}).records().tolist() == ROWS


def version_73(fill):
    data = io.BytesIO()
    with h5py.File(data, "w", userblock_size=512) as file:
        fill(file)
    whole = bytearray(data.getvalue())
    whole[:128] = b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM"
    return bytes(whole)


def test_version_73():
    def struct(group, first=0):
        for name, values in td(ts=T + first).items():
            group[name] = np.reshape(values, (-1, 1))

    assert load(version_73(lambda file: struct(file.create_group("TD")))).records().tolist() == ROWS
    assert load(version_73(lambda file: struct(file))).x.tolist() == (X + 1).tolist()

    def cells(file):
        for k in range(2):
            struct(file.create_group(f"#refs#/{k}"), k)
        file["ROI"] = np.array([[file[f"#refs#/{k}"].ref for k in range(2)]], h5py.ref_dtype)

    assert [events.t[0] for events in samples(version_73(cells)).values()] == [70, 71]


def test_messages(messages):
    messages.calls(globals())


@pytest.mark.filterwarnings("ignore")
def test_damage_is_told():
    damage_is_told([mat({"TD": td()}), mat({"a": {"b": td()}}, do_compression=True)], "mat")


def test_what_is_whole():
    data = mat({"e": td(x=[1.0, 2, -1, 2, 3])})
    with pytest.warns(EventFileWarning, match=r"event 2: x is -1\.0"):
        assert len(load(data, strict=False)) == 2
    assert "<bytes>: event 2: x is -1.0" in refusal(samples, data)


def test_a_cut_file():
    assert "f.mat: not an intact MAT file: " in refusal(load, mat({"TD": td()})[:-40], name="f.mat")
