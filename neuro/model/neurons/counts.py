"""Numbers of events drawn from one uniform number by inverting their distribution; plain code that also compiles."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
import math


def poisson(u, mean, nothing):
    """The Poisson number of a uniform number; `nothing` is exp(-mean), and `mean` not above 500."""
    number, term, total = 0, nothing, nothing
    while u >= total:
        number += 1
        term = term * (mean / number)
        if total + term == total and number > mean:
            break
        total += term
    return number


def binomial(u, trials, chance):
    """How many of some trials succeed, and a uniform number independent of it: where `u` lay in its interval."""
    if trials == 0 or chance == 0.0:
        return 0, u
    if chance >= 1.0:
        return trials, u
    below, odds = 0.0, chance / (1.0 - chance)
    number, term = 0, math.exp(trials * math.log1p(-chance))
    while u >= below + term and number < trials:
        below += term
        term = term * (odds * (trials - number) / (number + 1))
        number += 1
    return number, min(max((u - below) / term, 0.0), 1.0 - 2.0**-53) if term > 0.0 else 0.5
