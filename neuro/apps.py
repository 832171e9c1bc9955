"""What applications on this framework are made of: files that are replaced whole, commands, YAML with places, kernels.

from neuro.apps import console, kernel, output, read

Names here stay, wherever they are defined.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.chips.energy import number as number, quantity as quantity, sourced as sourced
    from neuro.cli.chips import PRICED as PRICED, Chips as Chips, Sources as Sources
    from neuro.cli.live import announce as announce
    from neuro.cli.options import (
        Backend as Backend,
        Backends as Backends,
        NetworkFile as NetworkFile,
        Seed as Seed,
        Set as Set,
        assignments as assignments,
        at_least as at_least,
        resumable as resumable,
        seeds as seeds,
        whole as whole,
        with_settings as with_settings,
    )
    from neuro.core import hdf5 as hdf5, html as html, player as player
    from neuro.core.checks import check as check, check_fields as check_fields
    from neuro.core.clock import Clock as Clock
    from neuro.core.errors import Where as Where, unknown as unknown
    from neuro.core.extension import extensions as extensions, run_extensions as run_extensions
    from neuro.core.extras import install as install
    from neuro.core.grid import GridJob as GridJob, JobResults as JobResults, grid as grid
    from neuro.core.inputs import record_input as record_input
    from neuro.core.outputs import (
        Kind as Kind,
        Unwritable as Unwritable,
        check_output as check_output,
        kept_json as kept_json,
        make_folder as make_folder,
        output as output,
        sealed as sealed,
        write_text as write_text,
    )
    from neuro.core.pictures import write_picture as write_picture
    from neuro.core.processes import cores as cores, side_by_side as side_by_side
    from neuro.core.progress import Bar as Bar
    from neuro.core.provenance import provenance as provenance
    from neuro.core.quantities import Quantity as Quantity
    from neuro.core.registry import Registry as Registry
    from neuro.core.settings import Part as Part, Settings as Settings, part as part, setting as setting
    from neuro.core.tables import console as console, echo as echo, table as table
    from neuro.core.values import literal as literal
    from neuro.files.state import Checkpoint as Checkpoint, fingerprint as fingerprint
    from neuro.kernels.jit import allocating as allocating, kernel as kernel, subkernel as subkernel
    from neuro.model.language import (
        Node as Node,
        about as about,
        mistake as mistake,
        plain as plain,
        read as read,
        words as words,
    )
    from neuro.model.language.writer import NETWORK as NETWORK
    from neuro.program.backend import find_backend as find_backend
    from neuro.readout.decisions import Evaluation as Evaluation, evaluate as evaluate, wilson as wilson
    from neuro.readout.showing import Overflows as Overflows, Showing as Showing, warn_of_overflows as warn_of_overflows


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
