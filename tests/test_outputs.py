"""Every file that is written: whole or not there, and never in the place of what is not ours."""

import json
import os
import re
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import neuro
from beside import beside
from neuro import ModelError, events
from neuro.core import outputs
from neuro.core.hdf5 import writing
from neuro.core.outputs import Unwritable, check_output, make_folder, marked, output, sealed, write_text
from neuro.core.pictures import write_picture
from neuro.events.pictures import gif, view
from refused import refused

OURS = marked("a text of ours", "# ours")
SEALED = sealed("a text with a seal", "# a seal", ", digest {}")


def _net():
    net = neuro.Network("n", resolution=1.0)
    net.population("a", 1, neuro.iaf_psc_delta())
    return net


def _recording():
    return events.Events([0, 40_000], [0, 1], [1, 0], [0, 1], (2, 2))


WRITERS = {
    "text": (lambda path: write_text(path, "# ours\n", OURS), "a.txt"),
    "png": (lambda path: write_picture(path, Figure()), "a.png"),
    "pdf": (lambda path: write_picture(path, Figure()), "a.pdf"),
    "svg": (lambda path: write_picture(path, Figure()), "a.svg"),
    "hdf5": (lambda path: _hdf5(path), "a.h5"),
    "state": (lambda path: neuro.compile(_net()).save(path), "a.h5"),
    "network": (lambda path: _net().save(path), "a.yaml"),
    "gif": (lambda path: gif(_recording(), path), "a.gif"),
    "page": (lambda path: view(_recording(), path, title="a"), "a.html"),
}
"""Kinds that may be replaced by their like."""


def _hdf5(path):
    with writing(path, "of a test") as file:
        file["a"] = np.arange(3)


@pytest.mark.parametrize("kind", WRITERS)
def test_what_was_written_here_is_replaced(kind, tmp_path):
    write, name = WRITERS[kind]
    write(tmp_path / name)
    first = os.stat(tmp_path / name).st_ino
    write(tmp_path / name)
    assert os.stat(tmp_path / name).st_ino != first
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("there", [b"my thesis", b"", b"\x89HDF\r\n\x1a\n"], ids=["text", "empty", "beginning"])
def test_what_is_not_ours_stays(kind, there, tmp_path):
    write, name = WRITERS[kind]
    path = tmp_path / name
    path.write_bytes(there)
    assert re.search(rf"{name}: exists.*: expected a new name", refused(write, path))
    assert path.read_bytes() == there
    assert os.listdir(tmp_path) == [name]


def test_a_network_written_by_hand_stays(tmp_path, messages):
    """Its author's comments and order would be lost."""
    path = tmp_path / "net.yaml"
    path.write_text("neuro: 1\nname: n  # mine\npopulations: {a: {model: iaf_psc_delta, shape: 1}}\n")
    messages({"told": refused(neuro.load(path).save, path).replace(f"{tmp_path}/", "")})


FORMAT = sealed("a JSON file", '"format": "f 1"', ', "digest": "{}"')


def _json(path):
    write_text(path, json.dumps({"format": "f 1", "of": ["é"]}, indent=1, ensure_ascii=False) + "\n", FORMAT)


