"""`neuro events info`: of recordings, generic events, data sets."""

import json
import os
import re
import subprocess
import sys

import h5py
import numpy as np

from neuro.events import Events, save
from neuro_events.info import info


def test_info(messages, run, recording, tmp_path):
    status, out, err = run("info", "in.bin")
    assert (status, err) == (0, "")
    told = json.loads(run("info", "in.bin", "--json", "--sensor", "40x50")[1])
    assert (told["events"], told["sensor_size"], told["format"]) == (100, [40, 50], "nmnist")
    (tmp_path / "in.bin").write_bytes((tmp_path / "in.bin").read_bytes()[:-1])
    messages({"whole": out, "cut": run("info", "in.bin")[1], "none": run("info", "none.bin")[2]})


def test_info_of_long_pauses(run, tmp_path):
    save(Events([0, 5, 36 * 10**8], [0, 1, 2], [0, 0, 0], [0, 1, 0], (34, 34)), tmp_path / "in.h5")
    told = run("info", "in.h5")[1]
    assert "time          0 to 3600000000 us, 3,600 s\n" in told
    assert "rate          0.000833 events/s, at most 200 in 10 ms\n" in told
    (tmp_path / "wide.csv").write_text("1,65535,65535,1\n")
    assert "pixels     not counted, since there are 4,294,967,296\n" in run("info", "wide.csv")[1]


def test_info_of_a_pause_between_two_pieces(monkeypatch, tmp_path):
    times = [0, 5, 10**6, 10**6 + 5, 3 * 10**6]
    save(Events(times, [0] * 5, [0] * 5, [0] * 5, (34, 34)), tmp_path / "in.bin")
    monkeypatch.setattr("neuro_events.info.BLOCK", 10)  # two events of 5 bytes
    assert info(tmp_path / "in.bin").gaps[:2] == [(10**6 + 5, 2 * 10**6 - 5), (5, 10**6 - 5)]


def test_info_says_what_was_never_tried(run, tmp_path):
    (tmp_path / "x.aedat").write_bytes(b"#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n")
    assert "  untested on a real file: no recording of this format" in run("info", "x.aedat")[1]


GENERIC = b"Event Stream\x02\x00\x00\x00"


def test_info_of_generic_events(messages, run, tmp_path):
    (tmp_path / "a.es").write_bytes(GENERIC + b"\x05\x06abc\xff" + b"\x00\x0a\xc3\xa4\x00\xff\x01")
    (tmp_path / "b.es").write_bytes(GENERIC + b"\x05\x52" + bytes(41) + b"\x05")
    (tmp_path / "c.es").write_bytes(GENERIC)
    messages({name: run("info", name)[1] for name in ("a.es", "b.es", "c.es")})
    told = json.loads(run("info", "b.es", "--json")[1])
    assert (told["type"], told["events"], told["start_us"], told["largest_bytes"]) == ("generic", 1, 5, 41)


def test_info_of_generic_events_in_a_pipe(tmp_path):
    words = [os.path.join(os.path.dirname(sys.executable), "neuro"), "events", "info", "-"]
    done = subprocess.run(words, input=GENERIC + b"\x05\x06abc", capture_output=True, cwd=tmp_path, check=True)
    assert b"file    <standard input>\n" in done.stdout
    assert b"events  1\n" in done.stdout


def test_info_of_one_of_several_in_hdf5(messages, run, tmp_path):
    with h5py.File(tmp_path / "two.h5", "w") as file:
        for side in ("left", "right"):
            file[f"davis/{side}/events"] = np.array([[3, 2, 0.5, -1], [4, 2, 1.5, 1]])
    told = run("info", "two.h5", "--from", "hdf5:/davis/right")[1]
    messages({"both": run("info", "two.h5")[2], "right": re.sub(r"[\d,]+ bytes", "N bytes", told)})


def test_info_of_a_data_set(messages, run, data, recording):
    assert json.loads(run("info", "set", "--json")[1])["classes"] == {"3": 4, "7": 2}
    assert run("tohdf5", "-f", "set", "-o", "all.h5", "--workers", "1")[0] == 0
    told = {"set": run("info", "set")[1], "all.h5": run("info", "all.h5")[1], "gif": run("gif", "all.h5")[2]}
    assert run("tohdf5", "-f", "set", "-o", "no/all.h5") == (2, "", "error: no/all.h5: there is no folder no\n")
    messages(told)
