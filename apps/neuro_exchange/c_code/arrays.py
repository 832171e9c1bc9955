"""Arrays as C in the narrowest type that holds the values, and the sizes of arrays in flash and RAM."""

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
    """Return the narrowest type that holds whole numbers from `low` to `high`, unsigned where possible."""
    for kind in TYPES:
        limits = np.iinfo(kind)
        if limits.min <= low and high <= limits.max:
            return kind
    raise ModelError(f"a register holds {low} to {high}: expected numbers of 64 bits")


def number(value: int) -> str:
    """Return a whole number as a C constant. Numbers of more than 32 bits have the macro of a 64-bit type."""
    if -(2**31) < value < 2**31:
        return str(value)
    if value == -(2**31):
        return "(-2147483647 - 1)"
    return f"INT64_C({value})" if value < 2**63 else f"UINT64_C({value})"


def comment(text: str) -> str:
    """Return a text that is safe inside a C comment: other characters than letters, digits and " _.,:()-" become _."""
    return "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in " _.,:()-") else "_" for letter in text
    )


@dataclass(frozen=True, slots=True, eq=False)
class ScaledInts:
    """Whole numbers as the product of a factor and smaller numbers, which need a narrower type.

    Attributes:
        stored: the smaller numbers, in the narrowest type.
        factor: a power of two or its negative.
    """

    stored: NDArray[np.integer]
    factor: int


def scaled(values: Ints) -> ScaledInts:
    """Factor out the common power of two, and the sign if no value is positive, e.g. [-4, -8] = -4 * [1, 2]."""
    all_bits = int(np.bitwise_or.reduce(np.abs(values), initial=0))
    shift = min((all_bits & -all_bits).bit_length() - 1, _LARGEST_SCALE) if all_bits else 0
    sign = -1 if all_bits and values.max() <= 0 else 1
    stored = sign * (values >> shift)
    return ScaledInts(stored.astype(narrowest(int(stored.min(initial=0)), int(stored.max(initial=0)))), sign << shift)


@dataclass(slots=True)
class Memory:
    """Declarations of the arrays of a network, and their sizes.

    Attributes:
        flash: bytes of all constant arrays.
        ram: bytes of all other arrays and variables; an upper bound, which includes the gaps between them.
        lines: the declarations.
    """

    flash: int = 0
    ram: int = 0
    lines: list[str] = field(default_factory=list)

    def table(self, name: str, values: NDArray[np.integer], about: str, unsigned: bool = False) -> str:
        """Declare an array of constants, and return its name. With `unsigned`, numbers of 32 bits are unsigned."""
        kind = narrowest(int(values.min(initial=0)), int(values.max(initial=0)))
        values = values.astype(np.dtype(np.uint32) if unsigned and kind == np.int32 else kind)
        self.flash += values.nbytes
        self.lines.append(f"/* {comment(about)} */")
        self.constants(name, TYPES[values.dtype], [number(value) for value in values.ravel().tolist()])
        return name

    def entry(self, name: str, values: NDArray[np.integer], about: str) -> str:
        """Return the text of element i of some constants: a number if all are equal, else an entry of a table."""
        if np.all(values == values.flat[:1]):
            return number(int(values.flat[0])) if values.size else "0"
        return f"{self.table(name, values, about)}[i]"

    def constants(self, name: str, kind: str, words: Sequence[str]) -> None:
        """Declare an array of constants from their texts."""
        self.lines += [f"static const {kind} {name}[{len(words)}] = {{", *_wrapped(words), "};"]

    def state(self, name: str, kind: str, size: int, about: str) -> str:
        """Declare an array of variables, and return its name."""
        self.ram += bytes_in_ram(kind, size)
        self.lines.append(f"static {kind} {name}[{size}]; /* {comment(about)} */")
        return name

    def variable(self, name: str, kind: str, about: str) -> str:
        """Declare a variable, and return its name."""
        self.ram += bytes_in_ram(kind)
        self.lines.append(f"static {kind} {name}; /* {comment(about)} */")
        return name


def bytes_in_ram(kind: str, size: int = 0) -> int:
    """Return an upper bound of the bytes of an array of a C type, or of a single number for size 0."""
    # Compilers align arrays and numbers of 64 bits to 8 bytes.
    gap = 4 if size or bytes_per_number(kind) == 8 else 0
    return -(-max(1, size) * bytes_per_number(kind) // 4) * 4 + gap


def bytes_per_number(kind: str) -> int:
    """Return the bytes of a number of a C type."""
    return next(dtype.itemsize for dtype, name in TYPES.items() if name == kind)


def _wrapped(texts: Sequence[str]) -> list[str]:
    """Return lines of words, each followed by a comma."""
    lines, line = list[str](), "   "
    for word in texts:
        if len(line) + len(word) + 2 > _LINE:
            lines.append(line)
            line = "   "
        line += f" {word},"
    return [*lines, line]
