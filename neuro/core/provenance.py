"""Provenance of files: a record of all that is needed to reproduce a file, or to see what has changed.

A record is plain data, written as JSON into every file of results, states, models and reports:

| word | content |
| --- | --- |
| neuro, commit | version of this package, and commit of the sources in a checkout |
| versions | versions of Python, of the packages that compute, and of the backend's simulator |
| backend, threads, seed | of a run |
| network | hash of the resolved network |
| inputs | hashes of all input files, by absolute path |
| command | command line and working folder |
| machine | system, processor, cores |
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from neuro.core import inputs
from neuro.core.version import VERSION

__all__ = ["ATTRIBUTE", "command", "commit", "differences", "machine", "provenance", "versions"]

ATTRIBUTE = "provenance"
"""Name of the record as JSON: an attribute of HDF5 files, and a <meta> of pages."""

COMPUTE = ("numpy", "numba", "scipy", "llvmlite")
_ALSO = ("torch", "scikit-learn", "nest-simulator")
"""Packages whose versions are recorded only if they were imported."""

_MODULES = {"scikit-learn": "sklearn", "nest-simulator": "nest"}
_MANY = 100
"""Number of files. If more input files are read, each folder with more than so many of them replaces its files."""
_FOLDER = Path(__file__).parents[2]


def provenance(files: Iterable[str] | None = None, /, **of_a_run: Any) -> dict[str, Any]:
    """Return the record of a result of this process.

    Args:
        files: input files; by default all files that were read so far.
        of_a_run: backend, threads, seed and network of a run; None is left out.
    """
    outermost = _outermost(inputs.recorded_inputs() if files is None else files)
    return {
        "neuro": VERSION,
        "commit": commit(),
        "versions": versions(),
        **{word: value for word, value in of_a_run.items() if value is not None},
        "inputs": {name: digest for name in outermost if (digest := inputs.digest_of(name))},
        "command": command(),
        "folder": os.getcwd(),
        "machine": machine(),
    }


def _outermost(files: Iterable[str]) -> list[str]:
    """Shorten a list of input files.

    The files of this package and the files in listed folders are dropped. If the list is long, a folder with many files
    replaces its files (see `_MANY`).
    """
    own_folder, names = str(_FOLDER / "neuro") + os.sep, list(dict.fromkeys(files))
    names = [name for name in names if not name.startswith(own_folder)]
    if len(names) > _MANY:
        by_folder: dict[str, list[str]] = {}
        for name in names:
            by_folder.setdefault(os.path.dirname(name), []).append(name)
        names = [name for folder, group in by_folder.items() for name in ([folder] if len(group) > _MANY else group)]
    folders = {name + os.sep for name in names if os.path.isdir(name)}
    return [name for name in names if not any(name.startswith(folder) for folder in folders)]


@cache
def commit() -> str:
    """Return the commit of the running sources, with "+" after edits; "" outside of a checkout."""
    if not (_FOLDER / ".git").exists():
        return ""
    try:
        arguments = ("git", "-C", str(_FOLDER), "describe", "--always", "--abbrev=12", "--dirty=+", "--exclude=*")
        answer = subprocess.run(arguments, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return answer.stdout.strip() if answer.returncode == 0 else ""


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that compute."""
    imported = [name for name in _ALSO if _MODULES.get(name, name) in sys.modules]
    return {"python": platform.python_version()} | {name: _version(name) for name in (*COMPUTE, *imported)}


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def command() -> str:
    """Return the command line of this process: `neuro run net.yaml`, or `python script.py`."""
    name = Path(sys.argv[0]).name if sys.argv and sys.argv[0] else "python"
    program = ["neuro"] if name in ("neuro", "__main__.py") else ["python", *sys.argv[:1]]
    return shlex.join([*program, *sys.argv[1:]])


@cache
def machine() -> str:
    """Return a description of the machine."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    parts = (platform.system(), platform.release(), _processor(), f"{os.cpu_count()} cores", f"{memory:.0f} GiB")
    return ", ".join(parts)


def _processor() -> str:
    try:
        model_name = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        model_name = None
    return model_name[1].strip() if model_name else platform.machine()


def differences(record: Mapping[str, Any], current: Mapping[str, Any]) -> list[str]:
    """Return the differences between two records as text; command and folder are ignored."""
    lines = []
    for word in ("neuro", "commit", "backend", "threads", "seed", "network", "machine"):
        if word in record and word in current and record[word] != current[word]:
            lines.append(f"{word}: {record[word]} then, {current[word]} now")
    old_versions, new_versions = record.get("versions", {}), current.get("versions", {})
    for name in sorted(old_versions.keys() & new_versions.keys()):
        if old_versions[name] != new_versions[name]:
            lines.append(f"{name}: {old_versions[name]} then, {new_versions[name]} now")
    return lines
