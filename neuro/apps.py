"""Public API for applications on this framework: commands, output files, YAML with positions, kernels and more.

from neuro.apps import console, kernel, output, read

Names in this module are stable, even if the code behind them moves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names as public_names

if TYPE_CHECKING:
    from neuro.chips.energy import number as number, quantity as quantity, sourced as sourced
    from neuro.chips.known import ARITHMETICS as ARITHMETICS, arithmetic_of as arithmetic_of
    from neuro.cli import options as options
    from neuro.cli.chips import PRICED as PRICED, Chips as Chips, Sources as Sources, print_bills as print_bills
    from neuro.cli.options import (
        Backend as Backend,
        Backends as Backends,
        Duration as Duration,
        NetworkFile as NetworkFile,
        NoBrowser as NoBrowser,
        Seed as Seed,
        Set as Set,
        Threads as Threads,
        assignments as assignments,
        at_least as at_least,
        group as group,
        input_file as input_file,
        milliseconds as milliseconds,
        option as option,
        refuse_unused as refuse_unused,
        resumable as resumable,
        seeds as seeds,
        stoppable as stoppable,
        whole as whole,
        with_settings as with_settings,
    )
    from neuro.cli.run import (
        InFormat as InFormat,
        PictureFormat as PictureFormat,
        Record as Record,
        keep_spikes as keep_spikes,
        write_pictures as write_pictures,
    )
    from neuro.coding.encoders import (
        PIXEL_SPIKE as PIXEL_SPIKE,
        check_pixels as check_pixels,
        pixel_spikes as pixel_spikes,
    )
    from neuro.coding.spaces import (
        Actions as Actions,
        States as States,
        actions_of as actions_of,
        dimensions_of as dimensions_of,
        flat as flat,
    )
    from neuro.coding.world import (
        DECODERS as DECODERS,
        ENCODERS as ENCODERS,
        TEACHERS as TEACHERS,
        Moment as Moment,
    )
    from neuro.compare.runs import chip_of as chip_of
    from neuro.compiler import compile_network as compile_network
    from neuro.compiler.cameras import CameraInput as CameraInput
    from neuro.compiler.mistakes import mistakes as mistakes
    from neuro.core import (
        hdf5 as hdf5,
        html as html,
        keyed_random as keyed_random,
        player as player,
        processes as processes,
        tables as tables,
    )
    from neuro.core.checks import (
        argument as argument,
        check as check,
        check_fields as check_fields,
        is_number as is_number,
        refuse_masked as refuse_masked,
    )
    from neuro.core.choice import Choice as Choice
    from neuro.core.clock import NEVER as NEVER, Clock as Clock
    from neuro.core.errors import (
        Where as Where,
        a as a,
        nearest as nearest,
        printable as printable,
        some as some,
        unknown as unknown,
        words_of as words_of,
    )
    from neuro.core.extension import (
        extensions as extensions,
        named_by_user as named_by_user,
        run_extensions as run_extensions,
    )
    from neuro.core.extras import LazyModule as LazyModule, app as app, install as install, needed as needed
    from neuro.core.grid import GridJob as GridJob, JobResults as JobResults, grid as grid
    from neuro.core.hints import near as near
    from neuro.core.inputs import (
        CLOSED as CLOSED,
        digest_of as digest_of,
        existing as existing,
        file_path as file_path,
        gathering as gathering,
        record_input as record_input,
    )
    from neuro.core.interrupts import ending_by as ending_by
    from neuro.core.keyed_random import key as key
    from neuro.core.lazy import public_names as public_names
    from neuro.core.outputs import (
        PART as PART,
        Kind as Kind,
        Unwritable as Unwritable,
        check_output as check_output,
        kept_json as kept_json,
        make_folder as make_folder,
        marked as marked,
        output as output,
        sealed as sealed,
        write_text as write_text,
    )
    from neuro.core.pictures import check_picture as check_picture, write_picture as write_picture
    from neuro.core.processes import (
        Lost as Lost,
        Processes as Processes,
        Task as Task,
        Work as Work,
        cores as cores,
        side_by_side as side_by_side,
    )
    from neuro.core.progress import Bar as Bar, advance as advance
    from neuro.core.provenance import ATTRIBUTE as ATTRIBUTE, differences as differences, provenance as provenance
    from neuro.core.quantities import Quantity as Quantity, in_ms as in_ms, word_of as word_of
    from neuro.core.registry import Registry as Registry
    from neuro.core.settings import Part as Part, Settings as Settings, part as part, setting as setting
    from neuro.core.system import only_on_linux as only_on_linux
    from neuro.core.tables import Table as Table, as_html as as_html, console as console, echo as echo, table as table
    from neuro.core.units import converted as converted, is_measure as is_measure
    from neuro.core.values import literal as literal, same as same, shown as shown
    from neuro.files import results as results, state as state
    from neuro.files.recorded import variation as variation
    from neuro.files.results import KIND as KIND
    from neuro.files.state import Checkpoint as Checkpoint, fingerprint as fingerprint
    from neuro.kernels import draws as draws
    from neuro.kernels.address import caller as caller
    from neuro.kernels.instructions import (
        address as address,
        load_acquire as load_acquire,
        store_release as store_release,
    )
    from neuro.kernels.jit import allocating as allocating, inlined as inlined, kernel as kernel, subkernel as subkernel
    from neuro.kernels.numba_internals import ir as ir
    from neuro.model.language import (
        Node as Node,
        about as about,
        mistake as mistake,
        plain as plain,
        read as read,
        save as save,
        words as words,
    )
    from neuro.model.language.including import gather as gather
    from neuro.model.language.loader import build as build
    from neuro.model.language.parameters import resolve as resolve
    from neuro.model.language.writer import NETWORK as NETWORK
    from neuro.model.parts import (
        AUTO as AUTO,
        CENTRED as CENTRED,
        DECIDED_BY as DECIDED_BY,
        Population as Population,
        Projection as Projection,
    )
    from neuro.model.synapses.base import common as common
    from neuro.pages import curves as curves, histograms as histograms, raster as raster
    from neuro.plots._canvas import COLOURS as COLOURS, Picture as Picture, tidy as tidy
    from neuro.program.backend import (
        Fired as Fired,
        are_finite as are_finite,
        find_backend as find_backend,
        unreadable as unreadable,
    )
    from neuro.program.counts import difference as difference, fan_out as fan_out
    from neuro.realtime.closed_loop import MOST as MOST, TESTS as TESTS, lived_again as lived_again
    from neuro.realtime.environments import (
        Environments as Environments,
        find as find,
        made as made,
        why as why,
    )
    from neuro.realtime.episodes import (
        End as End,
        Log as Log,
        Test as Test,
        episode_seed as episode_seed,
    )
    from neuro.realtime.pilot import NetworkPilot as NetworkPilot
    from neuro.run import settable as settable
    from neuro.run.collect import collect as collect
    from neuro.run.inputs import driver as driver, outgoing as outgoing
    from neuro.run.signals import signals_of as signals_of
    from neuro_live.cli import announce as announce
    from neuro_predict.decisions import Evaluation as Evaluation, evaluate as evaluate, wilson as wilson
    from neuro_predict.showing import Overflows as Overflows, Showing as Showing, warn_of_overflows as warn_of_overflows


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
