"""Every page is followed from top to bottom in an empty folder, as its reader would.

| a block | is |
| --- | --- |
| console | commands after `$ `, and below each what it prints, as on a terminal; nothing below: not told |
| sh | commands, one a line |
| python | run, all of a page in one namespace; written to a file if its first line is a comment with the file's name |
| text | what the block of Python above it prints |
| pycon | run, and what is printed compared |
| yaml | written to the file that its first line names; a network that nothing else on the page names is compiled |
| diff | a change of the file that its first line names |
| toml | read, not run |
| c | written to the file that its first line names, and compiled, where there is gcc |

**Printed** must be equal. `...` in a page stands for any text. What a clock measured (`in 0.21 s`, `12 steps/s`)
differs from run to run and is compared as if equal.

**A command ends with 0**, unless the page shows an `error:` below it.

**What cannot run here says so** in the first line of its block, `# needs WHAT`, with one of the words of `NEEDS`. Any
other is a fault of the page, so that nothing is left out in silence. New pages are found by themselves.

**What takes seconds**, `SLOW`, is done by `make test-slow`, which follows those pages as a whole.
"""

import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import traceback
import warnings
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

import neuro
from beside import beside
from neuro.cli import main
from neuro.cli.start import shipped

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
NEEDS, KINDS, EDITS, SLOW = beside(__file__, "NEEDS", "KINDS", "EDITS", "SLOW")
"""What blocks may need, with the module that shows that it is there (None: never asked for by a test); what blocks may
be; changes of a third-party file after which the page's first command prints something else; by page, words of the
commands and blocks of Python that take seconds and of which nothing below them is made: `make test-slow` does them."""

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
_FILE = re.compile(r"(?:# |/\* )([\w./-]+\.(?:py|yaml|c))(?: \*/)?\n")
_MARK = re.compile(r"# needs (.+)\n")
_SHELL = re.compile(r"[|;<>*]|&&")
_CLOCK = re.compile(r"(?<=\bin )[\d,.]+(?= m?s\b)|\d[\d,.]*(?= steps/s)")
_SESSION = "<stdin>"
_START = "from neuro.core import progress; progress.EVERY_S = 1e9; from neuro.cli import main; main()"
"""As on a terminal, where a slow command, say one that compiles kernels first, leaves no lines of its progress."""


class Fault(Exception):
    """What is wrong with a page, with its place."""


@dataclass(frozen=True)
class Block:
    """A block of a page, and the line of its first line."""

    page: Path
    line: int
    kind: str
    text: str

    def fault(self, what: str, below: int = 0) -> Fault:
        return Fault(f"{self.page.relative_to(ROOT)}:{self.line + below}: {what}")

    @property
    def need(self) -> str:
        """What it says that it needs, "" for nothing."""
        mark = _MARK.match(self.text)
        if mark is None:
            return ""
        if mark[1] not in NEEDS:
            raise self.fault(f"'{mark[1]}' is nothing that a page may need: expected one of {', '.join(NEEDS)}")
        return mark[1]

    @property
    def runs(self) -> bool:
        """Whether it runs here."""
        module = NEEDS[self.need] if self.need else "sys"
        return module is not None and find_spec(module) is not None


def blocks(page: Path) -> list[Block]:
    text = page.read_text("utf-8")
    return [Block(page, text[: m.start()].count("\n") + 2, m[1], m[2]) for m in _BLOCK.finditer(text)]


def commands(block: Block) -> list[tuple[int, str, str | None]]:
    """The command lines of a block, each with its place in it and with what it prints, None where that is not told."""
    lines = block.text.splitlines()
    if block.kind == "sh":
        return [(k, line, None) for k, line in enumerate(lines) if line and not line.startswith("#")]
    starts = [k for k, line in enumerate(lines) if line.startswith("$ ")]
    ends = [*starts[1:], len(lines)]
    return [
        (k, lines[k][2:], "\n".join(lines[k + 1 : end]) if end > k + 1 else None)
        for k, end in zip(starts, ends, strict=True)
    ]


@pytest.fixture
def reader(tmp_path, monkeypatch, registries):
    """Somebody in an empty folder; what they import there is forgotten afterwards."""
    tools = tmp_path / "bin"
    tools.mkdir()
    (tools / "neuro").write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, "-c", _START])} "$@"\n')
    (tools / "neuro").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONUNBUFFERED", "1")
    monkeypatch.setattr("neuro.core.progress.EVERY_S", 1e9)
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


