"""Damaged and hostile files of wiring diagrams: file, row, column, what was found and what was expected."""

import pickle
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import neuro

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


def refusal(folder: Path, edges: Any = None, neurons: Any = None, **words: Any) -> str:
    """The first line of the message, with the folder left out."""
    for name, content in (("neurons", neurons or NEURONS), ("edges", edges or EDGES)):
        path = folder / name
        if isinstance(content, str):
            path.write_text(content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content(path)
    with pytest.raises(neuro.ModelError) as error:
        build(folder, **words)
    message: str = error.value.message
    return re.sub(rf"^(population|projection) '\w+': |{re.escape(str(folder))}/", "", message)


TABLES = {
    "id,type\n10,KC\n20,KC\n10,MBON\n": "neurons: row 4, column 'id': found 10: expected another id than that of row 2",
    "id,type\nA,KC\nB,KC\nA,MBON\n": "neurons: row 4, column 'id': found 'A': expected another id than that of row 2",
    "id,type\n10,KC\n,KC\n": "neurons: row 3, column 'id': found '': expected an id",
    "id,type\n1,KC\n18446744073709551616,KC\n": "neurons: row 3, column 'id': found 18446744073709551616: "
    "expected a whole number of 64 bits",
    "id,type\n": "neurons: found no neuron: expected a row for each",
    "": "neurons: found no header: expected the names of the columns in the first line",
    "id,id\n1,2\n": "neurons: row 1: column 'id' stands there twice: expected each once",
    "ids,type\n1,KC\n": "neurons: unknown column 'id'",
}
LISTS = {
    "pre,post,n\n10,20,5\n20,30,nan\n": "edges: row 3, column 'n': found .nan: expected a finite number",
    "pre,post,n\n10,20,5\n20,30,inf\n": "edges: row 3, column 'n': found .inf: expected a finite number",
    "pre,post,n\n10,20,5\n20,30,\n": "edges: row 3, column 'n': found '': expected a number",
    "pre,post,n\n10,20,5\n20,30,many\n": "edges: row 3, column 'n': found 'many': expected a number",
    "pre,post,n\n10,21,5\n": "edges: row 2, column 'post': found 21: expected the id of a neuron of neurons",
    "pre,post,n\n10,20,5\nx,30,1\n": "edges: row 3, column 'pre': found 'x': expected a whole number of 64 bits",
    "pre,post,n\n99999999999999999999,30,1\n": "edges: row 2, column 'pre': found '99999999999999999999': "
    "expected a whole number of 64 bits",
    "pre,post,n\n10.5,30,1\n": "edges: row 2, column 'pre': found '10.5': expected a whole number of 64 bits",
    "pre,post\n10,20\n": "edges: unknown column 'n'",
    "source,post,n\n10,20,1\n": "edges: unknown column 'pre'",
    "pre,post,n\n10,20,5\n20,3": "edges: no CSV that can be read: CSV parse error: Row #3: Expected 3 columns, "
    "got 2: 20,3",
}


@pytest.mark.parametrize(("text", "expected"), TABLES.items())
def test_tables_of_neurons(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "neurons").write_text(text)
    net = neuro.Network()
    with pytest.raises(neuro.ModelError) as error:
        net.population("brain", "auto", neuro.iaf_psc_exp(), neurons=neuro.neuron_table(tmp_path / "neurons", id="id"))
    assert error.value.message == f"population 'brain': {tmp_path}/{expected}"


@pytest.mark.parametrize(("text", "expected"), LISTS.items())
def test_lists_of_edges(tmp_path: Path, text: str, expected: str) -> None:
    assert refusal(tmp_path, text) == expected


def test_rows_are_counted_over_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("neuro.model.wiring.formats._BLOCK", 1 << 10)
    lines = ["pre,post,n", *["10,20,5"] * 3000, "10,25,5"]
    assert refusal(tmp_path, "\n".join(lines)).startswith("edges: row 3002, column 'post': found 25")
    lines[-1] = "10,20,x"
    assert refusal(tmp_path, "\n".join(lines)) == "edges: row 3002, column 'n': found 'x': expected a number"


def test_a_filter_that_leaves_a_row_out_does_not_ask_for_its_neurons(tmp_path: Path) -> None:
    assert "row 4, column 'post': found 99" in refusal(tmp_path, EDGES + "10,99,7\n10,77,1\n", where="n > 5")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ({"where": "n = 5"}, "where: column 3: found '=': expected a number, a name or an operator"),
        ({"where": "n"}, "where: column 1: found no comparison: expected one such as synapses >= 5"),
        ({"where": "m > 5"}, "edges: unknown column 'm'"),
        ({"where": "__import__(n) > 5"}, "where: column 1: found '_': expected a number, a name or an operator"),
        ({"where": "n > 5 mV"}, "where: column 5: found the unit 'mV': expected a number without one"),
        ({"transmitter": "nt"}, "from_file: found 'transmitter' without 'signs': expected both"),
        ({"transmitter": "n", "signs": {"a": 2}}, "from_file.signs: a = 2: expected 1, -1 or 0"),
        (
            {"transmitter": "n", "signs": {"5": 1}, "where": "n > 1", "weight": None},
            "where: column 'n' is read as text: expected numbers",
        ),
        ({"dale": True}, "from_file: found 'dale' without 'transmitter': expected both"),
        ({"transmitter": "nt", "signs": {"a": 1}}, "edges: unknown column 'nt'"),
        ({"transmitter": "type", "signs": {"KD": 1}, "dale": True}, "neuron 10 of neurons: unknown transmitter 'KC'"),
        ({"pre": "n"}, "from_file: column 'n' is named twice: expected another one"),
        ({"key": "x"}, "edges: key = 'x': expected none, only HDF5 has key"),
        ({"layout": "matrix"}, "edges: row 2: found 2 weights: expected 2, as many as ids in row 1"),
    ],
)
def test_words(tmp_path: Path, words: dict[str, Any], expected: str) -> None:
    if "layout" in words:
        words, expected = {**words, "weight": "weight"}, "edges: row 2, column 'post': found '20'"
        expected = refusal(tmp_path, ",10,20\n10,1,2\n20,x,1\n", **words)
        assert expected == "edges: row 3, column '10': found 'x': expected a finite number"
        return
    assert refusal(tmp_path, **words).split("\n")[0] == expected