TEXTS = {
    "json": (_json, "a.json"),
    "text": (lambda path: write_text(path, "# a seal\nbody\n", SEALED), "a.txt"),
    "network": WRITERS["network"],
    "page": WRITERS["page"],
}


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("where", ["end", "middle", "beginning", "digest"])
def test_a_text_that_was_edited_stays(kind, where, tmp_path):
    write, name = TEXTS[kind]
    path = tmp_path / name
    write(path)
    text = path.read_text()
    half = text.index("\n", len(text) // 2 if kind != "text" else 0)
    edited = {
        "end": text + "# mine\n",
        "middle": text[:half] + " # mine" + text[half:],
        "beginning": "# mine\n" + text,
        "digest": re.sub(
            ', "digest": "[0-9a-f]{32}"|, digest [0-9a-f]{32}|<!-- digest [0-9a-f]{32} -->', "", text
        ),  # as marks once were
    }[where]
    assert edited != text
    path.write_text(edited)
    assert re.search(rf"{name}: exists.*: expected a new name", refused(write, path))
    assert path.read_text() == edited
    path.write_text(text)
    write(path)


def test_a_saved_network_with_a_comment_stays(tmp_path, messages):
    path = tmp_path / "net.yaml"
    _net().save(path)
    path.write_text(path.read_text().replace("resolution:", "# mine\nresolution:"))
    messages({"told": refused(neuro.load(path).save, path).replace(f"{tmp_path}/", "")})


def test_a_picture_of_a_like_name_stays(tmp_path):
    """The mark is the whole chunk: 'Software' is 'neuro', not 'neuroglancer'."""
    path = tmp_path / "a.png"
    Figure().savefig(path, format="png", metadata={"Software": "neuroglancer"})
    assert "exists and is not a picture of neuro" in refused(write_picture, path, Figure())


def test_no_recording_is_replaced_unless_asked(tmp_path, messages):
    path = tmp_path / "net.csv"
    events.save(_recording(), path)
    before = path.read_bytes()
    messages({"told": refused(events.save, _recording()[:1], path).replace(f"{tmp_path}/", "")})
    assert path.read_bytes() == before
    events.save(_recording()[:1], path, replace=True)
    assert len(events.load(path)) == 1


@pytest.mark.parametrize("kind", WRITERS)
def test_a_link_stays_and_its_file_is_replaced(kind, tmp_path):
    write, name = WRITERS[kind]
    (tmp_path / "inside").mkdir()
    link, target = tmp_path / name, tmp_path / "inside" / name
    link.symlink_to(target)
    for _ in range(2):  # a link to nothing, then to a file
        write(link)
        assert link.is_symlink()
        assert target.is_file()
        assert not target.is_symlink()
    target.write_bytes(b"my thesis")
    assert "exists" in refused(write, link)
    assert target.read_bytes() == b"my thesis"
    assert os.listdir(tmp_path / "inside") == [name]


def test_links_in_a_circle(tmp_path):
    for one, other in ("ab", "ba"):
        (tmp_path / one).symlink_to(tmp_path / other)
    with pytest.raises(Unwritable, match=r"a: cannot be written: Too many levels of symbolic links$"):
        write_text(tmp_path / "a", "x", OURS)
    assert (tmp_path / "a").is_symlink()


@pytest.mark.parametrize("kind", WRITERS)
def test_a_pipe_is_written_into(kind, tmp_path):
    write, name = WRITERS[kind]
    path, taken = tmp_path / name, []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: taken.append(path.read_bytes()), daemon=True)
    reader.start()
    write(path)
    reader.join(10)
    assert stat.S_ISFIFO(path.stat().st_mode)
    write(tmp_path / f"file{name}")
    beginning = (tmp_path / f"file{name}").read_bytes()[:8]
    assert taken[0].startswith(beginning)


@pytest.fixture
def device(tmp_path):
    """Make a device like one in /dev; only root can, and not everywhere."""

    def made(name, number):
        try:
            os.mknod(tmp_path / name, 0o666 | stat.S_IFCHR, os.makedev(1, number))
            (tmp_path / name).open("wb").close()
        except PermissionError:
            pytest.skip("devices cannot be made here")
        return tmp_path / name

    return made


@pytest.mark.parametrize("kind", WRITERS)
def test_a_device_is_written_into(kind, device):
    write, name = WRITERS[kind]
    full, null = device(f"full{name}", 7), device(f"null{name}", 3)
    assert re.search(rf"full{name}: cannot be written: No space left on device$", refused(write, full))
    write(null)
    for path in (full, null):
        assert stat.S_ISCHR(path.stat().st_mode)


def test_a_recording_into_a_device(device):
    full = device("full.csv", 7)
    with pytest.raises(events.EventFileError, match=r"full\.csv: cannot be written: No space left on device$"):
        events.save(_recording(), full)
    assert stat.S_ISCHR(full.stat().st_mode)


(INTO,) = beside(__file__, "INTO")


@pytest.mark.parametrize("name", ["/proc/self/fd/1", "link", "/dev/fd/2"])
def test_a_descriptor_is_written_into_whatever_is_behind(name, tmp_path):
    """The shell has opened the file: it is no name of ours to take, and others write there, too."""
    if name == "link":
        name = str(tmp_path / "link")
        os.symlink("/dev/stdout", name)
    file, errors = tmp_path / "thesis.txt", tmp_path / "errors.txt"
    for path in (file, errors):
        path.write_text("mine\n")
    inodes = file.stat().st_ino, errors.stat().st_ino
    with file.open("a") as out, errors.open("a") as err:
        assert subprocess.run([sys.executable, "-c", INTO, name], stdout=out, stderr=err).returncode == 0
    if name[-1] in "r2":
        assert (file.read_text(), errors.read_text()) == ("mine\nbefore\nafter\n", "mine\ncontent\n")
    else:
        assert (file.read_text(), errors.read_text()) == ("mine\nbefore\ncontent\nafter\n", "mine\n")
    assert (file.stat().st_ino, errors.stat().st_ino) == inodes


def test_descriptors_that_cannot_be_written_to(tmp_path):
    (tmp_path / "a").touch()
    what = "is open for reading, expected a descriptor that can be written to"
    with (tmp_path / "a").open("rb") as reading, pytest.raises(Unwritable, match=rf"{what}$"):
        check_output(Path(f"/dev/fd/{reading.fileno()}"), OURS)
    with pytest.raises(Unwritable, match=r"/dev/fd/999: cannot be written: Bad file descriptor$"):
        check_output(Path("/dev/fd/999"), OURS)


