"""Every parameter that has a unit takes it written and refuses another dimension; what has none refuses any unit."""

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import neuro
from neuro.core.choice import Choice
from neuro.core.quantities import Quantity, word_of
from neuro.core.units import TENS, dimension_of, times, unit_of
from neuro.model import parts
from neuro.model.language.loader import TABLES
from refused import error_of

NUMBERS = ("number", "delay", "times", "moments", "series", "train")
OTHERS = (parts.Trials, parts.labels, parts.reward, parts.dropout)


def classes() -> Iterator[type[Choice]]:
    for table in TABLES.values():
        yield from table.values()
    yield from OTHERS


def parameters(of_unit: bool) -> list[tuple[Any, ...]]:
    """Each class with a word that is a number and has a unit, or has none."""
    found = []
    for cls in classes():
        for entry in fields(cls):
            q = entry.metadata["quantity"]
            unit = "ms" if q.kind in ("delay", "times", "moments", "train") else q.unit
            if q.kind in NUMBERS and not q.of_value and bool(unit) == of_unit and unit != "deg":
                found.append((cls, entry.name, q, unit))
    return found


def inside(q: Quantity) -> float:
    """A number that is accepted, not a round one."""
    low = next((b for b in (q.at_least, q.above) if b is not None), -math.inf)
    high = next((b for b in (q.at_most, q.below) if b is not None), math.inf)
    if q.whole:
        return 5.0
    if math.isinf(low):
        return -2.5 if math.isinf(high) else high - 2.5
    return low + 2.5 if math.isinf(high) else (low + high) / 2


KINDS: dict[str, Any] = {"name": "a", "shape": [1], "ids": [0], "number": 1.0, "integer": 3, "delay": 1.0}
KINDS |= {"moments": [1.0], "series": [1.0], "expression": "1", "names": ["a"]}
NEEDED: dict[tuple[str, str], Any] = {("encode", "code"): (neuro.rank(),)}


def others(cls: type[Choice]) -> dict[str, Any]:
    """What else the class needs."""
    needed = {}
    for entry in fields(cls):
        q = entry.metadata["quantity"]
        if word_of(entry.name) not in cls.defaults():
            needed[entry.name] = NEEDED.get((cls.called(), entry.name), KINDS.get(q.kind))
    return needed


def error(cls: type[Choice], name: str, value: Any) -> str:
    return error_of(cls, **(others(cls) | {name: value})).message


def shaped(q: Quantity, one: Any) -> Any:
    return {"times": [[one]], "moments": [one], "series": [one], "train": [[one, 0]]}.get(q.kind, one)


def test_a_unit_is_taken_and_another_dimension_refused():
    for cls, name, q, unit in parameters(of_unit=True):
        what = f"{cls.called()}.{word_of(name)}"
        other = (unit_of(times(dimension_of(unit), dimension_of("mV"))) or "ms").replace(" ", "*")
        told = error(cls, name, shaped(q, f"1 {other}"))
        assert told.startswith(what)
        assert f"= 1 {other}: expected a" in told, what
        assert told.endswith(f" in {unit}"), what
        value = 2.5 if q.kind in ("delay", "times", "moments", "train") else inside(q)
        assert taken(q, cls, name, f"{value} {unit}") == taken(q, cls, name, value), what
        for tens in {tens for tens, dimension in TENS.values() if dimension == dimension_of(unit)}:
            near = next(u for u, (t, d) in TENS.items() if t == tens and d == dimension_of(unit))
            here = TENS[unit][0] if unit in TENS else 0
            written = f"{value}e{here - tens} {near}"
            assert taken(q, cls, name, written) == taken(q, cls, name, value), (what, written)


def taken(q: Quantity, cls: type[Choice], name: str, one: Any) -> Any:
    """What a value becomes, or how it is refused for another reason than its unit."""
    from neuro.core.checks import check

    found = check(q, shaped(q, one), name)
    if q.kind in ("times", "train"):
        return [list(map(float, row)) for row in found]
    return np.atleast_1d(found).tolist()


def test_what_has_no_unit_says_so():
    for cls, name, q, _ in parameters(of_unit=False):
        what = f"{cls.called()}.{word_of(name)}"
        assert error(cls, name, shaped(q, "1 mV")).startswith(f"{what} = 1 mV: expected a number without unit"), what


@pytest.mark.parametrize("cls", [neuro.ac_generator, neuro.noise_generator, neuro.sinusoidal_poisson_generator])
def test_a_degree_has_no_other_unit_beside_it(cls):
    assert cls(phase="90 deg").phase == 90.0
    for given in ("1 mV", "1 rad"):
        assert error(cls, "phase", given) == f"{cls.called()}.phase = {given}: expected a number in deg"


