"""Functions of expressions, as plain Python that can also be compiled.

No function raises an error: an undefined result is NaN, as in compiled code. The names differ from those in `math`,
because a compiler would replace the function by the one in `math`.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
import math

LARGEST_EXPONENT = 709.0
ARGUMENTS = {
    "exp": 1,
    "expm1": 1,
    "exprel": 1,
    "log": 1,
    "sqrt": 1,
    "tanh": 1,
    "sin": 1,
    "cos": 1,
    "abs": 1,
    "min": 2,
    "max": 2,
    "where": 3,
}
"""Functions of the language, and their numbers of arguments."""
PUBLIC = (
    "of_exp",
    "of_expm1",
    "of_exprel",
    "of_log",
    "of_sqrt",
    "of_tanh",
    "of_sin",
    "of_cos",
    "where",
    "power",
    "divided",
    "square",
    "cube",
    "fourth",
    "resized",
)
"""Names that generated modules import."""


def of_exp(x):
    """Return e^x, or infinity if the result is beyond the range of a double."""
    return math.exp(x) if x < LARGEST_EXPONENT else (math.inf if x >= LARGEST_EXPONENT else math.nan)


def of_expm1(x):
    """Return e^x - 1, accurate for small x."""
    return math.expm1(x) if x < LARGEST_EXPONENT else (math.inf if x >= LARGEST_EXPONENT else math.nan)


def of_exprel(x):
    """Return (e^x - 1)/x. The result at 0 is the limit 1."""
    return 1.0 + 0.5 * x if abs(x) < 1e-8 else of_expm1(x) / x


def of_log(x):
    """Return the natural logarithm, -infinity at 0 and NaN below."""
    return math.log(x) if x > 0.0 else (-math.inf if x == 0.0 else math.nan)


def of_sqrt(x):
    """Return the square root, NaN below 0."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def power(x, y):
    """Return x^y, NaN if it is not a real number."""
    if x > 0.0:
        exponent = y * math.log(x)
        return x**y if exponent < LARGEST_EXPONENT else math.inf
    if x == 0.0:
        return 0.0 if y > 0.0 else (1.0 if y == 0.0 else math.inf)
    if y == math.floor(y):
        size = power_of_positive(-x, y)
        return size if y == 2.0 * math.floor(0.5 * y) else -size
    return math.nan


def power_of_positive(x, y):
    """Return x^y for x > 0."""
    return x**y if y * math.log(x) < LARGEST_EXPONENT else math.inf


def divided(a, b):
    """Return a/b, infinite or NaN for b = 0."""
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a)


def where(condition, a, b):
    """Return `a` if the condition holds, else `b`."""
    return a if condition else b


def of_tanh(x):
    """Return the hyperbolic tangent."""
    return math.tanh(x)


def of_sin(x):
    """Return the sine, NaN for infinite x."""
    return math.sin(x) if abs(x) < math.inf else math.nan


def of_cos(x):
    """Return the cosine, NaN for infinite x."""
    return math.cos(x) if abs(x) < math.inf else math.nan


def square(x):
    """Return x^2."""
    return x * x


def cube(x):
    """Return x^3."""
    return x * x * x


def fourth(x):
    """Return x^4."""
    return x * x * x * x


def resized(size, error):
    """Return the next size of a step by GSL's standard step control. `error` is in units of the tolerance."""
    if error > 1.1:
        return size * max(0.2, 0.9 / error**0.2)
    if error < 0.5:
        return size * (5.0 if error < 1e-5 else min(5.0, max(1.0, 0.9 / error ** (1.0 / 6.0))))
    return size
