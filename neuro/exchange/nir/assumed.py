"""A file of NIR of which not all is known: what is assumed, and which tools it has other spikes in."""

from __future__ import annotations

from pathlib import Path

from neuro.core.errors import ModelError
from neuro.exchange.nir.cells import TOOLS, find_tool
from neuro.exchange.nir.importing import STEP, examine, judge
from neuro.exchange.nir.judged import Read
from neuro.exchange.nir.measured import differences
from neuro.exchange.nir.reading import read


def examine_file(path: Path, dt: float | None, from_: str | None, reset: str | None) -> tuple[Read, str]:
    """Read a file by what is known of it, else by the equations of NIR in steps of 1 ms.

    Returns:
        the graph with its verdicts, and what was assumed: "" if nothing was.
    """
    plain = read(path)
    known_step, tool = plain.metadata.get(STEP), find_tool(from_, plain.metadata)
    step = dt if dt is not None else 1.0 if known_step is None else float(known_step)
    found = examine(plain, step, tool or "nir", reset)
    assumed = []
    if tool is None:
        assumed.append("nothing names the tool that wrote it (--from TOOL), so the equations of NIR hold")
    if dt is None and known_step is None:
        assumed.append(f"NIR has no steps (--resolution MS), so a step has {step:g} ms")
    if not assumed:
        return found, ""
    note = f"{path}: {'; '.join(assumed)}."
    if tool is not None or found.table().refused:
        return found, note
    others: dict[str, Read | str] = {}
    for name in TOOLS:
        if name != found.tool:
            try:
                others[name] = judge(plain, step, name, reset)
            except ModelError as error:
                others[name] = error.message
    return found, f"{note}\n{differences(found, others)}"
