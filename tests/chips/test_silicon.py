"""Bills beside what was measured on machines: `benchmarks/silicon.py`, and the page that has its table."""

import json
import re
import sys
from pathlib import Path

import pytest

from benchmark_scripts import script
from beside import beside

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "silicon.md").read_text()

(FACTORS,) = beside(__file__, "factors")


silicon = script("silicon")


@pytest.fixture(scope="module")
def outcomes():
    return {row.what: silicon.predict(row) for row in silicon.ROWS}


def test_predicted_by_measured(outcomes):
    assert {what: found.factor for what, found in outcomes.items()} == pytest.approx(FACTORS, rel=0.1)
    for found in outcomes.values():
        assert found.low <= found.best <= found.high
        assert found.inside


def test_rows_that_nothing_was_taken_from():
    """At least three machines are checked by measurements from which neither best values nor ranges were taken."""
    free = [row for row in silicon.ROWS if not row.own and not row.ends]
    assert {row.target for row in free} == {"loihi", "spinnaker", "truenorth"}
    assert len([row for row in silicon.ROWS if not row.own]) >= 10


def test_the_page_counts_the_rows_that_are_predictions():
    rows = silicon.ROWS
    own, ends, free = (
        sum(test(row) for row in rows)
        for test in (lambda row: row.own, lambda row: row.ends, lambda row: not row.own and not row.ends)
    )
    told = f"Of the other {own + ends}, {own} give the table its best figures and {ends} an end of a range"
    assert f"**{free} of the {len(rows)} rows are pure predictions**" in PAGE
    assert told in " ".join(PAGE.split())


def test_every_row_has_its_source():
    for row in silicon.ROWS:
        assert re.search(r"\b(19|20)\d\d\b|arXiv:\d", row.source)
        assert row.how
        assert row.measured > 0.0


def test_the_page_has_the_table(outcomes):
    """Each row, its factor to a tenth, and what it was used for."""
    rows = dict(re.findall(r"^\| ((?:Loihi|CPU|GPU|SpiNNaker|TrueNorth)[^|]*) \| [^|]+\|([^\n]*)\|$", PAGE, re.M))
    for what, found in outcomes.items():
        _, _, factor, mark = (cell.strip() for cell in rows[what].split("|"))
        assert float(factor) == pytest.approx(found.factor, rel=0.1), what
        assert mark == silicon.table([found]).splitlines()[-1].split("|")[-2].strip()


def test_json(outcomes, monkeypatch, capsys):
    monkeypatch.setattr(silicon, "ROWS", silicon.ROWS[9:10])
    monkeypatch.setattr(sys, "argv", ["silicon.py", "--json"])
    assert silicon.main() == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert (told["target"], told["measured"], told["own"]) == ("truenorth", 0.068, True)
    assert told["low"] <= told["predicted"] <= told["high"]
