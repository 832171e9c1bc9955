"""Mistakes that have nothing to do with each other: `neuro check` tells all of them, where they are, and no other."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from beside import beside
from neuro.compiler.mistakes import mistakes
from rewording import same_if_reworded

PAIRS, TRIALS, IN_PAIRS, IN_TRIALS, DECIDES = beside(__file__, "PAIRS", "TRIALS", "IN_PAIRS", "IN_TRIALS", "DECIDES")
# What is written in place of a line's end, by what the line begins with, below the part; and what is told.
Planted = dict[str, tuple[str, str, str, str]]
"""What cannot be judged beside a mistake: how many there are, of which class, of what."""


def planted(text: str, part: str, word: str, instead: str) -> tuple[str, int]:
    """The text with one line changed, and that line's number."""
    lines = text.splitlines()
    begin = next(k for k, line in enumerate(lines) if re.match(rf" *{re.escape(part)}(:|$)", line) or line == part)
    at = begin
    if word:
        at = next(k for k in range(begin + 1, len(lines)) if re.match(rf" *{re.escape(word)}(:|$)", lines[k]))
    before = lines[at]
    if ":" in word or instead.endswith(":"):
        lines[at] = before.replace(word or f"{part}:", instead)
    else:
        lines[at] = re.sub(r": .*", lambda _: f": {instead}", before)
    assert lines[at] != before
    return "\n".join(lines) + "\n", at + 1


def told(text: str) -> list[str]:
    Path("net.yaml").write_text(text)
    return [str(error) for error in mistakes("net.yaml", None, 0).mistakes]


def alone(text: str, entry: tuple[str, str, str, str]) -> str:
    """What is told of one mistake, which says what it should and stands in its line or at its part."""
    part, word, instead, message = entry
    changed, line = planted(text, part, word, instead)
    found = told(changed)
    assert len(found) == 1, found
    assert message in found[0], found
    place = re.match(r"net\.yaml:(\d+):(\d+): ", found[0])
    assert place, found
    at = changed.splitlines()[int(place[1]) - 1]
    assert int(place[1]) == line or at.strip().startswith(f"{part}:"), found
    assert int(place[2]) >= len(at) - len(at.lstrip()) + 1
    return found[0]


@pytest.fixture(scope="module")
def singles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("singles"))
        assert told(PAIRS) == told(TRIALS) == []
        return {name: alone(PAIRS, entry) for name, entry in IN_PAIRS.items()} | {
            f"trials: {name}": alone(TRIALS, entry) for name, entry in IN_TRIALS.items()
        }


def together(text: str, catalogue: Planted, names: set[str]) -> list[str]:
    for name in names:
        part, word, instead, _ = catalogue[name]
        text, _ = planted(text, part, word, instead)
    return told(text)


ANY = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def independent(catalogue: Planted) -> st.SearchStrategy[set[str]]:
    """Names of mistakes, at most one a line, none of which keeps another from being judged."""
    some = st.lists(st.sampled_from(sorted(catalogue)), min_size=2, max_size=12)
    return some.map(lambda names: chosen(catalogue, names))


def chosen(catalogue: Planted, names: list[str]) -> set[str]:
    lines = {(catalogue[name][0], catalogue[name][1].partition(":")[0]): name for name in names}
    kept = set(lines.values())
    hidden = {other for name in kept for other in DECIDES.get(name, [])}
    hidden |= {name for name in kept if "resolution" in kept and ("off the grid" in name or "below a step" in name)}
    hidden |= {name for name in kept if "resolution" in kept and name == "delay of inh_own"}
    return kept - hidden


@given(names=independent(IN_PAIRS))
@ANY
def test_all_of_a_network_with_stdp(folder, singles, names):
    assert sorted(together(PAIRS, IN_PAIRS, names)) == sorted(singles[name] for name in names)


@given(names=independent(IN_TRIALS))
@ANY
def test_all_of_a_network_with_trials(folder, singles, names):
    assert sorted(together(TRIALS, IN_TRIALS, names)) == sorted(singles[f"trials: {name}"] for name in names)


@pytest.mark.parametrize(("text", "catalogue"), [(PAIRS, IN_PAIRS), (TRIALS, IN_TRIALS)])
@given(data=st.data())
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_program_reads_the_messages(folder, data, text, catalogue):
    for name in data.draw(independent(catalogue)):
        part, word, instead, _ = catalogue[name]
        text, _ = planted(text, part, word, instead)
    same_if_reworded(text)