def test_a_negative_delay(tmp_path: Path) -> None:
    text = "pre,post,n,d\n10,20,5,1.0\n20,30,6,-1\n"
    assert refusal(tmp_path, text, delay="d") == "edges: row 3, column 'd': found -1: expected a number >= 0"


def as_parquet(columns: dict[str, Any]) -> Any:
    return lambda path: parquet.write_table(pyarrow.table(columns), path)


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"pre": [10, None], "post": [20, 30], "n": [1, 2]}, "edges: row 2, column 'pre': found '': expected a whole"),
        ({"pre": [10.0], "post": [20], "n": [1]}, "edges: column 'pre' holds float64: expected whole numbers of 64"),
        ({"pre": ["10"], "post": [20], "n": [1]}, "edges: column 'pre' holds text: expected whole numbers of 64 bits"),
        ({"pre": [10], "post": [20], "n": [[1]]}, "edges: column 'n' holds list<"),
        ({"pre": np.array([2**64 - 1], np.uint64), "post": [20], "n": [1]}, "edges: row 1, column 'pre': found 18446"),
        ({"pre": [10], "post": [20], "n": [float("nan")]}, "edges: row 1, column 'n': found .nan: expected a finite"),
    ],
)
def test_parquet(tmp_path: Path, columns: dict[str, Any], expected: str) -> None:
    assert refusal(tmp_path, as_parquet(columns)).startswith(expected)


class _Runs:
    def __reduce__(self) -> Any:
        return (Path("ran").write_text, ("",))