def followed(page: Path, left_out: Sequence[str] = ()) -> dict[str, str]:
    """Do all that a page says, in the current folder, but the commands and blocks of Python that have some words.

    Returns:
        What each of its command lines printed.

    Raises:
        Fault: something does not do what the page says.
    """
    space, printed, done, by_line = {"__name__": "page"}, "", True, {}
    whole = page.read_text("utf-8")
    for words in left_out:
        assert words in whole, f"{page}: {words}"
    for block in blocks(page):
        named = _FILE.match(block.text)
        if not block.runs:
            continue
        if block.kind in ("sh", "console"):
            for place, line, told in commands(block):
                if not any(words in line for words in left_out):
                    by_line[line] = check_command(block, place, line, told)
        elif block.kind == "python" and named:
            Path(named[1]).write_text(block.text)
        elif block.kind == "python":
            done = not any(words in block.text for words in left_out)
            printed = run_python(block, space) if done else ""
        elif block.kind == "text" and done and not alike(block.text, printed):
            raise block.fault(f"the block above prints\n{printed}")
        elif block.kind == "pycon":
            run_session(block, space)
        elif block.kind == "yaml":
            read_yaml(block, named[1] if named else "", whole)
        elif block.kind == "diff":
            change(block)
        elif block.kind == "c":
            compile_c(block, Path(named[1] if named else "block.c"))
        elif block.kind not in ("text", "toml"):
            raise block.fault(f"a block of '{block.kind}' is not run: expected one of {', '.join(KINDS)}")
    return by_line


def compile_c(block: Block, path: Path) -> None:
    """Let a compiler look at a block of C, with all warnings."""
    path.write_text(block.text)
    if shutil.which("gcc") is None:
        return
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise block.fault(f"gcc says\n{done.stderr[-1000:]}")


def check_command(block: Block, place: int, line: str, told: str | None) -> str:
    """Run a command line and compare what it prints, which is returned."""
    status, printed = run(block, place, line)
    shown = line.split("  #")[0].rstrip()
    fails = told is not None and re.search(r"^error", told, re.M)
    if bool(status) != bool(fails):
        raise block.fault(f"`{shown}` ended with {status}: {printed.strip()[-1000:]}", place)
    if told is not None and not alike(told, printed):
        raise block.fault(f"`{shown}` prints\n{printed.rstrip()}\nand not\n{told.rstrip()}", place)
    return printed


def run(block: Block, place: int, line: str) -> tuple[int, str]:
    """A command line's exit status, and what it prints, as a terminal shows it.

    In this process where that is the same, which saves the start. What registers parts or pipes has its own.
    """
    words = shlex.split(line, comments=True)
    if words[0] == "neuro" and not _SHELL.search(line.split(" #")[0]) and "--with" not in words:
        return inside(words)
    if words[0] not in ("neuro", "python", "for", "mkdir", "cat", "head", "ls"):
        raise block.fault(f"`{line}`: the reader of a page has 'neuro' and 'python', else say what is needed", place)
    done = subprocess.run(
        ["bash", "-ec", line], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300, check=False
    )
    return done.returncode, done.stdout


def inside(words: list[str]) -> tuple[int, str]:
    """Run `neuro` in this process."""
    printed, before = io.StringIO(), sys.argv
    sys.argv = words
    try:
        with redirect_stdout(printed), redirect_stderr(printed), warnings.catch_warnings():
            warnings.simplefilter("default")  # they are told, not raised
            main()
    except SystemExit as leaving:
        return (leaving.code if isinstance(leaving.code, int) else 0), printed.getvalue()
    except Exception:
        return 1, printed.getvalue() + traceback.format_exc()
    finally:
        sys.argv = before
    raise AssertionError("main always leaves")


def alike(told: str, printed: str) -> bool:
    """Whether this was printed as it is told, but for the clock and what `...` stands for."""
    told, printed = (without_clock(text) for text in (told, printed))
    pattern = re.escape(told).replace(r"\.\.\.", ".*")
    return re.fullmatch(pattern, printed, re.S) is not None


def without_clock(text: str) -> str:
    return "\n".join(_CLOCK.sub("0", line.rstrip()) for line in text.strip("\n").splitlines())


def run_python(block: Block, space: dict[str, object]) -> str:
    """Run it in a namespace; what it prints."""
    printed = io.StringIO()
    try:
        with redirect_stdout(printed):
            exec(compile(block.text, _SESSION, "exec"), space)
    except Exception as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == _SESSION]
        place = (frames[-1].lineno or 1) - 1 if frames else 0
        raise block.fault(f"{type(error).__name__}: {error}", place) from error
    # A session has no file, so a mistake is told there without the place that it has here.
    return re.sub(rf"^{Path(__file__).name}:\d+: ", "", printed.getvalue(), flags=re.M)


def run_session(block: Block, space: dict[str, object]) -> None:
    test = doctest.DocTestParser().get_doctest(block.text, space, "session", str(block.page), block.line)
    told: list[str] = []
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS)
    runner.run(test, out=told.append, clear_globs=False)
    if told:
        raise block.fault("".join(told))


def read_yaml(block: Block, name: str, page: str) -> None:
    if not name and "neuro: 1" not in block.text:
        return
    path = Path(name or "block.yaml")
    path.write_text(block.text)
    if "neuro: 1" in block.text and page.count(path.name) <= 1:
        try:
            net = neuro.load(path)
            if net.populations:
                neuro.compile(net, backend="reference")
        except neuro.ModelError as error:
            raise block.fault(str(error)) from error


