"""The file of a description with the files that it includes: the parts of all, by section."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from neuro.core.errors import ModelError, Where
from neuro.core.values import shown
from neuro.model.language.files import inside
from neuro.model.language.reader import MAX_DEPTH, Node, found, mistake, plain, read, within, words

OWN = ("neuro", "name", "include")
GATHERED = ("parameters", "models", "populations", "projections", "signals", "groups", "probes")
SECTIONS = (*OWN, "resolution", *GATHERED[:-1], "trials", "probes", "readout", "world")
VERSION = 1


def published() -> dict[str, Path]:
    """Their files; none where they are not installed."""
    found = find_spec("neuro_models")
    folders = (found and found.submodule_search_locations) or ()
    return {file.stem: file for folder in folders for file in sorted(Path(folder).glob("*.yaml"))}


def refuse_name(path: Path) -> None:
    """Refuse a name of one where a file is expected, and there is none of that name.

    Raises:
        ModelError: it says how the published network is read.
    """
    if path == Path(path.name) and path.suffix in ("", ".yaml") and path.stem in published() and not path.exists():
        hint = f"the published network is neuro.load(neuro_models.path('{path.stem}'))"
        raise ModelError("no such file", where=Where(str(path)), hint=hint)


def gather(path: Path, reading: Callable[[Path], Node] = read) -> dict[str, Node]:
    """Read a file with everything it includes.

    Args:
        path: the file.
        reading: gives the content of a file.

    Returns:
        The sections by name; the parts of included files come before the file's own.

    Raises:
        ModelError: a file cannot be read, a word is unknown, or two files define the same part.
    """
    return _sections(reading(path), [path.resolve()], set(), reading)


def _sections(root: Node, chain: list[Path], seen: set[Path], reading: Callable[[Path], Node]) -> dict[str, Node]:
    own = words(root, SECTIONS, "a network")
    version = own.get("neuro")
    if version is not None and (type(version.value) is not int or version.value != VERSION):
        raise mistake(version, f"neuro = {shown(plain(version))}: expected {VERSION}, the version of the language")
    merged: dict[str, Node] = {}
    for node in _included(own):
        for section, part in _included_sections(node, chain, seen, reading).items():
            _merge(merged, section, part)
    for section, part in own.items():
        if section in GATHERED and not isinstance(part.value, dict):
            hint = "write 'name: {...}' for each, without '-'" if isinstance(part.value, list) else ""
            raise mistake(part, f"{section}: {found(part)}: expected a mapping from names to parts", hint)
        _merge(merged, section, part)
    return merged


def _included(own: dict[str, Node]) -> list[Node]:
    if "include" not in own:
        return []
    node = own["include"]
    if isinstance(node.value, str):
        raise mistake(node, f"include = '{node.value}': expected a list of files", f"write [{node.value}]")
    if not isinstance(node.value, list):
        raise mistake(node, f"include: {found(node)}: expected a list of files")
    for item in node.value:
        if not isinstance(item.value, str):
            raise mistake(item, f"include: {found(item)}: expected the name of a file")
    return node.value


def _included_sections(
    node: Node, chain: list[Path], seen: set[Path], reading: Callable[[Path], Node]
) -> dict[str, Node]:
    with within("include"):
        path = inside(node, node.value)
        real = path.resolve()
        if real in chain:
            names = " -> ".join(p.name for p in [*chain[chain.index(real) :], real])
            raise mistake(node, f"'{node.value}' includes itself: {names}")
        if real in seen:
            raise mistake(node, f"'{node.value}' is included twice", "include it once; its parts are seen everywhere")
        if len(chain) > MAX_DEPTH:
            raise mistake(
                node, f"'{node.value}' is included at level {len(chain)}: expected at most {MAX_DEPTH} levels"
            )
    seen.add(real)
    inner = _sections(reading(path), [*chain, real], seen, reading)
    return {section: part for section, part in inner.items() if section not in OWN}


def _merge(merged: dict[str, Node], section: str, part: Node) -> None:
    if section not in merged:
        merged[section] = part
        return
    first = merged[section]
    if section not in GATHERED:
        raise ModelError(f"'{section}' is said twice", where=part.label, hint=f"first at {first.label}")
    for name, node in part.value.items():
        if name in first.value:
            earlier = first.value[name].label
            raise ModelError(f"{section}: '{name}' is defined twice", where=node.label, hint=f"first at {earlier}")
    merged[section] = Node({**first.value, **part.value}, first.where, first.label)