def test_a_link_into_a_missing_folder_names_it(tmp_path, messages):
    link = tmp_path / "a"
    link.symlink_to(tmp_path / "no" / "b")
    messages({"told": refused(check_output, link, OURS).replace(f"{tmp_path}/", "")})


@pytest.mark.parametrize("path", ["thesis.txt", "thesis.txt/below", "/dev/null"])
def test_what_is_no_folder(path, tmp_path):
    (tmp_path / "thesis.txt").touch()
    assert refused(make_folder, tmp_path / path).endswith(
        ": is no folder: expected the name of a folder, or a new name"
    )


def test_what_no_file_can_be_written_to(tmp_path):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "s"))
        for path, what in {
            tmp_path: "is a folder, expected the name of a file",
            tmp_path / "s": "is a socket, expected the name of a file",
            tmp_path / "no" / "a": f"there is no folder {tmp_path / 'no'}",
            tmp_path / "s" / "a": "cannot be written: Not a directory",
            tmp_path / ("a" * 300): "cannot be written: File name too long",
        }.items():
            assert refused(check_output, path, OURS) == f"{path}: {what}"
        assert stat.S_ISSOCK((tmp_path / "s").stat().st_mode)


@pytest.mark.parametrize("given", [None, 3, b"a", "a\0b", True])
def test_what_is_no_name(given):
    with pytest.raises(ModelError) as error, output(given, OURS):
        pass
    more = ", without a zero byte" if isinstance(given, str) else ""
    assert str(error.value) == f"path = {given!r}: expected the name of a file{more}"


def test_long_and_odd_names(tmp_path):
    for name in ("a" * 255, "é" * 127, "a b\n[*]?'\"", "-", "\udc80"):
        write_text(tmp_path / name, "# ours", OURS)
        write_text(tmp_path / name, "# ours", OURS)
        assert os.listdir(tmp_path) == [name]
        (tmp_path / name).unlink()


def test_the_name_is_taken_at_the_end(tmp_path):
    path = tmp_path / "a"
    path.write_text("# ours: old")
    path.chmod(0o640)
    with output(path, OURS) as part:
        part.write_text("# ours: new")
        assert path.read_text() == "# ours: old"
    assert path.read_text() == "# ours: new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert list(tmp_path.iterdir()) == [path]


def test_two_at_once(tmp_path):
    with output(tmp_path / "a", OURS) as one, output(tmp_path / "a", OURS) as other:
        one.write_text("# ours 1")
        other.write_text("# ours 2")
    assert (tmp_path / "a").read_text() == "# ours 1"
    assert os.listdir(tmp_path) == ["a"]


def test_no_file_is_opened_for_writing_elsewhere():
    """All files are written by way of `neuro.core.outputs`; formats of events and batches get their path from there."""
    root = Path(outputs.__file__).parents[2]
    calls = (
        ".savefig(",
        ".write_text(",
        ".write_bytes(",
        'File(path, "w"',
        '"wb")',
        'open("w")',
        "np.save",
        ".replace(path)",
    )
    found = {
        path.relative_to(root).as_posix()
        for folder in ("neuro", "apps", "backends", "models")
        for path in (root / folder).rglob("*.py")
        if any(call in path.read_text() for call in (*calls, ".replace(path)"))
    }
    formats = {f"apps/neuro_events/formats/{name}.py" for name in FORMATS}
    given = {
        *(f"neuro/cli/{name}.py" for name in ("compare", "start", "run")),
        "apps/neuro_doctor/cli.py",
        *(f"apps/neuro_sweeps/{name}.py" for name in ("page", "folder", "worker")),
        "apps/neuro_events/cli/making.py",
        "neuro/model/language/writer.py",
        "neuro/core/player.py",
        "apps/neuro_exchange/pynn/write.py",
        "apps/neuro_exchange/sonata.py",
        "apps/neuro_exchange/c_code/export.py",
    }
    temporary = {
        *("apps/neuro_sweeps/rerun.py", "neuro/files/results.py", "apps/neuro_events/formats/rosbag.py"),
        "apps/neuro_recognise/methods/framewise.py",
        "neuro/kernels/kept.py",  # machine code, in a folder of its own
        "neuro/run/results_file.py",  # a run that is under way
        "neuro/core/html.py",  # a picture inside a page
        "neuro/plots/_canvas.py",  # a picture for a notebook
        "apps/neuro_sweeps/network.py",  # a table for one run
        "apps/neuro_live/page.py",  # a file for the browser, in a folder of its own
    }
    journal = {"apps/neuro_sweeps/journal.py"}  # many add lines to it, so it is rewritten under its own lock
    assert found == {"neuro/core/outputs.py", "neuro/core/pictures.py"} | formats | temporary | given | journal


FORMATS = ("_reading", "aedat4", "npz", "table")  # _reading writes the formats of plain words
