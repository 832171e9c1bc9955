"""Damaged and hostile files of wiring diagrams: file, row, column, what was found and what was expected."""

import pickle
import sys
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import neuro
from golden_messages import Messages
from refused import refusals_of, refused

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

NEURONS = "id,type\n10,KC\n20,KC\n30,MBON\n"
EDGES = "pre,post,n\n10,20,5\n20,30,6\n"


def build(folder: Path, **words: Any) -> None:
    """Describe and compile a network."""
    net = neuro.Network()
    net.wiring(
        neurons=neuro.neuron_table(folder / "neurons", id="id"),
        edges=neuro.from_file(folder / "edges", **{"weight": "n", **words}),
        model=neuro.iaf_psc_exp(),
    )
    neuro.compile(net, backend="reference")


def refusal(folder: Path, edges: Any = None, neurons: Any = None, **words: Any) -> None:
    """Write the files and compile the network, which is refused."""
    for name, content in (("neurons", neurons or NEURONS), ("edges", edges or EDGES)):
        path = folder / name
        if isinstance(content, str):
            path.write_text(content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content(path)
    build(folder, **words)


def test_damaged(tmp_path: Path, messages: Messages) -> None:
    def table(text: str) -> None:
        (tmp_path / "neurons").write_text(text)
        cells = neuro.neuron_table(tmp_path / "neurons", id="id")
        neuro.Network().population("brain", "auto", neuro.iaf_psc_exp(), neurons=cells)

    def matrix(*shape: int) -> bytes:
        np.save(file := BytesIO(), np.ones(shape))
        return file.getvalue()

    def elsewhere(what: str) -> Any:
        """Texts of SONATA that lie elsewhere: HDF5 read on for ever."""

        def write(path: Path) -> None:
            sonata(**{"0/nt": ["a", "b"]})(path)
            content = bytearray(path.read_bytes())
            with h5py.File(path) as file:
                at = file["edges/e/0/nt"].id.get_offset() + {"length": 0, "heap": 4, "index": 12}[what]
            content[at : at + 2] = b"\xff\x7f"
            path.write_bytes(content)

        return write

    def unnamed(path: Path) -> None:
        sonata()(path)
        with h5py.File(path, "r+") as file:
            file["edges/e"].create_group(b"\xff\xfe")

    messages(refusals_of(messages.cases, globals() | locals(), folder=tmp_path))


def test_rows_are_counted_over_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("neuro.model.wiring.formats._BLOCK", 1 << 10)
    lines = ["pre,post,n", *["10,20,5"] * 3000, "10,25,5"]
    assert "edges: row 3002, column 'post': found 25" in refused(refusal, tmp_path, "\n".join(lines))
    lines[-1] = "10,20,x"
    assert "edges: row 3002, column 'n': found 'x': expected a number" in refused(refusal, tmp_path, "\n".join(lines))


def as_parquet(columns: dict[str, Any]) -> Any:
    return lambda path: parquet.write_table(pyarrow.table(columns), path)


class _Runs:
    def __reduce__(self) -> Any:
        return (Path("ran").write_text, ("",))


def test_a_pickle_in_an_npz_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, pre=[10], post=[20], n=np.array([_Runs()], dtype=object))

    assert "edges: holds Python objects, which may run code: expected arrays" in refused(refusal, tmp_path, write)
    assert "edges: " in refused(refusal, tmp_path, pickle.dumps(_Runs()))
    assert not (tmp_path / "ran").exists()


def arrays(**columns: Any) -> Any:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, **columns)

    return write


def sonata(**change: Any) -> Any:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            ids = {"source_node_id": [10, 20], "target_node_id": [20, 30], "edge_type_id": [0, 0], "0/n": [1.0, 2.0]}
            for name, values in {**ids, **change}.items():
                if isinstance(values, (h5py.SoftLink, h5py.ExternalLink)) or values is not None:
                    file[f"edges/e/{name}"] = values

    return write


@pytest.mark.parametrize(
    "write", [as_parquet({"pre": [10], "post": [20], "n": [1]}), arrays(pre=[10], post=[20], n=[1]), sonata()]
)
def test_files_that_were_cut_off(tmp_path: Path, write: Any) -> None:
    write(tmp_path / "whole")
    whole = (tmp_path / "whole").read_bytes()
    assert all("edges: " in refused(refusal, tmp_path, whole[:end]) for end in (9, len(whole) // 2, len(whole) - 3))


def test_a_missing_package_is_named_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "n.csv").write_text(NEURONS)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(neuro.ModelError, match="the package pyarrow, which reads CSV and parquet, is missing") as error:
        neuro.neuron_table(tmp_path / "n.csv", id="id").neurons.size  # noqa: B018
    assert "[parquet]" in error.value.hint


def test_every_byte_that_is_wrong_gives_an_error_or_a_network(tmp_path: Path) -> None:
    """No traceback, whatever stands in a file."""
    rng = np.random.default_rng(0)
    (tmp_path / "neurons").write_text(NEURONS)
    for write in (as_parquet({"pre": [10], "post": [20], "n": [1]}), arrays(pre=[10], post=[20], n=[1]), EDGES):
        if isinstance(write, str):
            (tmp_path / "edges").write_text(write)
        else:
            write(tmp_path / "edges")
        whole = (tmp_path / "edges").read_bytes()
        for at in rng.integers(0, len(whole), 60).tolist():
            (tmp_path / "edges").write_bytes(whole[:at] + bytes([int(rng.integers(0, 256))]) + whole[at + 1 :])
            with suppress(neuro.ModelError):
                build(tmp_path)
