"""The one cache of compiled kernels: what it sees, where it lies, what it says."""

import os
import re
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from neuro.kernels.compile_report import REPORTED

SAYS = "neuro: compiling kernels for this machine, once\nneuro: compiled 1 kernel in T s\n"
REPOSITORY = Path(__file__).parents[2]
NEAR = """
from neuro.kernels.jit import kernel
from far.called import add

@kernel
def total(values):
    return add(values[0], values[1])
"""
FAR = """
from neuro.kernels.jit import subkernel
from far.numbers import EXTRA

@subkernel
def add(a, b):
    return a + b + EXTRA
"""
RUN = "import numpy as np; from near.kernels import total; print(total(np.array([1, 2])))"


@pytest.fixture
def files(tmp_path):
    """Write modules into a folder that Python finds."""

    def write(**sources):
        for name, source in sources.items():
            path = tmp_path / (re.sub("(?<=[a-z])__(?=[a-z])", "/", name) + ".py")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(source)
            # Python takes a module's bytecode for that of a file of the same length and second.
            os.utime(path, (second := next(seconds), second))

    seconds = count(1_000_000_000)
    return write


@pytest.fixture
def python(tmp_path):
    """Run code in a process of its own, with a cache of this test; returns what it prints and what it says."""

    def run(code):
        done = subprocess.run([sys.executable, "-c", code], **settings(tmp_path))
        assert done.returncode == 0, done.stderr
        return done.stdout.strip(), re.sub(r"\d+\.\d s", "T s", done.stderr)

    return run


def settings(folder):
    path = os.pathsep.join([str(folder), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": str(folder / "cache")}
    environment.pop(REPORTED, None)
    return {"env": environment, "cwd": folder, "capture_output": True, "text": True}


@pytest.fixture
def package(files):
    files(near__kernels=NEAR, far__called=FAR, far__numbers="EXTRA = 0\n")


def test_an_edit_of_what_a_kernel_calls_is_seen_and_a_remark_compiles_nothing(package, files, python):
    assert python(RUN) == ("3", SAYS)
    files(far__called='"""A docstring."""\n' + FAR.replace("return", "# a comment\n    return"))
    assert python(RUN) == ("3", "")
    files(far__called=FAR.replace("a + b", "a * b"))
    assert python(RUN) == ("2", SAYS)


DEEP = """
import {imported}
from neuro.kernels.jit import kernel

@kernel
def total(values):
    return values[0] + values[1] + {read}
"""
CLOSED = """
from neuro.kernels.jit import kernel

def made():
    import far.numbers as numbers

    @kernel
    def total(values):
        return values[0] + values[1] + numbers.EXTRA

    return total

total = made()
"""


def test_an_edit_of_a_number_in_a_module_of_modules_is_seen(files, python):
    sources = {
        "three": DEEP.format(imported="deep.er.numbers", read="deep.er.numbers.EXTRA"),
        "circle": DEEP.format(imported="deep", read="deep.other.er.numbers.EXTRA"),
        "closure": CLOSED,
    }

    def numbers(extra):
        text = f"EXTRA = {extra}\n"
        files(far__numbers=text, deep__er__numbers=text, **sources)
        files(**{"deep/__init__": "import deep as other\nfrom deep import er\n"})

    code = "import deep.er.numbers, numpy as np; import three, circle, closure; values = np.array([1, 2])\n"
    code += "print(*(module.total(values) for module in (three, circle, closure)))"
    for extra, told in ((0, "3 3 3"), (10, "13 13 13")):
        numbers(extra)
        assert python(code) == (told, SAYS.replace("1 kernel", "3 kernels"))


PLAIN = """
from numba.extending import register_jitable
from far.numbers import EXTRA

@register_jitable
def again(a, b):
    return a + b + EXTRA

@register_jitable
def add(a, b):
    return again(a, b)
"""


def test_an_edit_of_a_plain_function_is_seen(package, files, python):
    """What numba compiles without a dispatcher, and what it calls and reads."""
    files(far__called=PLAIN)
    assert python(RUN) == ("3", SAYS)
    files(far__numbers="EXTRA = 10\n")
    assert python(RUN) == ("13", SAYS)
    files(far__called=PLAIN.replace("a + b", "a * b"))
    assert python(RUN) == ("12", SAYS)


def test_an_edit_of_how_kernels_compile_is_seen(package, python, tmp_path):
    copy = tmp_path / "neuro"
    subprocess.run(["cp", "-r", str(REPOSITORY / "neuro"), str(copy)], check=True)
    assert python(RUN) == ("3", SAYS)
    with (copy / "kernels" / "numba_internals.py").open("a") as source:
        source.write("# an edit\n")
    assert python(RUN) == ("3", SAYS)


def test_two_kernels_say_once_that_they_compile(package, python):
    code = RUN + "; print(total(np.array([1.0, 2.0])))"
    assert python(code) == ("3\n3.0", SAYS.replace("1 kernel", "2 kernels"))
    assert python(code) == ("3\n3.0", "")


def test_named_tuples_of_other_fields_are_other_arguments(files, python):
    code = """
import numpy as np
from collections import namedtuple
from near.kernels import total
Pair = namedtuple("Pair", "{}")
print(total(Pair(np.array([1]), np.array([2]))))
"""
    files(near__kernels="from neuro.kernels.jit import kernel\n@kernel\ndef total(p):\n    return p.a[0]\n")
    assert python(code.format("a b"))[0] == "1"
    assert python(code.format("b a"))[0] == "2"


def test_a_broken_file_is_compiled_anew(package, python, tmp_path):
    assert python(RUN) == ("3", SAYS)
    (kept,) = (tmp_path / "cache" / "neuro" / "machine_code").iterdir()
    kept.write_bytes(kept.read_bytes()[:100])
    assert python(RUN) == ("3", SAYS)


@pytest.mark.slow
def test_processes_compile_at_once(package, tmp_path):
    pipes = {**settings(tmp_path), "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    del pipes["capture_output"]
    both = RUN + "; print(total(np.array([1.0, 2.0])))"
    other = RUN.replace("[1, 2]", "[1.0, 2.0]") + "; print(total(np.array([1, 2])))"
    running = [subprocess.Popen([sys.executable, "-c", code], **pipes) for code in (both, other) * 2]
    assert [process.communicate(timeout=120)[0].split() for process in running] == [["3", "3.0"], ["3.0", "3"]] * 2
    names = {path.name for path in (tmp_path / "cache" / "neuro" / "machine_code").iterdir()}
    assert len(names) == 2


def test_all_kernels_compile_by_this_cache():
    found = [
        str(path.relative_to(REPOSITORY))
        for folder in ("neuro", "backends", "apps", "models", "examples")
        for path in sorted((REPOSITORY / folder).rglob("*.py"))
        if re.search(r"\bnjit\b|numba\.jit\b|cache=True", path.read_text())
    ]
    assert found == ["neuro/kernels/jit.py", "neuro/kernels/kept.py"]
