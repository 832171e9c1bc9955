"""Rewrite plain functions that loop over neurons so that they run for all neurons at once on tensors.

A model's `step` is a loop over neurons with branches. Here each neuron is a lane: `for i in range(lo, hi)` runs once
for all lanes. Where lanes branch differently, both branches run, and each lane keeps the results of its own branch (see
`neuro_torch.lanes`). So third-party models and models made of equations need only the functions that the
reference backend calls.

Comprehensions, `try`, `with` and nested functions cannot be rewritten; the error names the line.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from functools import cache
from types import FunctionType
from typing import Any

LANES = "_lanes"
"""Name of the `Lanes` argument in a rewritten function."""

_COMPARED = {ast.GtE: "at_least", ast.Gt: "above", ast.LtE: "at_most", ast.Lt: "below"}


class Untranslatable(Exception):
    """A function has a statement that cannot run for all neurons at once; the message quotes it with its line."""


@cache
def translated(function: FunctionType) -> Any:
    """Return the rewritten function, whose first argument is a `Lanes`.

    Raises:
        Untranslatable: the function cannot be rewritten.
    """
    try:
        text = textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError):
        raise Untranslatable(f"no source found for '{function.__qualname__}'") from None
    tree = ast.parse(text).body[0]
    if not isinstance(tree, ast.FunctionDef):
        raise Untranslatable(f"'{function.__qualname__}' is no plain function")
    rewritten = _Rewriter(function).function(tree)
    module = ast.fix_missing_locations(ast.Module([rewritten], []))
    nonlocals = inspect.getclosurevars(function).nonlocals
    scope = {**function.__globals__, **nonlocals}
    exec(compile(module, f"<lanes of {function.__module__}.{function.__qualname__}>", "exec"), scope)
    result = scope[tree.name]
    result.__defaults__ = function.__defaults__
    return result


def _name(word: str) -> ast.Name:
    return ast.Name(word, ast.Load())


def _call(method: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Attribute(_name(LANES), method, ast.Load()), list(arguments), [])


def _later(value: ast.expr) -> ast.expr:
    """Return a lambda that evaluates an expression on demand."""
    empty = ast.arguments([], [], None, [], [], None, [])
    return ast.Lambda(empty, value)


def _assign(word: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(word, ast.Store())], value)


class _Rewriter:
    """Rewrites the syntax tree of one function."""

    def __init__(self, function: FunctionType) -> None:
        self._function, self._n_names, self._loops = function, 0, list[str]()

    def function(self, tree: ast.FunctionDef) -> ast.FunctionDef:
        if tree.args.vararg or tree.args.kwarg or tree.args.kwonlyargs:
            raise self._stopped(tree, "arguments with * or after it")
        parameters = [ast.arg(LANES), *(ast.arg(argument.arg) for argument in tree.args.args)]
        arguments = ast.arguments([], parameters, None, [], [], None, tree.args.defaults)
        argument_names = {argument.arg for argument in tree.args.args}
        stored = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        body: list[ast.stmt] = [_assign(word, ast.Constant(None)) for word in sorted(stored - argument_names)]
        body.append(_assign("_frame", _call("enter")))
        body += self._block(tree.body)
        body.append(ast.Return(_call("leave", _name("_frame"))))
        tree.args, tree.body, tree.decorator_list, tree.returns = arguments, body, [], None
        return tree

    def _stopped(self, node: ast.AST, construct: str) -> Untranslatable:
        line = self._function.__code__.co_firstlineno + getattr(node, "lineno", 1) - 1
        return Untranslatable(f"{self._function.__module__}.{self._function.__qualname__}, line {line}: {construct}")

    def _new(self, word: str) -> str:
        self._n_names += 1
        return f"_{word}{self._n_names}"

    def _block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        return [translated for statement in statements for translated in self._statement(statement)] or [ast.Pass()]

    def _statement(self, node: ast.stmt) -> list[ast.stmt]:
        method = getattr(self, f"_on_{type(node).__name__.lower()}", None)
        if method is None:
            raise self._stopped(node, f"'{ast.unparse(node).splitlines()[0]}'")
        statements: list[ast.stmt] = method(node)
        return statements

    def _on_pass(self, node: ast.Pass) -> list[ast.stmt]:
        return []

    def _on_expr(self, node: ast.Expr) -> list[ast.stmt]:
        return [] if isinstance(node.value, ast.Constant) else [ast.Expr(self._value(node.value))]

    def _on_annassign(self, node: ast.AnnAssign) -> list[ast.stmt]:
        return [] if node.value is None else self._store(node.target, self._value(node.value))

    def _on_augassign(self, node: ast.AugAssign) -> list[ast.stmt]:
        current = ast.parse(ast.unparse(node.target), mode="eval").body
        return self._store(node.target, self._value(ast.BinOp(current, node.op, node.value)))

    def _on_assign(self, node: ast.Assign) -> list[ast.stmt]:
        value = self._value(node.value)
        if len(node.targets) == 1 and not isinstance(node.targets[0], ast.Tuple):
            return self._store(node.targets[0], value)
        variable = self._new("value")
        return [
            _assign(variable, value),
            *(stored for target in node.targets for stored in self._store(target, _name(variable))),
        ]

    def _store(self, target: ast.expr, value: ast.expr) -> list[ast.stmt]:
        if isinstance(target, ast.Name):
            return [_assign(target.id, _call("put", _name(target.id), value))]
        if isinstance(target, ast.Subscript):
            return [ast.Expr(_call("store", self._value(target.value), self._value(target.slice), value))]
        if isinstance(target, ast.Tuple):
            variable, statements = self._new("parts"), list[ast.stmt]()
            for place, element in enumerate(target.elts):
                statements += self._store(element, ast.Subscript(_name(variable), ast.Constant(place), ast.Load()))
            return [_assign(variable, value), *statements]
        raise self._stopped(target, f"'{ast.unparse(target)} = ...'")

    def _on_if(self, node: ast.If) -> list[ast.stmt]:
        branch = self._new("branch")
        statements: list[ast.stmt] = [_assign(branch, _call("fork", self._value(node.test)))]
        statements.append(ast.If(_call("first", _name(branch)), self._block(node.body), []))
        statements.append(ast.If(_call("second", _name(branch)), self._block(node.orelse), []))
        return [*statements, ast.Expr(_call("join", _name(branch)))]

    def _on_while(self, node: ast.While) -> list[ast.stmt]:
        if node.orelse:
            raise self._stopped(node, "'else' of a loop")
        loop = self._new("loop")
        test = _call("goes_on", _name(loop), self._value(node.test))
        return self._wrap_loop(loop, ast.While(test, self._inside(loop, node.body), []))

    def _on_for(self, node: ast.For) -> list[ast.stmt]:
        if node.orelse or not isinstance(node.target, ast.Name):
            raise self._stopped(node, f"'{ast.unparse(node).splitlines()[0]}'")
        loop, iterable = self._new("loop"), node.iter
        if isinstance(iterable, ast.Call) and isinstance(iterable.func, ast.Name) and iterable.func.id == "range":
            numbers = _call("numbers", _name(loop), *map(self._value, iterable.args))
        else:
            numbers = _call("each", _name(loop), self._value(iterable))
        target = ast.Name(node.target.id, ast.Store())
        return self._wrap_loop(loop, ast.For(target, numbers, self._inside(loop, node.body), []))

    def _wrap_loop(self, loop: str, statement: ast.stmt) -> list[ast.stmt]:
        return [_assign(loop, _call("loop", _name("_frame"))), statement, ast.Expr(_call("end_loop", _name(loop)))]

    def _inside(self, loop: str, body: list[ast.stmt]) -> list[ast.stmt]:
        self._loops.append(loop)
        statements = self._block(body)
        self._loops.pop()
        return statements

    def _on_break(self, node: ast.Break) -> list[ast.stmt]:
        return [ast.If(_call("breaks", _name(self._loops[-1])), [ast.Break()], [])]

    def _on_continue(self, node: ast.Continue) -> list[ast.stmt]:
        return [ast.If(_call("skips"), [ast.Continue()], [])]

    def _on_return(self, node: ast.Return) -> list[ast.stmt]:
        value = ast.Constant(None) if node.value is None else self._value(node.value)
        leave: list[ast.stmt] = [ast.Return(_call("leave", _name("_frame")))]
        return [ast.If(_call("returns", _name("_frame"), value), leave, [])]

    def _value(self, node: ast.expr) -> ast.expr:
        """Rewrite an expression."""
        match node:
            case ast.Name() | ast.Constant() | ast.Attribute():
                return node
            case ast.Starred(value=value):
                return ast.Starred(self._value(value), ast.Load())
            case ast.Tuple(elts=elements):
                return ast.Tuple([self._value(element) for element in elements], ast.Load())
            case ast.Subscript(value=of, slice=at):
                return ast.Subscript(self._value(of), self._value(at), ast.Load())
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return _call("choose", self._value(test), _later(self._value(body)), _later(self._value(orelse)))
            case ast.BoolOp(op=op, values=values):
                method = "both" if isinstance(op, ast.And) else "either"
                first, *operands = map(self._value, values)
                for element in operands:
                    first = _call(method, first, _later(element))
                return first
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return _call("no", self._value(operand))
            case ast.UnaryOp(op=op, operand=operand):
                return ast.UnaryOp(op, self._value(operand))
            case ast.BinOp(left=left, op=ast.Sub(), right=right):
                return _call("minus", self._value(left), self._value(right))
            case ast.BinOp(left=left, op=op, right=right):
                return ast.BinOp(self._value(left), op, self._value(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                sides = self._value(left), self._value(right)
                if type(op) in _COMPARED:
                    return _call(_COMPARED[type(op)], *sides)
                return ast.Compare(sides[0], [op], [sides[1]])
            case ast.Call(func=ast.Name() | ast.Attribute() as function, args=arguments, keywords=[]):
                return _call("call", function, *map(self._value, arguments))
        raise self._stopped(node, f"'{ast.unparse(node)}'")