def test_a_pickle_in_an_npz_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, pre=[10], post=[20], n=np.array([_Runs()], dtype=object))

    assert refusal(tmp_path, write).startswith("edges: holds Python objects, which may run code: expected arrays")
    assert refusal(tmp_path, pickle.dumps(_Runs())).startswith("edges: ")
    assert not (tmp_path / "ran").exists()


def arrays(**columns: Any) -> Any:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, **columns)

    return write


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"pre": [10, 20], "post": [20], "n": [1]}, "edges: arrays of different lengths"),
        ({"pre": [[10]], "post": [20], "n": [1]}, "edges: column 'pre': an array of shape [1, 1]: expected one value"),
        ({"pre": [10], "post": [20], "n": ["x"]}, "edges: column 'n' holds text: expected finite numbers"),
        ({"pre": [10], "post": [20], "n": [1j]}, "edges: column 'n': an array of complex128: expected"),
        ({"pre": [-10], "post": [20], "n": [1]}, "edges: row 1, column 'pre': found -10: expected the id of a neuron"),
    ],
)
def test_npz(tmp_path: Path, columns: dict[str, Any], expected: str) -> None:
    assert refusal(tmp_path, arrays(**columns)).startswith(expected)


def test_matrices_that_are_none(tmp_path: Path) -> None:
    assert refusal(tmp_path, arrays(pre=[10], post=[20], n=[1]), layout="matrix") == (
        "edges: layout: matrix: found a list of edges: expected a matrix"
    )
    long = ",10,20\n10,1," + "1" * 200_000
    assert refusal(tmp_path, long, layout="matrix", weight=None).startswith(
        "edges: no CSV that can be read: field larger"
    )
    assert refusal(tmp_path, b",10,20\n10,1,2\n10,3,4\n", layout="matrix", weight=None) == (
        "edges: row 3, column 'pre': found '10': expected another id than that of row 2"
    )
    assert refusal(tmp_path, b",10,20\n10,1,\xff\xfe\n", layout="matrix", weight=None).startswith("edges: ")


@pytest.mark.parametrize("shape", [(4, 4), (2, 3), (3, 2)])
def test_a_matrix_of_another_size(tmp_path: Path, shape: tuple[int, int]) -> None:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.save(file, np.ones(shape))

    assert refusal(tmp_path, write, weight=None) == (
        f"edges: a matrix of shape {list(shape)}: expected [3, 3], a row for each source and a column for each target"
    )


def test_a_sparse_matrix_that_is_none(tmp_path: Path) -> None:
    parts = {"indices": [0, 1], "indptr": [0, 2, 1, 2], "data": [1.0, 2.0], "shape": [3, 3], "format": b"csr"}
    write = arrays(**parts)
    assert refusal(tmp_path, write, weight=None).startswith("edges: no npz or npy file that can be read: ValueError")


