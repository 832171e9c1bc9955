"""An empty folder into which the recorded inputs of a file are copied, at the paths that they had."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from importlib.machinery import all_suffixes
from pathlib import Path

from neuro.core.errors import ModelError
from neuro.core.extension import extensions

__all__ = ["NewFolder", "copy_input"]

_CODE = (*all_suffixes(), ".pth")
_SETTINGS = (".numba_config.yaml", "matplotlibrc")
"""Files by which numba and matplotlib change what they do, if they lie in the current folder."""


class NewFolder:
    """A folder that stands for the root of the file system, so that no recorded path leads out of it.

    With `root` /tmp/new, a command in /home/ann that reads ../data/a.h5 runs in /tmp/new/home/ann, where the same text
    leads to /tmp/new/home/data/a.h5. Folders are made and files are copied; no link leads out.

    Args:
        root: an empty folder.
        current: the absolute path of the folder in which the command ran.

    Attributes:
        current: the folder in which the command runs now.
    """

    def __init__(self, root: str, current: str) -> None:
        self._root, self._recorded = os.path.realpath(root), current
        self._copies: dict[Path, tuple[int, int]] = {}
        self.current = self._inside(".")
        self.current.mkdir(parents=True, exist_ok=True)

    def _inside(self, text: str) -> Path:
        return Path(self._root + os.path.normpath(f"/{os.path.join(self._recorded, text)}".replace("//", "/")))

    def place(self, text: str) -> str:
        """Return a value of the command as it leads to the same place below the new folder; texts and numbers stay."""
        inside = self._inside(text)
        inside.parent.mkdir(parents=True, exist_ok=True)
        stays = not os.path.isabs(text) and os.path.normpath(os.path.join(self.current, text)) == str(inside)
        return text if stays else str(inside)

    def add(self, name: str, source: Path) -> None:
        """Copy an input to where it was.

        Raises:
            ModelError: as `copy_input`.
        """
        for copy in copy_input(source, self._inside(name)):
            self._copies[copy] = _identity(copy)

    def made(self, name: str) -> list[Path]:
        """Return the files of a name, or else with its ending, that are no unchanged copies of inputs."""
        files = sorted(Path(folder, each) for folder, _, names in os.walk(self._root) for each in names)
        new = [path for path in files if not path.is_symlink() and self._copies.get(path) != _identity(path)]
        return [path for path in new if path.name == name] or [path for path in new if path.suffix == Path(name).suffix]


def _identity(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_ino, state.st_mtime_ns


def copy_input(source: Path, to: Path) -> Iterator[Path]:
    """Copy a file, or a folder with all files in it, to where nothing is yet, and yield each copy.

    Left out are devices and pipes, settings of other packages, and Python files that the user did not name.

    Raises:
        ModelError: a link leads out of the folder, or there is no room for the copies.
    """
    if not source.exists():
        return
    pairs = [(source, to)] if source.is_file() else list(_files(source, to))
    pairs = [(path, copy) for path, copy in pairs if path.is_file() and not copy.exists() and _may_be_copied(path)]
    to.parent.mkdir(parents=True, exist_ok=True)
    needed, free = sum(path.stat().st_size for path, _ in pairs), shutil.disk_usage(to.parent).free
    if needed > free:
        raise ModelError(f"{source}: has {needed:,} bytes to copy into {to.parent}, where {free:,} are free")
    for path, copy in pairs:
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
        yield copy


def _files(folder: Path, to: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files in a folder, each with the path of its copy."""
    top = os.path.realpath(folder) + os.sep
    for root, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(root, name)
            if path.is_symlink() and not os.path.realpath(path).startswith(top):
                raise ModelError(f"{path}: a link that leads out of {folder}: expected files")
        yield from ((path := Path(root, name), to / path.relative_to(folder)) for name in names)


def _may_be_copied(path: Path) -> bool:
    if path.name.endswith(_CODE):
        return os.path.realpath(path) in map(os.path.realpath, extensions())
    return path.name not in _SETTINGS
