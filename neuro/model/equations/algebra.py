"""Algebra on syntax trees: names, substitution, and the coefficients of linear and polynomial expressions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from neuro.core.grammar import Binary, Call, Name, Negative, Number, Tree

ZERO, ONE = Number(0.0, "", 0), Number(1.0, "", 0)


def operands(tree: Tree) -> tuple[Tree, ...]:
    """Return the operands of a tree."""
    match tree:
        case Negative(of):
            return (of,)
        case Binary(_, left, right):
            return left, right
        case Call(_, arguments):
            return arguments
    return ()


def subtrees(tree: Tree) -> Iterator[Tree]:
    """Yield a tree and all its subtrees."""
    yield tree
    for part in operands(tree):
        yield from subtrees(part)


def names(tree: Tree) -> Iterator[str]:
    """Return the names in a tree."""
    return (part.name for part in subtrees(tree) if isinstance(part, Name))


def substitute(tree: Tree, values: Mapping[str, Tree]) -> Tree:
    """Return a tree in which names are replaced by other trees."""
    match tree:
        case Name(name):
            return values.get(name, tree)
        case Negative(of):
            return Negative(substitute(of, values), tree.at)
        case Binary(sign, left, right):
            return Binary(sign, substitute(left, values), substitute(right, values), tree.at)
        case Call(name, arguments):
            return Call(name, tuple(substitute(argument, values) for argument in arguments), tree.at)
    return tree


def size(tree: Tree) -> int:
    """Return the number of numbers, names and operations in a tree."""
    return sum(1 for _ in subtrees(tree))


def add(a: Tree, b: Tree) -> Tree:
    """Return the sum. Terms that are 0 are left out."""
    if a == ZERO:
        return b
    return a if b == ZERO else Binary("+", a, b, 0)


def negate(a: Tree) -> Tree:
    """Return the negated tree."""
    if isinstance(a, Negative):
        return a.of
    return a if a == ZERO else Negative(a, 0)


def multiply(a: Tree, b: Tree) -> Tree:
    """Return the product. Factors that are 1 are left out, and a factor of 0 gives 0."""
    if ZERO in (a, b):
        return ZERO
    if a == ONE:
        return b
    return a if b == ONE else Binary("*", a, b, 0)


def divide(a: Tree, b: Tree) -> Tree:
    """Return the quotient."""
    return ZERO if a == ZERO else Binary("/", a, b, 0)


def affine(tree: Tree, variables: Collection[str]) -> dict[str, Tree] | None:
    """Return the coefficient of each variable in a linear tree, and the constant under "".

    For example, `a*x + b` with the variables x and y gives {"": b, "x": a}. The result is None if the tree is not
    linear.
    """
    coefficients = polynomial(tree, variables, 1)
    return (
        None
        if coefficients is None
        else {"": ZERO, **{"".join(product): coefficient for product, coefficient in coefficients.items()}}
    )


def polynomial(tree: Tree, variables: Collection[str], degree: int) -> dict[tuple[str, ...], Tree] | None:
    """Return the coefficient of each product of variables in a polynomial, and the constant under ().

    Args:
        tree: the tree.
        variables: names of the variables.
        degree: largest number of variables in a product.

    Returns:
        The coefficients by product, e.g. {("x", "y"): a} for `a*x*y`, or None if the tree is not such a polynomial.
    """
    if not any(name in variables for name in names(tree)):
        return {(): tree}
    match tree:
        case Name(name):
            return {(name,): ONE}
        case Negative(of):
            inner = polynomial(of, variables, degree)
            return None if inner is None else {product: negate(factor) for product, factor in inner.items()}
        case Binary("+" | "-" as sign, left, right):
            a, b = polynomial(left, variables, degree), polynomial(right, variables, degree)
            if a is None or b is None:
                return None
            signed = b if sign == "+" else {product: negate(factor) for product, factor in b.items()}
            return {product: add(a.get(product, ZERO), signed.get(product, ZERO)) for product in {**a, **b}}
        case Binary("*", left, right):
            return _product(polynomial(left, variables, degree), polynomial(right, variables, degree), degree)
        case Binary("/", left, right):
            a = polynomial(left, variables, degree)
            if a is None or any(name in variables for name in names(right)):
                return None
            return {product: divide(factor, right) for product, factor in a.items()}
        case Binary("^", left, Number(power, "")) if 1 <= power <= degree and power == int(power):
            base = polynomial(left, variables, degree)
            power_of_base = base
            for _ in range(int(power) - 1):
                power_of_base = _product(power_of_base, base, degree)
            return power_of_base
    return None


def _product(
    a: Mapping[tuple[str, ...], Tree] | None, b: Mapping[tuple[str, ...], Tree] | None, degree: int
) -> dict[tuple[str, ...], Tree] | None:
    if a is None or b is None:
        return None
    coefficients: dict[tuple[str, ...], Tree] = {}
    for left_product, factor in a.items():
        for right_product, right_factor in b.items():
            product = tuple(sorted((*left_product, *right_product)))
            if (product_factor := multiply(factor, right_factor)) != ZERO:
                coefficients[product] = add(coefficients.get(product, ZERO), product_factor)
    return coefficients if max(map(len, coefficients), default=0) <= degree else None


def innermost_misfit(tree: Tree, fits: Callable[[Tree], bool]) -> Tree:
    """Return an innermost subtree for which `fits` is false. `fits` is true for all operands of this subtree."""
    return next((innermost_misfit(operand, fits) for operand in operands(tree) if not fits(operand)), tree)