IN_WEIGHTS = sorted(
    (cls.called(), entry.name)
    for cls in TABLES["synapse"].values()
    for entry in fields(cls)
    if entry.metadata["quantity"].of_value
)


@pytest.mark.parametrize(("name", "word"), IN_WEIGHTS)
def test_the_unit_of_the_weight(name, word):
    cls = TABLES["synapse"][name]
    what = f"projection 'p': {name}.{word_of(word)}"
    sign = math.copysign(1.0, cls.defaults()[word_of(word)])
    for model, unit, milli, kind in (
        (neuro.iaf_psc_exp(), "nA", "pA", "a current"),
        (neuro.iaf_psc_delta(), "V", "mV", "a voltage"),
        (neuro.iaf_cond_exp(), "uS", "nS", "a conductance"),
    ):
        net = neuro.Network("n")
        net.population("a", 2, model)
        some = {"dopamine": "a"} if name == "stdp_dopa" else {}
        high = {"Wmax": 2000.0} if word == "Wmin" else {}
        synapse = cls(**{word: f"{sign * 0.5} {unit}"}, **some, **high)
        part = net.connect("a", "a", neuro.all_to_all(), synapse, name="p")
        assert getattr(part.synapse, word) == sign * 500.0
        refusal = error_of(net.connect, "a", "a", neuro.all_to_all(), cls(**{word: "1 ms"}, **some), name="p")
        assert refusal.message == f"{what} = 1 ms: expected {kind} in {milli}"


def test_some_of_each(folder):
    net = neuro.Network("n")
    net.population("a", 2, neuro.iaf_psc_exp())
    for value, expected in (
        (["0.1 nA", 50.0], [100.0, 50.0]),
        (neuro.uniform(low="0.1 nA", high="200 pA"), neuro.uniform(low=100.0, high=200.0)),
    ):
        part = net.connect("a", "a", neuro.one_to_one(), neuro.stdp(Wmax=value), name=f"p{len(net.projections)}")
        found = part.synapse.Wmax
        assert found == expected if isinstance(expected, neuro.uniform) else found.tolist() == expected
    for value, told in (
        ([1.0, "1 mV"], "stdp.Wmax[1] = 1 mV: expected a current in pA"),
        (neuro.uniform(low="1 mV"), "stdp.Wmax: uniform.low = 1 mV: expected a current in pA"),
    ):
        refusal = error_of(net.connect, "a", "a", neuro.one_to_one(), neuro.stdp(Wmax=value), name="p")
        assert refusal.message == f"projection 'p': {told}"


HEAD = "neuro: 1\npopulations:\n  a: {model: iaf_psc_exp, shape: [2, 2]}\n"
WORDS = {
    "resolution": ("resolution: @\n" + HEAD.replace("neuro: 1\n", ""), "100 us", "1 mV", "a time in ms"),
    "initial.V_m": (HEAD.replace("[2, 2]", "2, initial: {V_m: @}"), "-0.07 V", "1 ms", "a voltage in mV"),
    "extent": (HEAD.replace("[2, 2]", "2, extent: [@]"), "", "1 ms", "a number without unit"),
    "weight": (HEAD + "projections: {p: {from: a, to: a, rule: all_to_all, weight: @}}\n", "1 nA", "1 ms", ""),
    "delay": (HEAD + "projections: {p: {from: a, to: a, rule: all_to_all, delay: @}}\n", "0.001 s", "1 mV", ""),
    "every": (HEAD + "probes: {p: {of: a, record: V_m, every: @}}\n", "0.01 s", "1 mV", "a time in ms"),
    "Wmax": (
        HEAD + "projections: {p: {from: a, to: a, rule: all_to_all, synapse: {stdp: {Wmax: @}}}}\n",
        "0.2 nA",
        "1 ms",
        "a current in pA",
    ),
}


@pytest.mark.parametrize("word", WORDS)
def test_words_of_parts(folder, word):
    text, right, wrong, expected = WORDS[word]
    if right:
        (folder / "net.yaml").write_text(text.replace("@", right))
        neuro.load("net.yaml")
    (folder / "net.yaml").write_text(text.replace("@", wrong))
    refusal = error_of(neuro.load, "net.yaml")
    assert f"= {wrong}: expected {expected}" in refusal.message
    at = refusal.where
    assert at is not None
    line = text.replace("@", wrong).splitlines()[at.line - 1]
    assert line[at.column - 1 :].startswith((wrong, "["))
