"""Where machine code is kept, and how much of it."""

import os

import pytest

from neuro.kernels import kept


@pytest.fixture
def places(monkeypatch):
    """Say which folders there are; nothing has been said yet."""

    def choose(*found):
        monkeypatch.setattr(kept, "_places", lambda: iter(found))
        monkeypatch.setattr(kept, "_said", False)
        kept.folder.cache_clear()

    yield choose
    monkeypatch.undo()
    kept.folder.cache_clear()


def test_the_first_folder_that_can_be_written(places, tmp_path):
    (tmp_path / "file").touch()
    places(tmp_path / "file" / "cache", tmp_path / "other")
    assert kept.folder() == tmp_path / "other"
    assert (tmp_path / "other").stat().st_mode & 0o777 == 0o700


def test_a_folder_into_which_others_can_write_is_not_trusted(places, tmp_path):
    """What lies there would be run."""
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    places(tmp_path / "open")
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
        "neuro: compiling kernels for this machine, once; they cannot be kept, as no cache folder can be written: "
        "set XDG_CACHE_HOME to one\n"
    )


def test_no_temporary_folder_is_no_error(monkeypatch):
    def nowhere():
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(kept.tempfile, "gettempdir", nowhere)
    assert len(list(kept._places())) == 1


def test_what_was_not_used_for_longest_goes_first(tmp_path):
    for age, name in enumerate(("new", "used", "old", "oldest")):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    kept._clear(tmp_path, 250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "used"]


def test_a_kernel_may_not_read_what_the_key_cannot_see():
    from neuro.kernels.jit import kernel

    numbers = {"a": 1}

    @kernel
    def read():
        return numbers

    expected = "reads 'closure', a dict: expected numbers, words, tuples, arrays, modules or compiled functions"
    with pytest.raises(TypeError, match=expected):
        read()
