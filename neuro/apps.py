"""What applications on this framework are made of: files that are replaced whole, commands, YAML with places, kernels.

from neuro.apps import console, kernel, output, read

Names here stay, wherever they are defined.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily

if TYPE_CHECKING:
    from neuro.chips.pricing.energy import number, quantity, sourced
    from neuro.cli.energy import TARGETS, Sources, Target
    from neuro.cli.options import Backend, NetworkFile, Seed, Set, assignments, whole
    from neuro.core import hdf5, html
    from neuro.core.checks import check, check_fields
    from neuro.core.errors import Where, unknown
    from neuro.core.extension import extensions, run_extensions
    from neuro.core.extras import install
    from neuro.core.inputs import note
    from neuro.core.jobs import side_by_side
    from neuro.core.outputs import (
        Kind,
        Unwritable,
        check_output,
        kept_json,
        make_folder,
        output,
        sealed,
        write_picture,
        write_text,
    )
    from neuro.core.processes import cores
    from neuro.core.progress import Bar
    from neuro.core.provenance import provenance
    from neuro.core.quantities import Quantity
    from neuro.core.registry import Registry
    from neuro.core.tables import console, table
    from neuro.core.values import literal
    from neuro.files.checkpoint import Checkpoint
    from neuro.files.state import fingerprint
    from neuro.kernels.jit import allocating, inner, kernel
    from neuro.model.language import Node, about, mistake, plain, read, words
    from neuro.model.language.writer import NETWORK
    from neuro.program.backend import find_backend

_HOMES = {
    "neuro.cli.energy": (
        "TARGETS",
        "Sources",
        "Target",
    ),
    "neuro.cli.options": (
        "Backend",
        "NetworkFile",
        "Seed",
        "Set",
        "assignments",
        "whole",
    ),
    "neuro.core.checks": ("check", "check_fields"),
    "neuro.core.progress": ("Bar",),
    "neuro.core.provenance": ("provenance",),
    "neuro.core.quantities": ("Quantity",),
    "neuro.core.registry": ("Registry",),
    "neuro.core.errors": (
        "Where",
        "unknown",
    ),
    "neuro.core.html": (),
    "neuro.core.hdf5": (),
    "neuro.core.extension": ("extensions", "run_extensions"),
    "neuro.core.extras": ("install",),
    "neuro.core.inputs": ("note",),
    "neuro.core.jobs": ("side_by_side",),
    "neuro.core.processes": ("cores",),
    "neuro.core.outputs": (
        "Kind",
        "Unwritable",
        "check_output",
        "kept_json",
        "make_folder",
        "output",
        "sealed",
        "write_picture",
        "write_text",
    ),
    "neuro.core.tables": (
        "console",
        "table",
    ),
    "neuro.core.values": ("literal",),
    "neuro.chips.pricing.energy": (
        "number",
        "quantity",
        "sourced",
    ),
    "neuro.files.checkpoint": ("Checkpoint",),
    "neuro.files.state": ("fingerprint",),
    "neuro.kernels.jit": (
        "allocating",
        "inner",
        "kernel",
    ),
    "neuro.model.language": (
        "Node",
        "about",
        "mistake",
        "plain",
        "read",
        "words",
    ),
    "neuro.model.language.writer": ("NETWORK",),
    "neuro.program.backend": ("find_backend",),
}

__all__ = [
    "NETWORK",
    "TARGETS",
    "Backend",
    "Bar",
    "Checkpoint",
    "Kind",
    "NetworkFile",
    "Node",
    "Quantity",
    "Registry",
    "Seed",
    "Set",
    "Sources",
    "Target",
    "Unwritable",
    "Where",
    "about",
    "allocating",
    "assignments",
    "check",
    "check_fields",
    "check_output",
    "console",
    "cores",
    "extensions",
    "find_backend",
    "fingerprint",
    "hdf5",
    "html",
    "inner",
    "install",
    "kept_json",
    "kernel",
    "literal",
    "make_folder",
    "mistake",
    "note",
    "number",
    "output",
    "plain",
    "provenance",
    "quantity",
    "read",
    "run_extensions",
    "sealed",
    "side_by_side",
    "sourced",
    "table",
    "unknown",
    "whole",
    "words",
    "write_picture",
    "write_text",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