def change(block: Block) -> None:
    """Put each `+` line after the last line named, and remove each `-` line."""
    first, *lines = block.text.splitlines()
    path = Path(first.removeprefix("--- "))
    text, place = path.read_text().splitlines(), -1
    for line in lines:
        if line[0] == "+":
            place += 1
            text.insert(place, line[1:])
        else:
            if line[1:] not in text:
                raise block.fault(f"{path} has no line '{line[1:]}'")
            place = text.index(line[1:])
            if line[0] == "-":
                del text[place]
                place -= 1
    path.write_text("\n".join(text) + "\n")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    ("page", "left_out"),
    [
        *(pytest.param(page, SLOW.get(name_of(page), []), id=name_of(page)) for page in PAGES),
        *(pytest.param(ROOT / name, [], id=f"all of {name}", marks=pytest.mark.slow) for name in SLOW),
    ],
)
def test_page(page, left_out, reader):
    wrong = ""
    try:
        printed = followed(page, left_out)
        if page.stem in EDITS and not left_out:
            check_edited(page, reader, printed)
    except Fault as fault:
        wrong = str(fault)
    if wrong:
        pytest.fail(wrong, pytrace=False)


def test_a_wrong_page_is_told_with_its_place(reader, monkeypatch, messages):
    monkeypatch.setitem(globals(), "ROOT", reader)

    def of(text):
        (reader / "page.md").write_text(text)
        with pytest.raises(Fault) as fault:
            followed(reader / "page.md")
        return str(fault.value).replace(f"{reader}/", "")

    messages.of(of)


def check_edited(page: Path, folder: Path, printed: dict[str, str]) -> None:
    """An edited part runs as it is now: nothing compiled before is stale."""
    block = next(block for block in blocks(page) if block.kind == "console")
    place, line, _ = commands(block)[0]
    name, old, new = EDITS[page.stem]
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    status, after = run(block, place, line)
    if status or after == printed[line]:
        raise block.fault(
            f"after an edit of {name} `{line}` ended with {status} and prints what it printed before", place
        )


def test_every_example_is_on_a_page():
    told = "\n".join(page.read_text("utf-8") for page in PAGES)
    asked = {
        name for line in re.findall(r"^(?:\$ )?neuro example (.*)$", told, re.M) for name in shlex.split(line, True)
    }
    assert asked - {"--list"} == set(shipped("examples"))


@cache
def every_command():
    from typer.main import get_command

    from neuro.cli.commands import app

    return get_command(app)


def test_commands_in_sentences_are_commands():
    assert [wrong for page in PAGES for wrong in wrong_commands(page)] == []


def wrong_commands(page):
    """The commands in the sentences of a page that there are not, or that have no such option."""
    whole = page.read_text("utf-8")
    for number, line in enumerate(whole.splitlines(), 1):
        for text in re.findall(r"`neuro ([a-z][^`]*)`", line):
            if f'\n{text.split()[0]} = "' in whole:  # an entry point that the page adds
                continue
            place, command, rest = f"{page.relative_to(ROOT)}:{number}: `neuro {text}`", every_command(), text.split()
            try:
                while hasattr(command, "resolve_command") and rest and rest[0].isalnum() and rest[0].islower():
                    _, command, rest = command.resolve_command(None, rest)
            except Exception as error:
                yield f"{place}: {error}"
                continue
            known = {"--help", *(option for part in command.params for option in part.opts)}
            yield from (f"{place} has no {word}" for word in rest if word.startswith("--") and word not in known)


def test_lines_of_markdown_are_at_most_160_characters():
    assert [place for page in {*PAGES, *ROOT.glob("*.md")} for place in long_lines(page)] == []


def test_every_page_and_example_is_on_the_site():
    """A page belongs to a table of contents, an example to the gallery; `make docs` fails else."""
    docs = ROOT / "docs"
    listed = {docs / "index.md"}
    for page in docs.rglob("*.md"):
        for content in re.findall(r"```{toctree}\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
            entries = [line.split("<")[-1].rstrip("> ") for line in content.splitlines() if not line.startswith(":")]
            listed |= {Path(os.path.normpath(page.parent / f"{entry.removesuffix('.md')}.md")) for entry in entries}
    assert sorted(set(docs.rglob("*.md")) - listed) == []
    gallery = yaml.safe_load((docs / "_site" / "gallery.yaml").read_text("utf-8"))
    shown = {f"{name}.py" for part in gallery.values() for name in part["examples"]}
    assert shown == {file.name for file in (ROOT / "examples").glob("*.py")}


def long_lines(page: Path) -> list[str]:
    """Places outside of tables and blocks of code."""
    found, code = [], False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if line.lstrip().startswith("```"):
            code = not code
        elif not code and not line.lstrip().startswith("|") and len(line) > 160:
            found.append(f"{page.relative_to(ROOT)}:{number}")
    return found
