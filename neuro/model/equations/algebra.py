"""Properties of a tree: its names, whether it is linear in some of them and by which factors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from neuro.core.grammar import Binary, Call, Name, Negative, Number, Tree

ZERO, ONE = Number(0.0, "", 0), Number(1.0, "", 0)


def parts(tree: Tree) -> tuple[Tree, ...]:
    """What a tree is made of."""
    match tree:
        case Negative(of):
            return (of,)
        case Binary(_, left, right):
            return left, right
        case Call(_, arguments):
            return arguments
    return ()


def within(tree: Tree) -> Iterator[Tree]:
    """A tree, its parts, and theirs."""
    yield tree
    for part in parts(tree):
        yield from within(part)


def names(tree: Tree) -> Iterator[str]:
    """The names in a tree."""
    return (part.name for part in within(tree) if isinstance(part, Name))


def replaced(tree: Tree, values: Mapping[str, Tree]) -> Tree:
    """A tree with others in place of names."""
    match tree:
        case Name(name):
            return values.get(name, tree)
        case Negative(of):
            return Negative(replaced(of, values), tree.at)
        case Binary(sign, left, right):
            return Binary(sign, replaced(left, values), replaced(right, values), tree.at)
        case Call(name, arguments):
            return Call(name, tuple(replaced(argument, values) for argument in arguments), tree.at)
    return tree


def size(tree: Tree) -> int:
    """How many numbers, names and operations a tree has."""
    return sum(1 for _ in within(tree))


def added(a: Tree, b: Tree) -> Tree:
    """The sum, written without what is 0."""
    if a == ZERO:
        return b
    return a if b == ZERO else Binary("+", a, b, 0)


def negative(a: Tree) -> Tree:
    """The negative."""
    if isinstance(a, Negative):
        return a.of
    return a if a == ZERO else Negative(a, 0)


def multiplied(a: Tree, b: Tree) -> Tree:
    """The product, written without what is 1."""
    if ZERO in (a, b):
        return ZERO
    if a == ONE:
        return b
    return a if b == ONE else Binary("*", a, b, 0)


def divided(a: Tree, b: Tree) -> Tree:
    """The quotient."""
    return ZERO if a == ZERO else Binary("/", a, b, 0)


def affine(tree: Tree, variables: Collection[str]) -> dict[str, Tree] | None:
    """The factors of some names in a tree that is linear in them, and under "" the rest; None if it is not linear."""
    found = polynomial(tree, variables, 1)
    return None if found is None else {"": ZERO, **{"".join(product): factor for product, factor in found.items()}}


def polynomial(tree: Tree, variables: Collection[str], degree: int) -> dict[tuple[str, ...], Tree] | None:
    """The factors of the products of some names of which a tree is the sum, and under () the rest.

    Args:
        tree: the tree.
        variables: the names.
        degree: how many of them a product may have.

    Returns:
        the factor of each product; None if the tree is no such sum.
    """
    if not any(name in variables for name in names(tree)):
        return {(): tree}
    match tree:
        case Name(name):
            return {(name,): ONE}
        case Negative(of):
            inner = polynomial(of, variables, degree)
            return None if inner is None else {product: negative(factor) for product, factor in inner.items()}
        case Binary("+" | "-" as sign, left, right):
            a, b = polynomial(left, variables, degree), polynomial(right, variables, degree)
            if a is None or b is None:
                return None
            signed = b if sign == "+" else {product: negative(factor) for product, factor in b.items()}
            return {product: added(a.get(product, ZERO), signed.get(product, ZERO)) for product in {**a, **b}}
        case Binary("*", left, right):
            return _product(polynomial(left, variables, degree), polynomial(right, variables, degree), degree)
        case Binary("/", left, right):
            a = polynomial(left, variables, degree)
            if a is None or any(name in variables for name in names(right)):
                return None
            return {product: divided(factor, right) for product, factor in a.items()}
        case Binary("^", left, Number(power, "")) if 1 <= power <= degree and power == int(power):
            once = polynomial(left, variables, degree)
            found = once
            for _ in range(int(power) - 1):
                found = _product(found, once, degree)
            return found
    return None


def _product(
    a: Mapping[tuple[str, ...], Tree] | None, b: Mapping[tuple[str, ...], Tree] | None, degree: int
) -> dict[tuple[str, ...], Tree] | None:
    if a is None or b is None:
        return None
    found: dict[tuple[str, ...], Tree] = {}
    for mine, factor in a.items():
        for other, by in b.items():
            product = tuple(sorted((*mine, *other)))
            if (whole := multiplied(factor, by)) != ZERO:
                found[product] = added(found.get(product, ZERO), whole)
    return found if max(map(len, found), default=0) <= degree else None


def culprit(tree: Tree, fits: Callable[[Tree], bool]) -> Tree:
    """The innermost part of a tree that does not fit, each of whose own parts does."""
    return next((culprit(part, fits) for part in parts(tree) if not fits(part)), tree)
