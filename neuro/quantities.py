"""Parameters that know their unit and their bounds: the fields of models, synapses, rules and groups."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.errors import ModelError, here, unknown

Value: TypeAlias = Any  # float | per-element array | Choice (a distribution) | FromFile; narrowed by check()


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a parameter may be.

    Attributes:
        unit: physical unit, "" for none.
        doc: one line on its meaning.
        kind: "number", "integer", "boolean", "name" (of a part of the network), "word" (one of
            `words`), "shape" (a list of integers), "times" (spike times, a list per neuron), "ids",
            "delay" (a time, may be left out), "names" (a list of names) or "part" (a `part`).
        above, at_least, below, at_most: bounds of every element.
        infinite: whether an infinite value has a meaning.
        arrays: whether one value per element (an array or a distribution) is accepted.
        words: the accepted words of kind "word".
        part: the class of kind "part".
    """

    unit: str = ""
    doc: str = ""
    kind: str = "number"
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    infinite: bool = False
    arrays: bool = False
    words: tuple[str, ...] = ()
    part: type[Choice] | None = None

    def expected(self) -> str:
        """The sentence part that says what is accepted, e.g. "a number > 0 ms"."""
        if self.kind == "word":
            return "one of " + ", ".join(self.words)
        noun = {
            "number": "a number",
            "integer": "a whole number",
            "boolean": "true or false",
            "name": "a name",
            "shape": "a list of whole numbers",
            "times": "a list of spike times in ms for each neuron",
            "ids": "a list of whole numbers",
            "delay": "a time > 0 ms",
            "names": "a list of names",
            "part": f"the words of {self.part.__name__}" if self.part else "",
        }[self.kind]
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in (
                (">", self.above),
                (">=", self.at_least),
                ("<", self.below),
                ("<=", self.at_most),
            )
            if bound is not None
        ]
        text = " ".join([noun, " and ".join(bounds)]) if bounds else noun
        unit = f" {self.unit}" if self.unit and self.kind == "number" else ""
        return text + unit


def quantity(default: Any = MISSING, unit: str = "", doc: str = "", **more: Any) -> Any:
    """A dataclass field that carries a `Quantity`; see there for `more`."""
    return field(default=default, metadata={"quantity": Quantity(unit=unit, doc=doc, **more)})


def word_of(name: str) -> str:
    """The word of the language for a Python field name (`lambda_` is `lambda`)."""
    return name.rstrip("_")


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """A named choice with parameters, said `name(parameters)` in Python and `{name: {parameters}}` in YAML.

    Subclasses are frozen dataclasses whose fields are made by `quantity`. Two choices are equal when
    they have the same name and equal parameters, arrays compared by value.
    """

    kind: ClassVar[str] = "choice"

    def __new__(cls, *args: Any, **words: Any) -> Self:
        """Refuse an unknown parameter by its nearest right name."""
        known = {entry.name for entry in fields(cls)}
        for word in words:
            if word not in known:
                raise unknown(f"parameter of {cls.__name__}", word, known, here(), (word,))
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for entry in fields(self):
            checked = check(entry.metadata["quantity"], getattr(self, entry.name), f"{self.name}.{word_of(entry.name)}")
            object.__setattr__(self, entry.name, checked)

    @property
    def name(self) -> str:
        """The word that names this choice in the language."""
        return type(self).__name__

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """The parameters by their words, in the order of definition."""
        return {word_of(entry.name): entry.metadata["quantity"] for entry in fields(cls)}

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """The default of each parameter that has one, by its word."""
        return {word_of(f.name): f.default for f in fields(cls) if f.default is not MISSING}

    @classmethod
    def from_words(cls, parameters: Mapping[str, Any]) -> Choice:
        """Make one from words and values.

        Raises:
            ModelError: a word is unknown, a required one is missing, or a value is out of bounds.
        """
        names = {word_of(entry.name): entry for entry in fields(cls)}
        for word in parameters:
            if word not in names:
                raise unknown(f"parameter of {cls.__name__}", word, names, path=(str(word),))
        for word, entry in names.items():
            if entry.default is MISSING and word not in parameters:
                expected = entry.metadata["quantity"].expected()
                raise ModelError(f"{cls.__name__} needs '{word}': expected {expected}")
        return cls(**{names[word].name: value for word, value in parameters.items()})

    def parameters(self) -> dict[str, Any]:
        """All parameters by their words, in the order of definition."""
        return {word_of(entry.name): getattr(self, entry.name) for entry in fields(self)}

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        mine, theirs = self.parameters(), other.parameters()  # type: ignore[attr-defined]
        return all(same(mine[word], theirs[word]) for word in mine)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        shown = ", ".join(f"{f.name}={_shown(getattr(self, f.name))}" for f in fields(self) if not _is_default(self, f))
        return f"{self.name}({shown})"


