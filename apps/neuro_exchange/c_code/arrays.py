"""Arrays as C: the narrowest type that holds the values, and the bytes that they take in flash and RAM."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.extend import Ints

TYPES = {
    np.dtype(name): f"{name}_t" for name in ("uint8", "int8", "uint16", "int16", "int32", "uint32", "int64", "uint64")
}
_LINE = 108
_LARGEST_SCALE = 15


def narrowest(low: int, high: int) -> np.dtype[np.integer]:
    """The narrowest type that holds whole numbers from `low` to `high`, unsigned where either can be."""
    for kind in TYPES:
        limits = np.iinfo(kind)
        if limits.min <= low and high <= limits.max:
            return kind
    raise ModelError(f"a register holds {low} to {high}: expected numbers of 64 bits")


def number(value: int) -> str:
    """A whole number as a C constant of the type of its place, from 32 bits on with a suffix."""
    if -(2**31) < value < 2**31:
        return str(value)
    if value == -(2**31):
        return "(-2147483647 - 1)"
    return f"INT64_C({value})" if value < 2**63 else f"UINT64_C({value})"


def comment(text: str) -> str:
    """A name of the user inside a comment."""
    return "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in " _.,:()-") else "_" for letter in text
    )


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """Whole numbers as `factor` times stored ones, so that these are narrow.

    Attributes:
        stored: in the narrowest type.
        factor: a power of two or its negative.
    """

    stored: NDArray[np.integer]
    factor: int


def scaled(values: Ints) -> Scaled:
    """Words with the power of two that all have in common taken out, and a sign if none is positive."""
    together = int(np.bitwise_or.reduce(np.abs(values), initial=0))
    shift = min((together & -together).bit_length() - 1, _LARGEST_SCALE) if together else 0
    sign = -1 if together and values.max() <= 0 else 1
    stored = sign * (values >> shift)
    return Scaled(stored.astype(narrowest(int(stored.min(initial=0)), int(stored.max(initial=0)))), sign << shift)


@dataclass(slots=True)
class Memory:
    """Arrays of a network as declarations, and what they take.

    Attributes:
        flash, ram: bytes of constant arrays, and of others with the gaps between them, at most.
        lines: the declarations.
    """

    flash: int = 0
    ram: int = 0
    lines: list[str] = field(default_factory=list)

    def table(self, name: str, values: NDArray[np.integer], about: str, unsigned: bool = False) -> str:
        """Declare constants; returns the name."""
        kind = narrowest(int(values.min(initial=0)), int(values.max(initial=0)))
        values = values.astype(np.dtype(np.uint32) if unsigned and kind == np.int32 else kind)
        self.flash += values.nbytes
        self.lines.append(f"/* {comment(about)} */")
        self.constants(name, TYPES[values.dtype], [number(value) for value in values.ravel().tolist()])
        return name

    def entry(self, name: str, values: NDArray[np.integer], about: str) -> str:
        """Return number i of some constants as text: what all have in common, or an entry of a table."""
        if np.all(values == values.flat[:1]):
            return number(int(values.flat[0])) if values.size else "0"
        return f"{self.table(name, values, about)}[i]"

    def constants(self, name: str, kind: str, words: Sequence[str]) -> None:
        """Declare constants of a type by their text."""
        self.lines += [f"static const {kind} {name}[{len(words)}] = {{", *_wrapped(words), "};"]

    def state(self, name: str, kind: str, size: int, about: str) -> str:
        """Declare what a network changes; returns the name."""
        self.ram += room_of(kind, size)
        self.lines.append(f"static {kind} {name}[{size}]; /* {comment(about)} */")
        return name

    def variable(self, name: str, kind: str, about: str) -> str:
        """Declare one number that a network changes; returns the name."""
        self.ram += room_of(kind)
        self.lines.append(f"static {kind} {name}; /* {comment(about)} */")
        return name


def room_of(kind: str, size: int = 0) -> int:
    """Bytes of an array of a C type, or of one number, at most: compilers let arrays and long numbers begin at 8 n."""
    gap = 4 if size or bytes_of(kind) == 8 else 0
    return -(-max(1, size) * bytes_of(kind) // 4) * 4 + gap


def bytes_of(kind: str) -> int:
    """Bytes of a number of a C type."""
    return next(dtype.itemsize for dtype, name in TYPES.items() if name == kind)


def _wrapped(words: Sequence[str]) -> list[str]:
    """Words with commas behind them, in lines."""
    lines, line = list[str](), "   "
    for word in words:
        if len(line) + len(word) + 2 > _LINE:
            lines.append(line)
            line = "   "
        line += f" {word},"
    return [*lines, line]