def sonata(**change: Any) -> Any:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            ids = {"source_node_id": [10, 20], "target_node_id": [20, 30], "edge_type_id": [0, 0], "0/n": [1.0, 2.0]}
            for name, values in {**ids, **change}.items():
                if isinstance(values, (h5py.SoftLink, h5py.ExternalLink)) or values is not None:
                    file[f"edges/e/{name}"] = values

    return write


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"source_node_id": None}, "edges: unknown column 'source_node_id'"),
        ({"edge_group_index": [0.0, 0.5]}, "edges: 'edges/e/edge_group_index' holds float64: expected whole numbers"),
        ({"edge_group_id": [0.0, np.nan]}, "edges: 'edges/e/edge_group_id' holds float64: expected whole numbers"),
        ({"target_node_id": None}, "edges: 'edges/e' has no 'target_node_id'"),
        ({"0/n": [1.0]}, "edges: 'edges/e/0/n' has 1 values: expected one for each of 2 rows"),
        ({"0/n": [1.0, 2.0, 3.0]}, "edges: 'edges/e/0/n' has 3 values: expected one for each of 2 rows"),
        ({"source_node_id": [10]}, "edges: 'edges/e/source_node_id' has 1 values: expected one for each of 2 rows"),
        ({"source_node_id": [10, 20, 30]}, "edges: 'edges/e/source_node_id' has 3 values: expected one for each of 2"),
        ({"0/n": [1.0, np.nan]}, "edges: row 2, column 'n': found .nan: expected a finite number"),
        ({"target_node_id": [20, 31]}, "edges: row 2, column 'target_node_id': found 31: expected the id of a neuron"),
        ({"1/n": [1.0, 2.0]}, "edges: 'edges/e' has the groups 0, 1 and no 'edge_group_id'"),
        ({"1/n": [2.0], "edge_group_id": [0, 1]}, "edges: 'edges/e' has the groups 0, 1 and no 'edge_group_index'"),
        ({"1/m": [2.0], "edge_group_id": [0, 1], "edge_group_index": [0, 0]}, "edges: row 2: its group has no 'n'"),
        (
            {"1/n": ["a"], "edge_group_id": [0, 1], "edge_group_index": [0, 0]},
            "edges: column 'n' holds text in some groups, and numbers in others",
        ),
        ({"edge_group_id": [0, 2]}, "edges: row 2, column 'edge_group_id': found 2: expected one of the groups 0"),
        (
            {"edge_group_index": [0, 7]},
            "edges: row 2, column 'edge_group_index': found 7: expected the place of one of the 2 values of",
        ),
        (
            {"edge_group_index": [0, -1]},
            "edges: row 2, column 'edge_group_index': found -1: expected the place of one of the 2 values of",
        ),
        (
            {"source_node_id": h5py.ExternalLink("other.h5", "/x")},
            "edges: 'edges/e/source_node_id': expected a data set",
        ),
        (
            {"0/n": h5py.SoftLink("/edges/e/edge_type_id")},
            "edges: 'edges/e/0/n': expected a data set of the file itself",
        ),
    ],
)
def test_sonata(tmp_path: Path, change: dict[str, Any], expected: str) -> None:
    assert refusal(tmp_path, sonata(**change)).startswith(expected)


@pytest.mark.parametrize("what", ["heap", "index", "length"])
def test_texts_of_sonata_that_are_elsewhere_are_not_read(tmp_path: Path, what: str) -> None:
    """HDF5 read on for ever."""

    def write(path: Path) -> None:
        sonata(**{"0/nt": ["a", "b"]})(path)
        content = bytearray(path.read_bytes())
        with h5py.File(path) as file:
            at = file["edges/e/0/nt"].id.get_offset() + {"length": 0, "heap": 4, "index": 12}[what]
        content[at : at + 2] = b"\xff\x7f"
        path.write_bytes(content)

    message = refusal(tmp_path, write, transmitter="nt", signs={"a": 1, "b": 1})
    assert message == "edges: 'edges/e/0/nt': expected a row of values in the file itself"


def test_a_name_that_is_no_text_in_sonata(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        sonata()(path)
        with h5py.File(path, "r+") as file:
            file["edges/e"].create_group(b"\xff\xfe")

    assert refusal(tmp_path, write).startswith("edges: no HDF5 file that can be read: ")


@pytest.mark.parametrize(
    "write", [as_parquet({"pre": [10], "post": [20], "n": [1]}), arrays(pre=[10], post=[20], n=[1]), sonata()]
)
def test_files_that_were_cut_off(tmp_path: Path, write: Any) -> None:
    write(tmp_path / "whole")
    whole = (tmp_path / "whole").read_bytes()
    assert all(refusal(tmp_path, whole[:end]).startswith("edges: ") for end in (9, len(whole) // 2, len(whole) - 3))


def test_files_that_are_none(tmp_path: Path) -> None:
    assert refusal(tmp_path, b"\xff\xfe\x00\x01junk") == (
        "edges: found no text: expected CSV, parquet, SONATA (HDF5), npz or npy"
    )
    with pytest.raises(neuro.ModelError, match="no such file"):
        neuro.Network().wiring(neurons=tmp_path / "none.csv", edges="none.csv", model=neuro.iaf_psc_exp())


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
