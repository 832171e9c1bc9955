"""Command lines that are mistaken: what was expected."""

import pytest


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("plot o.h5 --format gif", "error: '--format': found 'gif': expected one of 'png', 'pdf', 'svg'\n"),
        ("check a.yaml b.yaml", "error: found 'b.yaml', too: expected neuro check FILE [OPTIONS]\n"),
        ("report o.h5 p.h5 q.h5", "error: found 'p.h5 q.h5', too: expected neuro report FILE [OPTIONS]\n"),
    ],
)
def test_what_is_expected(neuro, line, expected):
    answer = neuro(*line.split())
    assert (answer.status, answer.err.startswith(expected)) == (2, True), answer.err


@pytest.mark.parametrize("command", ["energy", "run", "check"])
def test_results_in_place_of_a_network(neuro, tmp_path, command):
    file = tmp_path / "o.h5"
    file.write_bytes(b"\x89HDF\r\n\x1a\n")
    assert neuro(command, file).err == (
        f"error: {file}:1:1: found the byte 0x89: expected UTF-8 text\n"
        "  hint: an HDF5 file, as results are: neuro report FILE tells what these hold, and their bill\n"
    )
