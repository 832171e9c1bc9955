"""Count the files and code lines that run from a YAML file of two populations to its spikes.

    python benchmarks/way.py [--backend event] [--files] [--functions FILE]

A file counts with all its code lines if one of its functions is called after `import neuro`. A file with more than 400
code lines counts twice, so that joining files has no advantage. `--files` lists each file with the numbers of lines of
its functions that were called and of those that were not. `--functions` lists the functions of one file.
"""

import argparse
import ast
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType

import neuro

ROOT = Path(__file__).parents[1]
NETWORK = """\
neuro: 1
populations:
  noise: {model: {poisson_generator: {rate: 800.0}}, shape: 20}
  cells: {model: iaf_psc_exp, shape: 10}
projections:
  drive: {from: noise, to: cells, rule: all_to_all, weight: 100.0, delay: 1.0}
"""
OPTIMIZED = 1
"""Flag that code of functions has, but not the code of modules and classes."""


def numbered_code_lines(path: Path) -> set[int]:
    """Return the numbers of the lines of a file without blank lines, comments and docstrings."""
    text = path.read_text("utf-8")
    strings = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    lines = enumerate(map(str.strip, text.splitlines()), 1)
    return {k for k, line in lines if line and not line.startswith("#")} - strings


def called_functions(backend: str) -> tuple[dict[Path, set[int]], int]:
    """Run the network. Return the first lines of the project's called functions, by file, and the number of spikes."""
    codes: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_flags & OPTIMIZED:
            codes.add(frame.f_code)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "network.yaml"
        file.write_text(NETWORK)
        sys.setprofile(note)
        try:
            sim = neuro.compile(neuro.load(file), backend=backend, seed=1)
            sim.run(100.0)
            spikes = len(sim.spikes("cells")[0])
        finally:
            sys.setprofile(None)
    functions: dict[Path, set[int]] = defaultdict(set)
    for code in codes:
        path = Path(code.co_filename)
        if path.is_absolute() and path.is_relative_to(ROOT) and ".venv" not in path.parts:
            functions[path].add(code.co_firstlineno)
    return functions, spikes


def defined(path: Path) -> Iterator[tuple[str, int, int, int]]:
    """Yield the outer functions of a file: name, first line with decorators, line of `def`, last line."""

    def inside(node: ast.AST, name: str) -> Iterator[tuple[str, int, int, int]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef):
                first = min([child.lineno, *(each.lineno for each in child.decorator_list)])
                yield f"{name}{child.name}", first, child.lineno, child.end_lineno or child.lineno
            elif isinstance(child, ast.ClassDef):
                yield from inside(child, f"{name}{child.name}.")

    yield from inside(ast.parse(path.read_text("utf-8")), "")


def main() -> None:
    parser = argparse.ArgumentParser(description="Count what runs from a YAML file to spikes.")
    parser.add_argument("--backend", default="event")
    parser.add_argument("--files", action="store_true", help="list the files")
    parser.add_argument("--functions", type=Path, help="list the functions of one file")
    options = parser.parse_args()
    functions, spikes = called_functions(options.backend)
    lines = {path: numbered_code_lines(path) for path in functions}
    sizes = {path: len(numbers) for path, numbers in lines.items()}
    total, counted = sum(sizes.values()), sum(size * (1 + (size > 400)) for size in sizes.values())
    print(f"{len(sizes)} files, {total} code lines, counted {counted}; {spikes} spikes")
    for path in sorted(sizes, key=lambda path: -sizes[path]) if options.files else []:
        called = not_called = 0
        for _, first, _, last in defined(path):
            size = len(lines[path] & set(range(first, last + 1)))
            entered = any(first <= line <= last for line in functions[path])
            called, not_called = called + size * entered, not_called + size * (not entered)
        print(f"{sizes[path]:4}: {called:4} called, {not_called:4} not  {path.relative_to(ROOT)}")
    if options.functions:
        path = options.functions.resolve()
        for name, first, _, last in defined(path):
            entered = any(first <= line <= last for line in functions.get(path, ()))
            size = len(numbered_code_lines(path) & set(range(first, last + 1)))
            print(f"{size:4} {'called' if entered else '':6} {name}")


if __name__ == "__main__":
    main()