@dataclass(frozen=True, slots=True)
class FromFile:
    """Values read from an HDF5 (`key` names the data set) or NPY file beside the YAML file."""

    file: str
    key: str
    values: NDArray[np.float64]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FromFile) and same(self.values, other.values)


def same(a: Any, b: Any) -> bool:
    """Equality that compares arrays by value and looks through `FromFile`."""
    a = a.values if isinstance(a, FromFile) else a
    b = b.values if isinstance(b, FromFile) else b
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return type(a) is type(b) and a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=True))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)


def check(q: Quantity, value: Any, what: str) -> Any:
    """Return `value` in its canonical form, or say what is wrong with it.

    Args:
        q: what the parameter may be.
        value: a number, word, list, array, distribution or `FromFile`.
        what: the full name for the message, e.g. "iaf_psc_exp.tau_m".

    Raises:
        ModelError: it is none of the accepted kinds, or out of bounds (the first such element is named).
    """
    checker = _CHECKERS.get(q.kind, _check_number)
    return checker(q, value, what)


def wrong(q: Quantity, value: Any, what: str, element: str = "") -> ModelError:
    """The error for a value that a quantity does not accept."""
    return ModelError(f"{what}{element} = {_shown(value)}: expected {q.expected()}", path=(what.rpartition(".")[2],))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, (bool, np.bool_))


def _within(q: Quantity, x: float) -> bool:
    return not (
        math.isnan(x)
        or (math.isinf(x) and not q.infinite)
        or (q.above is not None and not x > q.above)
        or (q.at_least is not None and not x >= q.at_least)
        or (q.below is not None and not x < q.below)
        or (q.at_most is not None and not x <= q.at_most)
    )


def _check_number(q: Quantity, value: Any, what: str) -> Any:
    if _is_number(value):
        if not _within(q, float(value)):
            raise wrong(q, value, what)
        return float(value)
    if not q.arrays:
        raise wrong(q, value, what)
    if isinstance(value, Choice) and value.kind == "distribution":
        return value
    if isinstance(value, FromFile):
        _check_array(q, value.values, what)
        return value
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise wrong(q, value, what) from None
    if array.ndim == 0 or array.dtype == object or isinstance(value, (str, bytes, bool)):
        raise wrong(q, value, what)
    _check_array(q, array, what)
    array.flags.writeable = False
    return array


def _check_array(q: Quantity, array: NDArray[np.float64], what: str) -> None:
    flat = array.ravel()
    good = ~np.isnan(flat)
    if not q.infinite:
        good &= np.isfinite(flat)
    for bound, compare in (
        (q.above, np.greater),
        (q.at_least, np.greater_equal),
        (q.below, np.less),
        (q.at_most, np.less_equal),
    ):
        if bound is not None:
            good &= compare(flat, bound)
    bad = np.flatnonzero(~good)
    if bad.size:
        raise wrong(q, float(flat[bad[0]]), what, f"[{bad[0]}]")


def _check_integer(q: Quantity, value: Any, what: str) -> int:
    if not _is_number(value) or float(value) != int(value) or not _within(q, float(value)):
        raise wrong(q, value, what)
    return int(value)


