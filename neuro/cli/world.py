"""`neuro run` for a network with a section `world`."""

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
    **settings: Any,
) -> tuple[Results, ClosedLoop]:
    """Run the closed loop and write its results: all episodes, and the spikes of the last block.

    Args:
        net: the network.
        out: file of the results.
        ends: limits of the run, `steps`, `episodes` and `until` of `ClosedLoop.run`.
        frozen: True to run without learning.
        resume: True to continue an unfinished run.
        record: names of the populations whose spikes are written; all if empty.
        all_weights: True to write all weights, as in `collect`.
        save_frozen: file of the network with its learnt weights as static synapses; None for no file.
        compiling: function that returns a context for the compilation, see `neuro.cli.run.approximations`.
        settings: further arguments of `closed_loop`.

    Raises:
        ModelError: the loop cannot be built or continued, or `out` has an unfinished run and `resume` is False.
    """
    from neuro.cli.options import stoppable
    from neuro.core.errors import ModelError
    from neuro.core.outputs import output
    from neuro.core.system import shared
    from neuro.files.results import KIND, write
    from neuro.realtime.closed_loop import closed_loop
    from neuro.run.collect import files_of

    if shared():
        raise ModelError(
            "found several processes of mpirun: expected one process for a network with a world",
            hint="--copies N runs several copies of the world",
        )
    learns = not frozen
    with stoppable(lambda: _state_of_output(loop, out, learns)) as bar:
        bar.say("preparing")
        with compiling():
            loop = closed_loop(net, learns=learns, record=True, **settings)
        if learns:
            import hashlib

            digest = hashlib.blake2b(b"".join(files_of(net).values()), digest_size=16).hexdigest()
            identity = {"network": digest, "backend": settings["backend"], "threads": settings["threads"]}
            checkpoint = loop.checkpoint(out, identity)
            if checkpoint.path.exists() and not resume:
                message = f"{checkpoint.path} has an unfinished run"
                raise ModelError(message, hint="--resume continues the run; delete the file to start again")
            loop.run(**ends, out=out, belongs_to=identity, progress=True)
        else:
            loop.run(**ends, progress=True)
        bar.say("writing")
        results = loop.results(threads=settings["threads"], record=record, all_weights=all_weights)
        with output(out, KIND) as part:
            write(results, part)
        if save_frozen is not None:
            loop.network(frozen=True).save(save_frozen)
        if learns:
            checkpoint.remove()
    return results, loop


def summary(log: Log) -> str:
    """Return a line with the numbers of episodes and steps, and the mean return of the last 100 episodes."""
    if not len(log):
        return "no episode ended"
    n = min(len(log), 100)
    solved = {None: "", False: "; not reached", True: "; reached"}[log.solved]
    return f"{len(log):,} episodes, {log.steps[-1]:,} steps; mean return of the last {n}: {log.mean(n):g}{solved}"


def _state_of_output(loop: ClosedLoop, out: Path, learns: bool) -> str:
    """Describe the results and the checkpoint that an interrupted run has written."""
    if learns and Path(f"{out}.training").exists():
        return f"{loop.steps:,} steps; the same command with --resume continues from the last complete block"
    return f"{out} is not written"
