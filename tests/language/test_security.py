"""An untrusted description runs no code, reads nothing outside its folder, and ends in time."""

# ruff: noqa: E501

import os
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from beside import beside
from refused import refused

HEAD = "neuro: 1\npopulations: {a: {model: parrot_neuron, shape: 3}}\n"


def weight(text):
    return f"{HEAD}projections:\n  p: {{from: a, to: a, rule: one_to_one, weight: {text}}}\n"


def from_file(name, key=None):
    return weight(f"{{file: {name}}}" if key is None else f"{{file: {name}, key: {key}}}")


@pytest.fixture
def files(folder):
    """A folder of a description, with an HDF5 file in it and one outside that holds a secret."""
    inner = folder / "inner"
    inner.mkdir()
    with h5py.File(folder / "secret.h5", "w") as secret:
        secret["w"] = np.ones(3)
    with h5py.File(inner / "w.h5", "w") as file:
        file["w"] = np.arange(3.0)
        file["ints"] = np.arange(3, dtype=np.int8)
        file["deep/w"] = np.arange(3.0)
        file["one"] = 1.0
        file["text"] = "abc"
        file["flags"] = np.array([True, False])
        file["external"] = h5py.ExternalLink("../secret.h5", "w")
        file["soft"] = h5py.SoftLink("/w")
        file["outside"] = h5py.ExternalLink("../secret.h5", "/")
        layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
        layout[:] = h5py.VirtualSource("../secret.h5", "w", shape=(3,))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("stored", (3,), "f8", external=[("../secret.h5", 0, 24)])
        file.create_dataset("huge", (2**40,), "f8", chunks=(1024,))
        file["nan"] = np.array([1.0, np.nan, 1.0])
    os.chdir(inner)
    return inner


def test_arrays_in_files(files):
    np.save(files / "w.npy", np.arange(3))
    for text in (from_file("w.h5", "w"), from_file("w.h5", "deep/w"), from_file("w.h5", "ints"), from_file("w.npy")):
        (files / "net.yaml").write_text(text)
        values = neuro.load("net.yaml").projections["p"].weight.values
        assert values.tolist() == [0.0, 1.0, 2.0]
        assert values.dtype == np.float64


def test_files_that_are_refused(files, messages):
    (files / "link.h5").symlink_to(files.parent / "secret.h5")
    (files / "up").symlink_to(files.parent)
    (files.parent / "other.yaml").write_text("neuro: 1\n")
    (files / "bad.h5").write_text("no HDF5")
    (files / "bad.npy").write_text("no NPY")
    np.save(files / "objects.npy", np.array([print], dtype=object), allow_pickle=True)
    np.save(files / "cut.npy", np.zeros(1000))
    os.truncate(files / "cut.npy", 500)
    os.mkfifo(files / "pipe.npy")
    messages.calls(globals())


def loaded(data):
    Path("net.yaml").write_bytes(data if isinstance(data, bytes) else data.encode())
    neuro.load("net.yaml")


(TAGS,) = beside(__file__, "TAGS")


@pytest.mark.parametrize("value", TAGS)
def test_tags_are_refused(message, folder, value):
    assert "found the tag" in message(f"neuro: 1\nname: {value}\n")
    assert not (folder / "ran").exists()


def test_billion_laughs(message):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 10)]
    assert message("\n".join(lines)).startswith("net.yaml:1:5: found the anchor '&a0'")


def test_parameters_that_multiply(message, monkeypatch):
    monkeypatch.setattr("neuro.model.language.parameters.MAX_SUBSTITUTED", 10_000)
    names = ["a0: [x, x, x, x, x, x, x, x, x]"]
    names += [f"a{n}: [{', '.join([f'$a{n - 1}'] * 9)}]" for n in range(1, 10)]
    begin = time.process_time()
    text = message(f"neuro: 1\nname: $a9\nparameters: {{{', '.join(names)}}}")
    assert "parameters expand to more than 10000 values: expected fewer" in text
    assert time.process_time() - begin < 20


def test_parameters_that_nest(message):
    names = ["a0: x", *(f"a{n}: [$a{n - 1}]" for n in range(1, 3000))]
    text = message(f"neuro: 1\nname: $a2999\nparameters: {{{', '.join(names)}}}")
    assert "parameters expand to more than 32 levels: expected fewer" in text


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "{a: " * 100_000, "- " * 100_000, "\n".join(" " * n + "a:" for n in range(3000)), "? " * 50_000],
)
def test_deep_nesting(message, text):
    begin = time.perf_counter()
    assert "net.yaml:" in message(text)
    assert time.perf_counter() - begin < 10


@pytest.mark.parametrize("number", ["1e400", "-1e400", "9" * 400, "1" + "0" * 5000, "1e999999999999"])
def test_numbers_beyond_double_precision(message, number):
    assert "expected a number below 1.8e308" in message(weight(number))


@pytest.mark.parametrize("size", ["9" * 18, "9" * 30, "1e300", "2147483648"])
def test_sizes_beyond_memory(message, size):
    assert "expected" in message(HEAD.replace("shape: 3", f"shape: {size}"))


def test_bytes_that_are_no_text(folder, messages):
    messages.calls(globals())


def test_a_byte_order_mark_is_no_mistake(folder):
    (folder / "net.yaml").write_bytes(b"\xef\xbb\xbf" + HEAD.encode())
    assert list(neuro.load("net.yaml").populations) == ["a"]


def test_files_that_are_not_there(folder, messages):
    (folder / "follower.yaml").write_text(HEAD)
    (folder / "sub.yaml").mkdir()
    os.mkfifo(folder / "pipe.yaml")
    messages.of(lambda path: refused(neuro.load, path))
    assert "cannot be read" in refused(neuro.load, "x" * 5000)


@pytest.mark.parametrize(
    "word", ["with", "import", "register", "python", "extension", "extensions", "plugins", "module"]
)
def test_no_word_of_a_description_runs_a_file(message, folder, word):
    """Code is run by --with and by entry points of what is installed, never by a file that names it."""
    (folder / "my_model.py").write_text("open('ran', 'w')\n")
    for value in ("my_model.py", "[my_model.py]", "{file: my_model.py}"):
        assert f"unknown word of a network '{word}'" in message(f"{HEAD}{word}: {value}\n")
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("name", ["my_model", "my_model.my_model", "my_model:my_model", "my_model.py"])
def test_no_name_of_a_part_runs_a_file(message, folder, name, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    (folder / "my_model.py").write_text("open('ran', 'w')\nmy_model = 3\n")
    model = f"neuro: 1\npopulations: {{a: {{model: '{name}', shape: 3}}}}\n"
    assert "unknown model" in message(model)
    for part in ("rule", "synapse"):
        text = f"{HEAD}projections:\n  p: {{from: a, to: a, rule: one_to_one, weight: 1.0, delay: 1.0, {part}: '{name}'}}\n"
        text = text.replace("rule: one_to_one, ", "") if part == "rule" else text
        assert f"unknown {part}" in message(text)
    assert "my_model.py" in message("neuro: 1\ninclude: [my_model.py]\n")
    assert not (folder / "ran").exists()
