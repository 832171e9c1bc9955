"""Names that are terms of the project are allowed with a reason, in the files that the allow-list gives."""

import sys
from pathlib import Path

import pytest

CI = Path(__file__).parent.parent / ".ci"
sys.path.append(str(CI))

import plain  # noqa: E402

SOURCE = "left, found = 1, 2\n\n\ndef f(_left): ...\n"
ENTRY = '[[term]]\nname = "left"\nreason = "the side"\nfiles = ["apps/a/*", "neuro/b.py"]\n'


def names(file: str) -> list[tuple[int, str]]:
    return [(line, name) for _, line, name in plain.hits(SOURCE, file, plain.terms(ENTRY))]


@pytest.mark.parametrize("file", ["apps/a/c.py", "apps/a/d/c.py", "neuro/b.py"])
def test_terms_are_not_counted_in_their_files(file):
    assert names(file) == [(1, "found")]


@pytest.mark.parametrize("file", ["", "apps/b/c.py", "neuro/b/c.py"])
def test_terms_are_counted_in_all_other_files(file):
    assert sorted(names(file)) == [(1, "found"), (1, "left"), (4, "_left")]


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ('"left"', '"rows"', ValueError),
        ("the side", " ", ValueError),
        ("files", "in", TypeError),
        ("reason", "#", TypeError),
    ],
)
def test_entries_need_a_counted_name_a_reason_and_files(old, new, error):
    with pytest.raises(error):
        plain.terms(ENTRY.replace(old, new))


def test_the_allow_list_names_files_that_exist():
    terms = plain.terms(plain.TERMS.read_text("utf-8"))
    assert terms
    for term in terms:
        assert all(any(CI.parent.glob(pattern)) for pattern in term.files), term
