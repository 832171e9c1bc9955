"""Read a description together with its included files, merged by section."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from neuro.core.errors import ModelError
from neuro.core.values import shown
from neuro.model.language.files import inside
from neuro.model.language.reader import MAX_DEPTH, Node, found_text, mistake, plain, read, within, words

OWN = ("neuro", "name", "include")
"""Sections that are not taken from included files."""
GATHERED = ("parameters", "models", "populations", "projections", "signals", "groups", "probes")
"""Sections that may be spread over several files. Each is a mapping from names to parts."""
SECTIONS = (*OWN, "resolution", *GATHERED[:-1], "trials", "probes", "readout", "world")
VERSION = 1


def gather(path: Path, reading: Callable[[Path], Node] = read) -> dict[str, Node]:
    """Read a file and all files that it includes.

    Args:
        path: the file.
        reading: function that returns the content of a file.

    Returns:
        The sections by name. Parts of included files come before the parts of the file.

    Raises:
        ModelError: a file cannot be read, a word is unknown, or two files define the same part.
    """
    return _sections(reading(path), [path.resolve()], set(), reading)


def _sections(root: Node, chain: list[Path], included: set[Path], reading: Callable[[Path], Node]) -> dict[str, Node]:
    file_sections = words(root, SECTIONS, "a network")
    version = file_sections.get("neuro")
    if version is not None and (type(version.value) is not int or version.value != VERSION):
        raise mistake(version, f"neuro = {shown(plain(version))}: expected {VERSION}, the version of the language")
    merged: dict[str, Node] = {}
    for node in _include_nodes(file_sections):
        for section, parts in _included_sections(node, chain, included, reading).items():
            _merge(merged, section, parts)
    for section, parts in file_sections.items():
        if section in GATHERED and not isinstance(parts.value, dict):
            hint = "write 'name: {...}' for each, without '-'" if isinstance(parts.value, list) else ""
            raise mistake(parts, f"{section}: {found_text(parts)}: expected a mapping from names to parts", hint)
        _merge(merged, section, parts)
    return merged


def _include_nodes(sections: dict[str, Node]) -> list[Node]:
    if "include" not in sections:
        return []
    node = sections["include"]
    if isinstance(node.value, str):
        raise mistake(node, f"include = '{node.value}': expected a list of files", f"write [{node.value}]")
    if not isinstance(node.value, list):
        raise mistake(node, f"include: {found_text(node)}: expected a list of files")
    for item in node.value:
        if not isinstance(item.value, str):
            raise mistake(item, f"include: {found_text(item)}: expected the name of a file")
    return node.value


def _included_sections(
    node: Node, chain: list[Path], included: set[Path], reading: Callable[[Path], Node]
) -> dict[str, Node]:
    with within("include"):
        path = inside(node, node.value)
        real = path.resolve()
        if real in chain:
            names = " -> ".join(parent.name for parent in [*chain[chain.index(real) :], real])
            raise mistake(node, f"'{node.value}' includes itself: {names}")
        if real in included:
            raise mistake(node, f"'{node.value}' is included twice", "include it once; every file can use its parts")
        if len(chain) > MAX_DEPTH:
            raise mistake(
                node, f"'{node.value}' is included at level {len(chain)}: expected at most {MAX_DEPTH} levels"
            )
    included.add(real)
    own_sections = _sections(reading(path), [*chain, real], included, reading)
    return {section: part for section, part in own_sections.items() if section not in OWN}


def _merge(merged: dict[str, Node], section: str, parts: Node) -> None:
    if section not in merged:
        merged[section] = parts
        return
    first_place = merged[section]
    if section not in GATHERED:
        raise ModelError(f"'{section}' is defined twice", where=parts.label, hint=f"first at {first_place.label}")
    for name, node in parts.value.items():
        if name in first_place.value:
            earlier = first_place.value[name].label
            raise ModelError(f"{section}: '{name}' is defined twice", where=node.label, hint=f"first at {earlier}")
    merged[section] = Node({**first_place.value, **parts.value}, first_place.where, first_place.label)
