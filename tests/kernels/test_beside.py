"""Kernels that compile side by side."""

import subprocess
import sys
from functools import partial

from numba import types

from neuro.kernels import beside, compile_report, kept
from neuro.kernels.address import Entry
from neuro.kernels.jit import kernel
from neuro_event.loop import tables

NAMES = ("note", "charge", "drive", "draw_counts")


def test_two_processes_share_what_has_to_be_compiled(tmp_path, monkeypatch):
    """What the other process has compiled is found, so this one compiles less."""
    code = (
        "from functools import partial\n"
        "from neuro.kernels import beside, compile_report\nfrom neuro_event.loop import tables\n"
        f"asked = [partial(tables.stage_entry, name) for name in {NAMES}]\n"
        "found = beside.addresses(asked)\n"
        "own = sum(sum(each().kernel.stats.cache_misses.values()) for each in asked)\n"
        "print(len(set(found)) == 4, 0 not in found, own < 4, compile_report._kernels)"
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(compile_report.REPORTED)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "True", "4"]
    assert len(list((tmp_path / "neuro" / "machine_code").iterdir())) == 4
    assert done.stderr.splitlines()[0] == "neuro: compiling kernels for this machine, once"
    assert done.stderr.splitlines()[1].startswith("neuro: compiled 4 kernels in ")


def test_what_another_process_cannot_import_is_compiled_here(tmp_path, monkeypatch):
    monkeypatch.setattr(kept, "_places", lambda: iter([tmp_path]))
    kept.folder.cache_clear()

    def entry(extra):
        @kernel
        def add(a):
            return a + extra

        return Entry(add, types.int64(types.int64))

    made = {extra: entry(extra) for extra in (1, 2, 3)}
    monkeypatch.setattr(beside, "_helper_pays", lambda: True)
    found = beside.addresses([partial(made.get, extra) for extra in made])
    assert len(set(found)) == 3
    kept.folder.cache_clear()


def test_each_stage_takes_what_its_callers_hand_on():
    for name, (_, arguments, _) in tables.STAGES.items():
        function = tables.stage_entry(name).kernel.py_func
        assert ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount]) == arguments
