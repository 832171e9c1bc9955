"""Runs on a Dask cluster: its workers see the folder, and keep there what comes of each run.

What comes back from the cluster only says how runs ended, so a scheduler that is lost loses nothing. A worker does its
runs in a process of its own for each of its threads, see `neuro.sweeps.cores`, so limits hold there, too.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import local
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.extras import needed
from neuro.core.version import VERSION
from neuro.sweeps.cores import HINT, Cores, More, Tell
from neuro.sweeps.folder import Folder
from neuro.sweeps.space import RunItem

CONNECT_S = 20.0
MOST_AT_ONCE = 50
"""Runs of one task."""

_GONE = "the cluster at {} is gone"
_mine = local()


def on_cluster(where: str, folder: Folder, items: Sequence[RunItem], tell: Tell, more: More | None = None) -> None:
    """Do runs on the workers of a cluster.

    Args:
        where: the address of its scheduler, or the file that the scheduler writes.
        folder: of the sweep, which all workers must see.
        items: the runs.
        tell: hears of each when it is there.
        more: is asked for others whenever a worker has nothing to do.

    Raises:
        ModelError: Dask is not installed, there is no such cluster, it has no worker, or its workers have not this
            package in this version, or do not see the folder.
    """
    client = _client(where)
    try:
        workers = _checked(client, where, folder)
        size = max(1, min(MOST_AT_ONCE, len(items) // (4 * max(1, workers))))
        chunks = [list(items[k : k + size]) for k in range(0, len(items), size)]
        if more is not None:
            chunks += [[item] for item in more(max(1, workers))]
        _gather(client, where, folder, chunks, tell, more)
    finally:
        with suppress(Exception):
            client.close(timeout=2)


def _client(where: str) -> Any:
    dask = needed("distributed", "dask", f"on = '{where}': the package distributed is not installed")
    if "://" not in where and not Path(where).is_file():
        known = "cores, here, tcp://HOST:PORT, or the file of a scheduler"
        raise ModelError(f"on = '{where}': there is no such file: expected {known}")
    words = {"address": where} if "://" in where else {"scheduler_file": where}
    try:
        return dask.Client(**words, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        text = str(error) or type(error).__name__
        raise ModelError(f"on = '{where}': no scheduler answers: {text.splitlines()[0]}") from None


def _checked(client: Any, where: str, folder: Folder) -> int:
    """How many threads all workers have, once they are known to be able to do runs."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise ModelError(f"on = '{where}': the cluster has no worker") from None
    path, file = str(folder.path.absolute()), folder.holding.file

    def look() -> tuple[str, str, bool]:  # nested, so that it is sent by value: workers may not have this module
        import os

        try:
            from neuro.core.version import VERSION as there
        except ImportError as error:
            return "", f"{error} ({sys.executable})", False
        try:
            import neuro.sweeps.cluster  # noqa: F401
        except ImportError:
            return there, "", False
        return there, "", os.path.isfile(os.path.join(path, file))

    for address, (version, error, seen) in sorted(client.run(look).items()):
        if error:
            hint = "install this package where the workers run, in the version that is here"
            raise ModelError(f"the worker {address} has no neuro: {error}", hint=hint)
        if version != VERSION:
            raise ModelError(f"the worker {address} has neuro {version}: expected {VERSION}, as here")
        if not seen:
            message = f"the worker {address} does not see {path}"
            raise ModelError(message, hint="runs are kept in the folder: expected one that all machines share")
    return sum(client.nthreads().values())


def _gather(
    client: Any, where: str, folder: Folder, chunks: Sequence[list[RunItem]], tell: Tell, more: More | None
) -> None:
    dask, path = import_module("distributed"), str(folder.path.absolute())

    def submitted(chunk: Sequence[RunItem]) -> Any:
        plain = [(item.key, item.point, item.seed, item.trial) for item in chunk]
        return client.submit(do, path, plain, pure=False, retries=2)

    try:
        under_way = dask.as_completed([submitted(chunk) for chunk in chunks], loop=client.loop)
        for done in under_way:
            if done.status == "cancelled":
                raise ModelError(_GONE.format(where), hint=HINT)
            for key, failed in done.result():
                tell(key, failed)
            for item in more(1) if more is not None else ():
                under_way.add(submitted([item]))
    except ModelError:
        raise
    except Exception as error:
        kind = type(error).__name__
        if kind in ("CancelledError", "FutureCancelledError", "CommClosedError", "StreamClosedError", "TimeoutError"):
            raise ModelError(_GONE.format(where), hint=HINT) from None
        raise ModelError(f"the cluster at {where}: {kind}: {error}", hint=HINT) from None


def do(path: str, chunk: Sequence[tuple[str, dict[str, Any], int | None, int | None]]) -> list[tuple[str, bool]]:
    """What a worker of the cluster does: some runs, in a process of its own.

    Args:
        path: of the folder.
        chunk: hash, point, seed and trial of each run.

    Returns:
        The hash of each and whether it failed.
    """
    done: list[tuple[str, bool]] = []
    pool = _pool(path)
    try:
        pool.run([RunItem(*each) for each in chunk], lambda key, failed: done.append((key, failed)))
    except BaseException:
        pool.close()
        _mine.pool = None
        raise
    return done


def _pool(path: str) -> Cores:
    """The process of this thread for a folder."""
    held: Any = getattr(_mine, "pool", None)
    if held is None or _mine.path != path:
        if held is not None:
            held.close()
        _mine.pool, _mine.path = Cores(Folder(Path(path)), 1), path
    pool: Cores = _mine.pool
    return pool
