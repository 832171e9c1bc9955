"""What can be told from a tree: its names, whether it is linear in some of them and by which factors."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from neuro.model.equations.grammar import Binary, Call, Name, Negative, Number, Tree

ZERO, ONE = Number(0.0, "", 0), Number(1.0, "", 0)


def names(tree: Tree) -> Iterator[str]:
    """The names in a tree."""
    match tree:
        case Name(name):
            yield name
        case Negative(of):
            yield from names(of)
        case Binary(_, left, right):
            yield from names(left)
            yield from names(right)
        case Call(_, arguments):
            for argument in arguments:
                yield from names(argument)


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
    match tree:
        case Negative(of):
            return 1 + size(of)
        case Binary(_, left, right):
            return 1 + size(left) + size(right)
        case Call(_, arguments):
            return 1 + sum(map(size, arguments))
    return 1


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
    if not any(name in variables for name in names(tree)):
        return {"": tree}
    match tree:
        case Name(name):
            return {"": ZERO, name: ONE}
        case Negative(of):
            inner = affine(of, variables)
            return None if inner is None else {name: negative(factor) for name, factor in inner.items()}
        case Binary("+" | "-" as sign, left, right):
            a, b = affine(left, variables), affine(right, variables)
            if a is None or b is None:
                return None
            signed = b if sign == "+" else {name: negative(factor) for name, factor in b.items()}
            return {name: added(a.get(name, ZERO), signed.get(name, ZERO)) for name in {**a, **b}}
        case Binary("*", left, right):
            a, b = affine(left, variables), affine(right, variables)
            if a is None or b is None or (len(a) > 1 and len(b) > 1):
                return None
            many, one = (a, b[""]) if len(b) == 1 else (b, a[""])
            return {name: multiplied(factor, one) for name, factor in many.items()}
        case Binary("/", left, right):
            a = affine(left, variables)
            if a is None or any(name in variables for name in names(right)):
                return None
            return {name: divided(factor, right) for name, factor in a.items()}
    return None
