"""Read a script of PyNN as a network. The script runs in its own process and simulates nothing."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

from neuro import ModelError, Network, load
from neuro.apps import Quantity, Where, check, existing, needed, only_on_linux
from neuro_exchange.pynn.report import Damaged, Failure, Report, printable
from neuro_exchange.verdict import APPROXIMATE, Verdict, Verdicts

__all__ = ["from_pynn"]

_MARK = "NEURO_SCRIPT"
_MOST_BESIDE = 5_000
"""Largest number of files beside a script that the script can read."""
_ARGUMENTS = re.compile(r"get_simulator|get_script_args|sys\.argv|ArgumentParser")
_SECONDS = Quantity(unit="s", above=0, at_most=86_400)
_MEMORY = Quantity(above=0, at_most=4096)
_NUMBER = Quantity(kind="integer", at_least=1)
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def from_pynn(
    script: str | os.PathLike[str],
    *,
    run_script: bool = False,
    arguments: Sequence[str] | None = None,
    network: int | None = None,
    seconds: float = 120.0,
    memory: float = 4.0,
) -> Network:
    """Return the network that a script of PyNN builds, for any simulator.

    The script runs in its own process, in which each simulator of PyNN is a recorder: nothing is simulated, and results
    that the script reads are empty. The script may read files, and write into a temporary folder. The script may not
    start programs, use the network or write elsewhere. Random connections, parameters and initial values are those that
    the script draws.

    Args:
        script: name of the script.
        run_script: allow running the script. Without this permission, the function raises an error.
        arguments: command-line arguments of the script. Default for a script that reads arguments: the name of a
            simulator, "spiNNaker" if the script uses `extra_models`, else "nest".
        network: number of the network, from 1, if the script builds several; default: the last.
        seconds: time limit in seconds.
        memory: memory limit in GiB.

    Returns:
        The network. Its `verdicts` name the duration of the script's run, and differences between PyNN and here by
        line.

    Raises:
        ModelError: the script may not be run, fails, exceeds a limit, builds no network, or has parts that cannot be
            converted. The error lists the lines of all such parts.
    """
    path = existing(script, "a script of PyNN")
    if not run_script:
        raise ModelError(
            f"{path}: is a program: only running it shows its network",
            hint="--run-script (in Python run_script=True) runs it in its own process, without simulating",
        )
    needed("pyNN", "pynn", "reading a script of PyNN needs PyNN, which is not installed")
    if arguments is None:
        text = path.read_text("utf-8", "replace")
        arguments = ["spiNNaker" if "extra_models" in text else "nest"] if _ARGUMENTS.search(text) else []
    limits = {"seconds": check(_SECONDS, seconds, "seconds"), "memory": int(check(_MEMORY, memory, "memory") * 2**30)}
    chosen = None if network is None else check(_NUMBER, network, "network")
    with _folder(path) as folder:
        report = _run({"script": str(path.resolve()), "arguments": list(arguments), **limits}, folder)
        return _network(path, report, folder / "networks", chosen)


def _network(path: Path, report: Report, folder: Path, number: int | None) -> Network:
    failure, networks = report.failure, report.networks
    if failure and not failure.harmless:
        where = Where(path.name, failure.line)
        raise ModelError(f"the script fails: {failure.message}", where=where, hint=_HINTS.get(failure.kind, ""))
    if not networks:
        raise ModelError(f"{path.name}: builds no network", hint="make at least one population of PyNN")
    if number is not None and number > len(networks):
        raise ModelError(f"network = {number}: expected at most {len(networks)}, the networks of {path.name}")
    built = networks[-1 if number is None else number - 1]
    if built.problems:
        other_errors = tuple(ModelError(remark.message, where=remark.where) for remark in built.problems)
        count = f"{len(other_errors)} problem" + "s" * (len(other_errors) > 1)
        raise ModelError(f"{path.name}: the network cannot be converted ({count})", others=other_errors)
    if not _are_plain_files(folder):
        raise ModelError(f"{path.name}: the script fails: it replaced the files of its network")
    net = load(folder / built.file)
    net.inputs = ()
    runs, heading = built.runs, [path.name]
    if runs:
        times = ", ".join(f"{ms:g}" for ms in runs[:5]) + (", ..." if len(runs) > 5 else "")
        heading.append(f"runs for {sum(runs):g} ms" + (f" ({times})" if len(runs) > 1 else ""))
    if len(networks) > 1:
        lines = ", ".join(str(entry.line) for entry in networks)
        network_text = "the last" if number is None else f"number {number}"
        heading.append(f"builds {len(networks)} networks, at lines {lines}: this is {network_text}")
    if built.notes:
        heading.append("spikes are not compared, since the script is not simulated")
    notes = [(f"{note.file}:{note.line}" if note.file else path.name, note.message) for note in built.notes]
    if failure:
        how = f"the script fails after reading results, which are empty here: {failure.message}"
        notes.append((f"{path.name}:{failure.line}", how))
    net.verdicts = Verdicts("; ".join(heading), tuple(Verdict(place, "line", APPROXIMATE, how) for place, how in notes))
    return net


def _are_plain_files(folder: Path) -> bool:
    """Return whether this is a folder that contains only files: no folders, links or pipes."""
    if not stat.S_ISDIR(folder.lstat().st_mode):
        return False
    with os.scandir(folder) as entries:
        return all(entry.is_file(follow_symlinks=False) for entry in entries)


_HINTS = {
    "memory": "--memory sets the limit",
    "refused": "a script may only describe a network",
    "time": "--seconds sets the limit",
}


# -- the process -----------------------------------------------------------------------------------------------------


@contextmanager
def _folder(script: Path) -> Iterator[Path]:
    """Make a temporary folder in which the script runs, with links to the files beside the script."""
    folder = Path(tempfile.mkdtemp(prefix="neuro-script-"))
    try:
        (folder / "networks").mkdir()
        _mirror(script.resolve().parent, folder / "files")
        (folder / "files" / script.name).unlink(missing_ok=True)
        shutil.copyfile(script, folder / "files" / script.name)
        yield folder
    finally:
        with suppress(OSError):
            _flatten(folder)
        shutil.rmtree(folder, ignore_errors=True)


def _flatten(top: Path) -> None:
    """Remove all folders in a folder. Their depth may exceed the limits of paths and of recursion."""
    mark, number = uuid4().hex, itertools.count()
    while folders := [entry.path for entry in os.scandir(top) if entry.is_dir(follow_symlinks=False)]:
        for folder in folders:
            os.chmod(folder, 0o700)
            for entry in os.scandir(folder):
                if entry.is_dir(follow_symlinks=False):
                    os.chmod(entry.path, 0o700)
                    os.rename(entry.path, top / f"{mark}{next(number)}")
                else:
                    os.unlink(entry.path)
            os.rmdir(folder)


def _mirror(source: Path, target: Path) -> None:
    target.mkdir()
    count = 0
    for root, folders, files in os.walk(source):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        inside = target / os.path.relpath(root, source)
        inside.mkdir(exist_ok=True)
        for name in sorted(files):
            count += 1
            if count > _MOST_BESIDE:
                return
            (inside / name).symlink_to(Path(root) / name)


def _run(job: dict[str, Any], folder: Path) -> Report:
    """Run a script, and end all its processes.

    The report and the printed text are files without a name, so the script cannot replace them.

    Args:
        job: the script, its arguments, and its limits in seconds and bytes.
        folder: the folder of `_folder`.
    """
    only_on_linux("running a script of PyNN")
    mark = uuid4().hex
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as report:
        secret = re.compile("TOKEN|SECRET|PASSWORD|KEY")
        environment = {name: value for name, value in os.environ.items() if not secret.search(name)}
        paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        environment |= {
            "PYTHONPATH": paths,
            "MPLBACKEND": "Agg",
            "PYTHONHASHSEED": "0",
            "TMPDIR": str(folder / "files"),
            _MARK: mark,
        }
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "neuro_exchange.pynn.confined"],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=environment | dict.fromkeys(_THREADS, "1"),
            start_new_session=True,
            pass_fds=[report.fileno()],
        )
        assert process.stdin is not None
        try:
            job |= {"parent": os.getpid(), "folder": str(folder), "report": report.fileno()}
            with suppress(BrokenPipeError):
                process.stdin.write(json.dumps(job).encode())
                process.stdin.close()
            code = process.wait(job["seconds"])
        except subprocess.TimeoutExpired:
            return _failed(f"exceeds the limit of {job['seconds']:g} s", "time")
        finally:
            _end(process, mark)
        try:
            return Report.read(report) or _report_of_exit(code, output, job["seconds"])
        except Damaged as error:
            return _failed(f"its report is damaged: {error}", "")


def _end(process: subprocess.Popen[bytes], mark: str) -> None:
    """End the process and all descendants, also processes that left the process group."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    entry = f"{_MARK}={mark}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if entry in (folder / "environ").read_bytes().split(b"\0"):
                os.kill(int(folder.name), signal.SIGKILL)


def _report_of_exit(code: int, output: BinaryIO, seconds: float) -> Report:
    """Return the report of a process that wrote no report, from the exit code and the printed text."""
    if code == -signal.SIGXCPU:
        return _failed(f"exceeds the limit of {seconds:g} s", "time")
    names = {s.value: s.name for s in signal.Signals}
    ending = f"is ended by {names.get(-code, f'signal {-code}')}" if code < 0 else f"ends with {code}"
    size = os.fstat(output.fileno()).st_size
    printed = os.pread(output.fileno(), 2000, max(0, size - 2000)).decode("utf-8", "replace")
    text = printable(printed.strip().rpartition("\n")[2])
    if "MemoryError" in text:
        return _failed("exceeds the memory limit", "memory")
    return _failed(f"its process {ending} before its network is complete" + (f": {text[:200]}" if text else ""), "")


def _failed(message: str, kind: str) -> Report:
    return Report(failure=Failure(message, kind=kind))
