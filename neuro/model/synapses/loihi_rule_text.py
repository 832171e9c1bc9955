"""Reading a learning rule as users of the chip write it, e.g. "2^-2*x1*y0 - 3*2^-5*u2*(w - 12)*x0"."""

from __future__ import annotations

import re

from neuro.core.errors import ModelError
from neuro.core.hints import near
from neuro.model.synapses.loihi_rule import FACTORS, LARGEST_CONSTANT, LARGEST_U, Factor, Term

_TOKEN = re.compile(r"\s*(?:(\d+\.\d*|\.\d+)|(2\s*\^\s*[+-]?\d+)|(\d+)|([A-Za-z_]\w*)|(.))")
_DECIMAL, _POWER, _INTEGER, _NAME, _MARK = range(1, 6)
_REFUSED = {
    "d": "delays do not learn here",
    "r": "the modulatory traces are r1 (adds) and r2 (subtracts)",
    "u": "say how often: u0 in every epoch, u3 in every 8th",
}


def parse(rule: str, what: str = "dw") -> tuple[Term, ...]:
    """Read a sum of products; "" is the empty one.

    Args:
        rule: the text. A product is factors joined by "*": whole numbers, powers 2^n, x0 .. y3, r1, r2, w, t, u0 .. u9
            or (factor + constant). One without x0, y0 and u_k acts in every epoch, as if it had u0.
        what: how messages call it.

    Raises:
        ModelError: something in it is unknown, misplaced or does not fit the chip.
    """
    return _Reader(rule, what).terms()


class _Reader:
    def __init__(self, rule: str, what: str) -> None:
        self.rule, self.what = rule, what
        self.tokens = [(m.lastindex or 0, m.group(m.lastindex or 0)) for m in _TOKEN.finditer(rule.rstrip())]
        self.at = 0

    def wrong(self, message: str, hint: str = "") -> ModelError:
        return ModelError(f"{self.what} = '{self.rule}': {message}", hint=hint, path=(self.what,))

    def peek(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def take(self) -> tuple[int, str]:
        if self.at == len(self.tokens):
            raise self.wrong("ends where a factor is expected")
        self.at += 1
        return self.tokens[self.at - 1]

    def terms(self) -> tuple[Term, ...]:
        found: list[Term] = []
        while self.at < len(self.tokens):
            sign = 1
            if self.peek() in ("+", "-"):
                sign = -1 if self.take()[1] == "-" else 1
            elif found:
                raise self.wrong(f"found '{self.peek()}' after a product: expected +, - or *", _mark_hint(self.peek()))
            found.append(self.product(sign))
        return tuple(found)

    def product(self, sign: int) -> Term:
        begin = self.at
        scale, exponent, gate, every = sign, 0, "", -1
        factors: list[Factor] = []
        while True:
            kind, token = self.take()
            if kind == _INTEGER:
                scale *= int(token)
            elif kind == _POWER:
                exponent += int(token.partition("^")[2].replace(" ", ""))
            elif kind == _NAME and re.fullmatch(r"u\d+", token):
                every = self.period(token, every)
            elif kind == _NAME and token in ("x0", "y0") and not gate:
                gate = token
            elif kind == _NAME:
                factors.append(Factor(self.name(token)))
            elif token == "(":
                factor, flip = self.sum_of_two()
                factors.append(factor)
                scale *= flip
            else:
                raise self.unexpected(kind, token)
            if self.peek() != "*":
                break
            self.take()
        if scale == 0:
            said = "".join(token for _, token in self.tokens[begin : self.at])
            raise self.wrong(f"'{said}' is always 0", "leave it out")
        while scale % 2 == 0:
            scale, exponent = scale // 2, exponent + 1
        try:
            return Term(scale, exponent, gate or "u", max(0, every), tuple(factors))
        except ModelError as error:
            raise self.wrong(error.message, error.hint) from None

    def period(self, token: str, before: int) -> int:
        every = int(token[1:])
        if before >= 0:
            raise self.wrong(f"'{token}' beside 'u{before}' in one product: expected one of them")
        if every > LARGEST_U:
            raise self.wrong(f"'{token}': expected u0 to u{LARGEST_U}")
        return every

    def name(self, token: str) -> str:
        if token in FACTORS:
            return token
        known = f"factors are {', '.join(FACTORS)}, u0 to u{LARGEST_U}"
        raise self.wrong(f"unknown factor '{token}'", _REFUSED.get(token) or near(token, FACTORS) or known)

    def sum_of_two(self) -> tuple[Factor, int]:
        """(name + constant), in any order, and the sign to take out so that the name has a +."""
        name, sign, constant = "", 1, 0
        while True:
            plus = -1 if self.peek() == "-" else 1
            if self.peek() in ("+", "-"):
                self.take()
            kind, token = self.take()
            if kind == _INTEGER:
                constant += plus * int(token)
            elif kind == _NAME and not name:
                name, sign = self.name(token), plus
            elif kind == _NAME:
                raise self.wrong(f"'{name}' and '{token}' in one bracket: expected one name and a whole number")
            else:
                raise self.unexpected(kind, token)
            if self.peek() not in ("+", "-"):
                break
        if self.peek() != ")":
            raise self.wrong("a bracket that is not closed", "expected (name + whole number)")
        self.take()
        if not name:
            raise self.wrong("a bracket without a name", "write the number without brackets")
        if abs(constant) > LARGEST_CONSTANT:
            raise self.wrong(f"constant {constant}: expected at most {LARGEST_CONSTANT} in size")
        return Factor(name, sign * constant), sign

    def unexpected(self, kind: int, token: str) -> ModelError:
        if kind == _DECIMAL:
            return self.wrong(f"scale {token} is no power of 2", "write whole numbers and powers, such as 3*2^-4")
        if token == "/":
            return self.wrong("found '/': the chip cannot divide", "multiply by 2^-n")
        return self.wrong(f"found '{token}': expected a factor", _mark_hint(token))


def _mark_hint(token: str) -> str:
    if token == "^":
        return "only 2 can be raised: 2^-3"
    if token == "/":
        return "the chip cannot divide: multiply by 2^-n"
    return "write 2^-3 without brackets" if token == "(" else ""