def _check_boolean(q: Quantity, value: Any, what: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise wrong(q, value, what)
    return bool(value)


def _check_name(q: Quantity, value: Any, what: str) -> str | None:
    if value is None:
        return None
    text = getattr(value, "name", value)
    if not isinstance(text, str):
        raise wrong(q, value, what)
    return text


def _check_word(q: Quantity, value: Any, what: str) -> str:
    if value not in q.words:
        error = wrong(q, value, what)
        raise ModelError(error.message, hint=unknown("word", value, q.words).hint, path=error.path)
    return str(value)


def _check_shape(q: Quantity, value: Any, what: str) -> tuple[int, ...]:
    items = [value] if _is_number(value) else value
    if not isinstance(items, (list, tuple, np.ndarray)) or len(items) == 0:
        raise wrong(q, value, what)
    for item in items:
        if not _is_number(item) or float(item) != int(item) or not _within(q, float(item)):
            raise wrong(q, value, what)
    return tuple(int(item) for item in items)


def _check_ids(q: Quantity, value: Any, what: str) -> NDArray[np.int64]:
    if isinstance(value, FromFile):
        value = value.values
    array = np.asarray(value)
    if array.ndim != 1 or array.dtype.kind not in "iuf" or (array.size and np.any(array != np.floor(array))):
        raise wrong(q, value, what)
    if array.size and array.min() < 0:
        bad = int(np.flatnonzero(array < 0)[0])
        raise wrong(q, array[bad].item(), what, f"[{bad}]")
    ids = array.astype(np.int64)
    ids.flags.writeable = False
    return ids


def _check_times(q: Quantity, value: Any, what: str) -> tuple[NDArray[np.float64], ...]:
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise wrong(q, value, what)
    rows = [value] if len(value) and all(_is_number(v) for v in value) else list(value)
    out = []
    for n, row in enumerate(rows):
        times = np.asarray(row, dtype=np.float64) if _all_numbers(row) else None
        if times is None or times.ndim != 1:
            raise wrong(q, row, what, f"[{n}]")
        if times.size and (not np.all(np.isfinite(times)) or times.min() <= 0 or np.any(np.diff(times) < 0)):
            raise ModelError(
                f"{what}[{n}]: expected spike times > 0 ms in ascending order",
                path=(what.rpartition(".")[2],),
            )
        times.flags.writeable = False
        out.append(times)
    return tuple(out)


def _all_numbers(row: Any) -> bool:
    return isinstance(row, np.ndarray) or (isinstance(row, (list, tuple)) and all(_is_number(v) for v in row))


def _shown(value: Any) -> str:
    if isinstance(value, FromFile):
        return f"{{file: {value.file}}}"
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    text = f"{value:g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _is_default(choice: Choice, entry: Field[Any]) -> bool:
    return entry.default is not MISSING and same(getattr(choice, entry.name), entry.default)


def _check_delay(q: Quantity, value: Any, what: str) -> float | None:
    if value is None:
        return None
    if not _is_number(value) or not math.isfinite(value) or value <= 0:
        raise wrong(q, value, what)
    return float(value)


def _check_names(q: Quantity, value: Any, what: str) -> tuple[str, ...]:
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, (list, tuple)) or not all(isinstance(item, str) for item in items):
        raise wrong(q, value, what)
    return tuple(items)


def _check_part(q: Quantity, value: Any, what: str) -> Any:
    assert q.part is not None
    if value is None or isinstance(value, q.part):
        return value
    if not isinstance(value, Mapping):
        raise wrong(q, value, what)
    return q.part.from_words(value)


_CHECKERS = {
    "names": _check_names,
    "part": _check_part,
    "delay": _check_delay,
    "integer": _check_integer,
    "boolean": _check_boolean,
    "name": _check_name,
    "word": _check_word,
    "shape": _check_shape,
    "ids": _check_ids,
    "times": _check_times,
}
