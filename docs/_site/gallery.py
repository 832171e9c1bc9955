"""The gallery: examples that a build runs, and those that show what an earlier run has left.

Copies of the examples, each with its title, are laid where sphinx-gallery runs them, so that what they write stays
there. `python docs/_site/gallery.py [NAME...]` runs those that are stored, and keeps what they print and draw beside
their command and the SHA-256 of the file.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

SITE = Path(__file__).parent
ROOT = SITE.parents[1]
EXAMPLES = ROOT / "examples"
COPIES = ROOT / "build" / "examples"
STORED = SITE / "stored"
DATA = ROOT.parent / "shared" / "data"
"""Where files are looked for that a stored command names."""

SHOWN = """
# %%
# The network, ``{file}``:
#
# .. literalinclude:: /../examples/{file}
#    :language: yaml
"""

PARTS: dict[str, Any] = yaml.safe_load((SITE / "gallery.yaml").read_text("utf-8"))


def examples() -> Iterator[tuple[str, str, dict[str, str]]]:
    """Part, name and words of each example."""
    for part, about in PARTS.items():
        for name, words in about["examples"].items():
            yield part, name, words


def sha256(name: str) -> str:
    """That of an example's file."""
    return hashlib.sha256((EXAMPLES / f"{name}.py").read_bytes()).hexdigest()


def lay_copies() -> None:
    """Lay all examples out for sphinx-gallery, with a header for the gallery and one for each part."""
    shutil.rmtree(COPIES, ignore_errors=True)
    (COPIES).mkdir(parents=True)
    lead = "Whole programs, with what they print and draw."
    (COPIES / "GALLERY_HEADER.rst").write_text(f"{underlined('Gallery', '#')}\n{lead}\n")
    for number, (part, about) in enumerate(PARTS.items()):
        folder = COPIES / part
        folder.mkdir()
        (folder / "GALLERY_HEADER.rst").write_text(f".. part {number}\n\n{underlined(about['title'], '=')}\n")
    for part, name, words in examples():
        (COPIES / part / f"{name}.py").write_text(copied(name, words), "utf-8")
        for network in networks(name):
            shutil.copy(EXAMPLES / network, COPIES / part)
    forget_pages()


def forget_pages() -> None:
    """Remove what an earlier build has made of examples that are gone, or are in another part now."""
    listed = {(part, name) for part, name, _ in examples()} | {(part, "index") for part in PARTS}
    for page in (SITE.parent / "gallery").glob("*/*.rst"):
        if (page.parent.name, page.stem) not in listed and page.stem != "sg_execution_times":
            page.unlink()


def networks(name: str) -> list[str]:
    """The files of networks beside an example that it reads."""
    return re.findall(r'\.with_name\("(\w+\.yaml)"\)', (EXAMPLES / f"{name}.py").read_text("utf-8"))


def underlined(title: str, by: str) -> str:
    """A heading of reStructuredText."""
    return f"{title}\n{by * len(title)}\n"


def copied(name: str, words: dict[str, str]) -> str:
    """The text of an example's copy: with a title and, where it is stored, what it has left."""
    from docstrings import to_rst

    source = (EXAMPLES / f"{name}.py").read_text("utf-8")
    docstring = ast.parse(source).body[0]
    lines = (ast.get_docstring(ast.parse(source)) or "").splitlines()
    to_rst(None, "module", name, None, None, lines)  # type: ignore[arg-type]
    code = "\n".join(source.splitlines()[docstring.end_lineno :])
    code = code.replace("Path(__file__).with_name(", "Path(")  # sphinx-gallery runs no file, and in its folder
    lead = "\n".join([*lines, "", words.get("paper", "")])
    text = f'r"""\n{underlined(words["title"], "=")}\n{lead}\n"""\n{code}\n'
    shown = "".join(SHOWN.format(file=file) for file in networks(name))
    return text + (left(name) if "stored" in words else "") + shown


def left(name: str) -> str:
    """What a stored example has left, as text of its page."""
    made = STORED / name / "made.yaml"
    if not made.exists():
        return "\n# %%\n# Its output is not stored yet.\n"
    about = yaml.safe_load(made.read_text("utf-8"))
    rows = [
        f"What ``python {about['command']}`` prints and draws, in {about['seconds']} s. The output is stored; it is of",
        f"the file with the SHA-256 ``{about['sha256'][:16]}``.",
        "",
        ".. code-block:: text",
        "",
        *("   " + line for line in (STORED / name / "printed.txt").read_text("utf-8").splitlines()),
        "",
    ]
    pictures = sorted((STORED / name).glob("*.png"))
    for picture in pictures:
        rows += [f".. image:: /_site/stored/{name}/{picture.name}", ""]
    text = "\n# %%\n" + "\n".join(f"# {row}".rstrip() for row in rows) + "\n"
    return text + (
        f"\n# sphinx_gallery_thumbnail_path = '_site/stored/{name}/{pictures[0].name}'\n" if pictures else ""
    )


def stale() -> list[str]:
    """Stored examples whose file has changed since they ran."""
    return [
        name
        for _, name, words in examples()
        if "stored" in words
        and (made := STORED / name / "made.yaml").exists()
        and yaml.safe_load(made.read_text("utf-8"))["sha256"] != sha256(name)
    ]


def written_pictures(block: object, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Show the pictures that an example has written, a scraper of sphinx-gallery."""
    from sphinx_gallery.scrapers import figure_rst

    shown: list[str] = []
    for picture in sorted(Path(block_vars["src_file"]).parent.glob("*.png"), key=lambda path: path.stat().st_mtime):
        target = next(block_vars["image_path_iterator"])
        shutil.move(picture, target)
        shown.append(str(target))
    return str(figure_rst(shown, gallery_conf["src_dir"]))


def setup(app: Any) -> dict[str, object]:
    """Called by Sphinx."""
    from sphinx.util.logging import getLogger

    lay_copies()
    listed = {name for _, name, _ in examples()}
    for name in sorted({path.stem for path in EXAMPLES.glob("*.py")} ^ listed):
        getLogger(__name__).warning(f"examples/{name}.py and docs/_site/gallery.yaml: not in both")
    for name in stale():
        getLogger(__name__).warning(f"examples/{name}.py has changed since its output was stored: make gallery-full")
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def renew(name: str, command: str) -> None:
    """Run a stored example and keep what it prints and draws."""
    folder = ROOT / "build" / "stored" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file in EXAMPLES.glob(f"{name}.*"):
        shutil.copy(file, folder)
    words = shlex.split(command)
    found = [next((str(path) for path in DATA.rglob(word)), word) for word in words[1:]]
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, words[0], *found],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "agg"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    about = {"command": command, "sha256": sha256(name), "seconds": round(time.perf_counter() - begin)}
    shutil.rmtree(STORED / name, ignore_errors=True)
    (STORED / name).mkdir(parents=True)
    (STORED / name / "printed.txt").write_text(done.stdout, "utf-8")
    for picture in folder.glob("*.png"):
        shutil.copy(picture, STORED / name)
    (STORED / name / "made.yaml").write_text(yaml.safe_dump(about, sort_keys=False), "utf-8")


def main() -> None:
    """Renew all stored examples, or those that are named."""
    for _, name, words in examples():
        if "stored" in words and name in (sys.argv[1:] or [name]):
            print(f"examples/{words['stored']}", flush=True)
            renew(name, words["stored"])


if __name__ == "__main__":
    main()
