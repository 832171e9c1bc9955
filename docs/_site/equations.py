"""Equations in plain text, such as `tau_m V_m' = -(V_m - E_L) + R I; spike at V_m >= V_th`, as MathML.

    equation = clause {";" clause}                      each in a line of its own
    clause   = {word | operator | product | remark}     a remark is a clause in parentheses that begins with a word
    product  = factors [" / " factors]                  a fraction of all factors before and after
    factors  = factor {factor}
    factor   = power {"/" power}                        a fraction of two operands
    power    = operand {"'" | "^" operand | "[" clause "]"}
    operand  = name | number | "(" clause ")" | "|" clause "|" | function "(" clause ")"

Words of two letters or more are English, except Greek letters, words with an underscore and `NAMES`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from html.entities import html5

_NAMES = (
    "act amplitude bias dd decay du dv dt dw exp frequency imag leak mean move offset origin phase rate real residue "
    "start std stop sum total values vth"
)
NAMES = frozenset(_NAMES.split())
"""Words that are not English: parameters, states and differences."""
_LETTERS = "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau phi chi psi omega"
GREEK = {name: html5[f"{name};"] for word in _LETTERS.split() for name in (word, word.title())} | {"eps": "ε"}
LABELS = GREEK | {"plus": "+", "minus": "−"}
"""Parts of subscripts that are shown otherwise than they are written."""
INDICES = frozenset("ijkx")
"""Subscripts that stand for a number or a name; others are labels, which are upright."""
SIGNS = {
    **{"-": "−", "+-": "±", "*": "∗", "-=": "−=", "*=": "×="},
    **{"<=": "≤", ">=": "≥", "!=": "≠", "~": "∼", "->": "→"},
}
"""Operators that are shown otherwise than they are written."""

_TOKEN = re.compile(
    r"""\s* (?:
      (?P<word>     a(?=\ (?:mistake|post|pre|side|signal|spike|step)\b)
                  | decay(?=\ with) | (?<=the\ )move | sum(?=\ of) )
    | (?P<trace>    [A-Za-z][+-]\d?(?=[\s;,)]|$) )
    | (?P<function> [A-Za-z]\w*(?=\() )
    | (?P<name>     [A-Za-z]\w* )
    | (?P<number>   \d+(?:\.\d+)? )
    | (?P<operator> [-+*!<>]= | -> | [*<>=~] | [-+](?=\s) )
    | (?P<prefix>   \+- | [-+] )
    | (?P<over>     (?<=\s)/(?=\s) )
    | (?P<sign>     [,:;/^'()|\[\]] )
    | (?P<end>      $ ) )""",
    re.VERBOSE,
)
_SHORT = re.compile(r"([A-Za-z])(\d+|max|min|plus|minus)")
_THIN = '<mspace width="0.22em"></mspace>'
_SPACE = "\N{NO-BREAK SPACE}"
_OPEN, _CLOSE = '<mrow><mo form="prefix">(</mo>', '<mo form="postfix">)</mo></mrow>'


def typeset(text: str) -> str:
    """HTML with MathML of an equation, whose lines may break between words and before operators.

    Raises:
        ValueError: it can't be read.
    """
    reader = _Reader(text)
    clauses = [reader.clause()]
    while reader.kind == ";":
        reader.take(";")
        clauses.append(reader.clause())
    reader.take("end")
    return "".join(f'<span class="equation">{_line(clause)}</span>' for clause in clauses)


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    """Each with its kind; a sign is a kind of its own."""
    at, kind = 0, ""
    while kind != "end":
        token = _TOKEN.match(text, at)
        if token is None:
            raise ValueError(f"'{text[at:]}' can't be read")
        at, kind = token.end(), token.lastgroup
        written = token[kind]
        english = len(written) > 1 and "_" not in written and written not in NAMES | GREEK.keys()
        if kind == "name" and english and not _SHORT.fullmatch(written):
            kind = "word"
        yield (written if kind == "sign" else kind), written


class _Reader:
    """Reads tokens from left to right: a method for each part of the grammar."""

    def __init__(self, text: str) -> None:
        self.tokens = list(_tokens(text))
        self.in_bars = False

    @property
    def kind(self) -> str:
        return self.tokens[0][0]

    def take(self, kind: str) -> str:
        found, written = self.tokens.pop(0)
        if found != kind:
            raise ValueError(f"'{written}' stands where '{kind}' is expected")
        return written

    def clause(self) -> list[tuple[str, str]]:
        """Words, commas, operators and terms, each with its kind."""
        parts: list[tuple[str, str]] = []
        while True:
            after = parts[-1][0] if parts else ""
            if self.kind == "word":
                parts.append(("word", " ".join(self.words())))
            elif self.kind in (",", ":"):
                parts.append(("comma", self.take(self.kind)))
            elif self.kind in ("operator", "prefix"):
                kind = "operator" if after == "term" else self.kind
                parts.append((kind, _operator(self.take(self.kind), "infix" if kind == "operator" else "prefix")))
            elif self.begins_operand():
                parts.append(("term", self.product()))
            elif self.kind == "(":
                parts += self.remark()
            elif after in ("operator", "prefix"):
                raise ValueError("a clause ends with an operator")
            else:
                return parts

    def words(self) -> Iterator[str]:
        while self.kind == "word":
            yield self.take("word")

    def begins_operand(self) -> bool:
        if self.kind == "(":
            return self.tokens[1][0] != "word"
        return self.kind in ("name", "number", "trace", "function") or (self.kind == "|" and not self.in_bars)

    def remark(self) -> list[tuple[str, str]]:
        (_, first), *others = self.enclosed("(", ")")
        *before, (kind, last) = [("word", f"({first}"), *others]
        return [*before, (kind, f"{last})" if kind == "word" else f'{last}<mo form="postfix">)</mo>')]

    def enclosed(self, opening: str, closing: str) -> list[tuple[str, str]]:
        outside, self.in_bars = self.in_bars, closing == "|"
        self.take(opening)
        parts = self.clause()
        self.take(closing)
        self.in_bars = outside
        return parts

    def product(self) -> str:
        above = self.factors()
        if self.kind != "over":
            return _THIN.join(above)
        self.take("over")
        return _fraction(above, self.factors())

    def factors(self) -> list[str]:
        factors = [self.factor()]
        while self.begins_operand():
            factors.append(self.factor())
        return factors

    def factor(self) -> str:
        factor = self.power()
        while self.kind == "/":
            self.take("/")
            factor = _fraction([factor], [self.power()])
        return factor

    def power(self) -> str:
        base, below, above = self.operand()
        while self.kind in ("'", "^", "["):
            if self.kind == "[":
                below += _row(self.enclosed("[", "]"))
            elif self.kind == "^":
                self.take("^")
                above += _bare([_scripts(*self.operand())])
            else:
                self.take("'")
                above += "<mo>′</mo>"
        return _scripts(base, below, above)

    def operand(self) -> tuple[str, str, str]:
        """With its subscript and superscript, "" for none."""
        if self.kind == "name":
            return *_name(self.take("name")), ""
        if self.kind == "number":
            return f"<mn>{self.take('number')}</mn>", "", ""
        if self.kind == "trace":
            side, sign, *order = self.take("trace")
            return f"<mi>{side}</mi>", "".join(f"<mn>{digit}</mn>" for digit in order), _operator(sign, "prefix")
        if self.kind == "function":
            return self.call(), "", ""
        if self.kind == "|":
            return _fence("|", self.enclosed("|", "|"), "|"), "", ""
        return _fence("(", self.enclosed("(", ")"), ")"), "", ""

    def call(self) -> str:
        function = self.take("function")
        inside = self.enclosed("(", ")")
        if function == "sqrt":
            return f"<msqrt>{_row(inside)}</msqrt>"
        if function == "floor":
            return _fence("⌊", inside, "⌋")
        name = _scripts(*_name(function), "") if "_" in function or function in GREEK else f"<mi>{function}</mi>"
        return f"<mrow>{name}{_fence('(', inside, ')')}</mrow>"


def _name(text: str) -> tuple[str, str]:
    """What stands on the line, and what below it."""
    head, *labels = text.split("_")
    if short := _SHORT.fullmatch(head):
        head, labels = short[1], [short[2], *labels]
    if head == "sum":
        shown = "<mo>∑</mo>"
    elif len(head) > 1 and head not in GREEK:
        return f'<mi class="long">{text}</mi>', ""
    else:
        shown = f"<mi>{GREEK.get(head, head)}</mi>"
    if {*labels} <= INDICES:
        return shown, "".join(f"<mi>{label}</mi>" for label in labels)
    return shown, f"<mtext>{re.sub(r',(?=[0-9])', '', ','.join(LABELS.get(label, label) for label in labels))}</mtext>"


def _scripts(base: str, below: str, above: str) -> str:
    if not below and not above:
        return base
    element = "msubsup" if below and above else "msub" if below else "msup"
    scripts = "".join(f"<mrow>{script}</mrow>" for script in (below, above) if script)
    return f"<{element}>{base}{scripts}</{element}>"


def _fraction(above: list[str], below: list[str]) -> str:
    return f"<mfrac><mrow>{_bare(above)}</mrow><mrow>{_bare(below)}</mrow></mfrac>"


def _bare(factors: list[str]) -> str:
    """Factors side by side, a single one without its parentheses."""
    return _THIN.join(factors) if len(factors) > 1 else factors[0].removeprefix(_OPEN).removesuffix(_CLOSE)


def _fence(opening: str, inside: list[tuple[str, str]], closing: str) -> str:
    return f'<mrow><mo form="prefix">{opening}</mo>{_row(inside)}<mo form="postfix">{closing}</mo></mrow>'


def _operator(sign: str, form: str) -> str:
    return f'<mo form="{form}">{escape(SIGNS.get(sign, sign))}</mo>'


def _row(parts: list[tuple[str, str]]) -> str:
    """A clause within a formula, which does not break."""
    row = ""
    for k, (kind, text) in enumerate(parts):
        if kind == "word":
            left, right = (_SPACE * inside for inside in (k > 0, k < len(parts) - 1))
            row += f"<mtext>{left}{text.replace(' ', _SPACE)}{right}</mtext>"
        else:
            row += f"<mo>{text}</mo>" if kind == "comma" else text
    return row


def _line(parts: list[tuple[str, str]]) -> str:
    """A clause as text and formulas; a line of it breaks between words and before operators."""
    line = formula = ""
    for kind, text in [*parts, ("word", "")]:
        if kind == "comma":
            formula += f"<mo>{text}</mo>" if formula else ""
            line = line if formula else f"{line.rstrip(' ')}{text} "
        if formula and kind in ("word", "operator", "comma"):
            line += f'<math displaystyle="true">{formula}</math>' + ("<wbr>" if kind == "operator" else " ")
            formula = ""
        if kind == "word":
            line += f" {text} "
        elif kind != "comma":
            formula += text
    return re.sub(" +", " ", line).strip(" ")
