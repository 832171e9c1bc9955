"""Where a file says that it comes from, and what has become of that."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.hdf5 import check
from neuro.core.inputs import digest_of
from neuro.core.provenance import ATTRIBUTE

_ON_PAGE = re.compile(rf'<meta name="{ATTRIBUTE}" content="([^"]*)">')


def record_of(path: Path) -> dict[str, Any]:
    """The record in an HDF5 file or in a page.

    Raises:
        ModelError: it holds none, or is damaged.
    """
    import h5py

    text = ""
    if path.suffix in (".html", ".htm"):
        found = _ON_PAGE.search(path.read_text("utf-8", "replace"))
        text = html.unescape(found[1]) if found else ""
    elif path.is_file() and check(path):
        with h5py.File(path) as file:
            text = str(file.attrs.get(ATTRIBUTE, ""))
    try:
        told = json.loads(text)
    except ValueError:
        told = None
    if not isinstance(told, dict):
        hint = "files that neuro wrote since it tells where they come from have it; runs of sweeps are folders"
        raise ModelError(f"{path}: does not say where it comes from", hint=hint)
    return told


def moved(inputs: Mapping[str, str], folders: Iterable[Path]) -> dict[str, str]:
    """Where inputs that are not where they were lie now, by their content.

    Args:
        inputs: hashes by path.
        folders: in which they are looked for, at any depth.
    """
    lost = {digest: name for name, digest in inputs.items() if not Path(name).exists()}
    found: dict[str, str] = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if lost and (path.is_file() or path.is_dir()) and (name := lost.get(digest_of(path))):
                found.setdefault(name, str(path.absolute()))
    return found


def edited(inputs: Mapping[str, str], elsewhere: Mapping[str, str]) -> list[str]:
    """What has become of inputs, in words."""
    told = []
    for name, digest in inputs.items():
        now = digest_of(elsewhere.get(name, name))
        if name in elsewhere:
            told.append(f"input {name}: lies at {elsewhere[name]} now, with the same content")
        elif not now:
            told.append(f"input {name}: is not there any more")
        elif now != digest:
            told.append(f"input {name}: was edited")
    return told
