"""Where machine code is kept, and how much of it."""

import os
import pickle
import time

import numpy as np
import pytest

from neuro.kernels import kept
from neuro.kernels.compile_report import REPORTED


@pytest.fixture
def places(monkeypatch):
    """Say which folders there are; nothing has been said yet."""

    def choose(*found):
        monkeypatch.setattr(kept, "_places", lambda: iter(found))
        monkeypatch.delenv(REPORTED, raising=False)
        kept.folder.cache_clear()

    yield choose
    monkeypatch.undo()
    kept.folder.cache_clear()


def test_the_first_folder_that_can_be_written(places, tmp_path):
    (tmp_path / "file").touch()
    places(tmp_path / "file" / "cache", tmp_path / "other")
    assert kept.folder() == tmp_path / "other"
    assert (tmp_path / "other").stat().st_mode & 0o777 == 0o700


def test_a_folder_into_which_others_can_write_and_a_link_are_not_trusted(places, tmp_path):
    """What lies there would be run; who made the link says what lies there, and what is removed."""
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "safe").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "safe")
    for name in ("open", "link"):
        places(tmp_path / name)
        assert kept.folder() is None


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to someone else")
def test_a_folder_of_somebody_else_is_not_trusted(places, tmp_path):
    (tmp_path / "theirs").mkdir(mode=0o700)
    os.chown(tmp_path / "theirs", 65534, -1)
    places(tmp_path / "theirs")
    assert kept.folder() is None


def test_kernels_run_where_nothing_can_be_kept(places, tmp_path, capsys):
    from neuro.kernels.jit import kernel

    @kernel
    def double(a):
        return 2 * a

    (tmp_path / "file").touch()
    places(tmp_path / "file" / "cache")
    assert (double(3), double(1.5)) == (6, 3.0)
    assert capsys.readouterr().err == (
        "neuro: compiling kernels for this machine, once; found no writable cache folder: "
        "set XDG_CACHE_HOME to one, to compile only once\n"
    )


def _file(path, age):
    path.write_bytes(bytes(100))
    os.utime(path, (time.time() - age, time.time() - age))


NAMES = {word: f"total-{k:032x}" for k, word in enumerate(("new", "used", "old", "oldest"))}


def test_what_was_not_used_for_longest_goes_first(tmp_path):
    for age, name in enumerate(NAMES.values()):
        _file(tmp_path / name, age)
    kept._clear(tmp_path, 250)
    assert {path.name for path in tmp_path.iterdir()} == {NAMES["new"], NAMES["used"]}


def test_only_our_own_files_are_removed(tmp_path):
    day = 86_400
    ours = {NAMES["old"]: 0, f"{NAMES['old']}.123": 2 * day, f"<lambda>-{'a' * 32}": 0}
    others = {
        "thesis": 9 * day,
        f"total-{'a' * 31}": 0,
        f"total-{'A' * 32}": 0,
        f"{NAMES['old']}.txt": 0,
        f"{NAMES['old']}.45": day / 2,  # it is still written
    }
    for name, age in (ours | others).items():
        _file(tmp_path / name, age)
    (tmp_path / NAMES["new"]).symlink_to(tmp_path / "thesis")
    (tmp_path / NAMES["used"]).mkdir()
    kept._clear(tmp_path, 0)
    assert {path.name for path in tmp_path.iterdir()} == {*others, NAMES["new"], NAMES["used"]}


class Odd:
    """What raises when it is read back."""

    def __reduce__(self):
        return int, ("odd",)


@pytest.mark.parametrize(
    "content",
    [pickle.dumps((1, 2)), pickle.dumps(Odd()), b"cno_such_module\nname\n.", b""],
    ids=["short", "raising", "module", "empty"],
)
def test_a_file_of_something_else_is_compiled_anew(content, places, tmp_path):
    from neuro.kernels.jit import kernel

    def double(a):
        return 2 * a

    places(tmp_path)
    assert kernel(double)(3) == 6
    (file,) = tmp_path.iterdir()
    file.write_bytes(content)
    assert kernel(double)(3) == 6
    again = kernel(double)
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1


@pytest.fixture
def file(places, tmp_path):
    """The file of a kernel, and how to make the kernel."""
    from neuro.kernels.jit import kernel

    def double(a):
        return 2 * a

    places(tmp_path)
    assert kernel(double)(3) == 6
    (found,) = tmp_path.iterdir()
    return found, lambda: kernel(double)


def _hits(kernel, argument):
    assert kernel(argument) == 2 * argument
    return sum(kernel.stats.cache_hits.values())


def test_no_flipped_bit_is_run(file):
    place, _ = file
    whole = place.read_bytes()
    content = kept._read(place)
    assert content is not None
    assert content in whole
    for bit in range(0, 8 * len(whole), max(1, 8 * len(whole) // 500)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        place.write_bytes(damaged)
        assert kept._read(place) is None, bit


@pytest.mark.parametrize(
    "damage",
    [
        lambda place, whole: place.write_bytes(whole[: len(whole) // 2]),
        lambda place, whole: place.write_bytes(whole + b"0"),
        lambda place, whole: place.write_bytes(whole[:1000] + bytes([whole[1000] ^ 16]) + whole[1001:]),
        lambda place, whole: (place.unlink(), place.symlink_to(place)),
        lambda place, whole: place.with_name(f"{place.name}.{os.getpid()}").write_bytes(whole[:100]),
    ],
    ids=["truncated", "longer", "flipped", "unreadable", "killed while writing"],
)
def test_what_is_not_as_it_was_written_is_compiled_anew(file, damage):
    place, make = file
    damage(place, place.read_bytes())
    _hits(make(), 3)
    assert _hits(make(), 3) == 1


def test_a_file_under_the_name_of_another_kernel_is_not_run(file):
    place, make = file
    whole = place.read_bytes()
    assert make()(1.5) == 3.0
    (other,) = set(place.parent.iterdir()) - {place}
    other.write_bytes(whole)
    assert _hits(make(), 1.5) == 0
    assert _hits(make(), 1.5) == 1


def test_a_kernel_may_not_read_what_the_key_cannot_see():
    from neuro.kernels.jit import kernel

    numbers = {"a": 1}

    @kernel
    def read():
        return numbers

    expected = "reads 'closure', a dict: expected numbers, words, tuples, arrays, modules or compiled functions"
    with pytest.raises(TypeError, match=expected):
        read()


def test_a_table_of_other_arrays_is_other_code():
    """A kernel that names one array of a table finds it elsewhere where another array comes before it."""
    from neuro.kernels.address import Views, fields_of, table_of, viewer
    from neuro.kernels.jit import kernel

    def second(text):
        fields = fields_of(text)
        net_of = viewer(Views("Net", 0, fields))

        @kernel
        def first_number(view):
            return net_of(view).b[0]

        arrays = {name: np.full(1, k) for k, name in enumerate("abc")}
        return first_number(table_of((fields, arrays)).ctypes.data)

    assert second("a i8 1\nb i8 1") == second("a i8 1\nc i8 1\nb i8 1") == 1
