"""A network in its world: what `neuro run` does where the description has a `world`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from neuro.files.results import Results
    from neuro.model.network import Network
    from neuro.realtime.closed_loop import ClosedLoop
    from neuro.realtime.episodes import Log


def run_world(
    net: Network,
    out: Path,
    *,
    ends: dict[str, Any],
    frozen: bool,
    resume: bool,
    record: list[str],
    all_weights: bool,
    save_frozen: Path | None,
    compiling: Callable[[], AbstractContextManager[None]],
    **words: Any,
) -> tuple[Results, ClosedLoop]:
    """Run the closed loop and write its results, with the episodes beside the spikes of the last block.

    Args:
        net: the network.
        out: the file of results.
        ends: when to end, as of `ClosedLoop.run`.
        frozen: whether nothing learns.
        resume: whether to go on with an unfinished run.
        record: names of the populations whose spikes to write; all if empty.
        all_weights: whether to write all weights, as of `collect`.
        save_frozen: where the network goes with what it has learnt, if anywhere.
        compiling: gives the context in which the network is compiled, see `neuro.cli.run.approximations`.
        words: as of `closed_loop`.

    Raises:
        ModelError: the loop cannot be made or cannot go on, or an unfinished run lies beside `out`.
    """
    from neuro.cli.options import stoppable
    from neuro.core.errors import ModelError
    from neuro.core.outputs import output
    from neuro.core.system import shared
    from neuro.files.results import KIND, write
    from neuro.realtime.closed_loop import closed_loop
    from neuro.run.collect import files_of

    if shared():
        raise ModelError("a network in its world runs in one process: found several, of mpirun", hint="--copies N")
    learns = not frozen
    with stoppable(lambda: _left(loop, out, learns)) as bar:
        bar.say("preparing")
        with compiling():
            loop = closed_loop(net, learns=learns, record=True, **words)
        if learns:
            import hashlib

            digest = hashlib.blake2b(b"".join(files_of(net).values()), digest_size=16).hexdigest()
            identity = {"network": digest, "backend": words["backend"], "threads": words["threads"]}
            checkpoint = loop.checkpoint(out, identity)
            if checkpoint.path.exists() and not resume:
                message = f"{checkpoint.path} has an unfinished run"
                raise ModelError(message, hint="--resume goes on with it; delete it to begin anew")
            loop.run(**ends, out=out, belongs_to=identity, progress=True)
        else:
            loop.run(**ends, progress=True)
        bar.say("writing")
        results = loop.results(threads=words["threads"], record=record, all_weights=all_weights)
        with output(out, KIND) as part:
            write(results, part)
        if save_frozen is not None:
            loop.network(frozen=True).save(save_frozen)
        if learns:
            checkpoint.remove()
    return results, loop


def summary(log: Log) -> str:
    """Return what came of the episodes, in a line."""
    if not len(log):
        return "no episode ended"
    n = min(len(log), 100)
    solved = {None: "", False: "; not reached", True: "; reached"}[log.solved]
    return f"{len(log):,} episodes, {log.steps[-1]:,} steps; mean return of the last {n}: {log.mean(n):g}{solved}"


def _left(loop: ClosedLoop, out: Path, learns: bool) -> str:
    """Say what an interrupted run has left."""
    if learns and Path(f"{out}.training").exists():
        return f"{loop.steps:,} steps; the same command with --resume goes on from the last whole block"
    return f"{out} is not written"
