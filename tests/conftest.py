"""Fixtures for all tests."""

import gc
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import settings

from golden_messages import Messages, messages_of

# How long an example takes depends on what else the machine does: a deadline fails tests of right code.
settings.register_profile("suite", deadline=None)
settings.load_profile("suite")

# NEST's threads wait for each other at each step: where others use the cores, to spin meanwhile takes minutes.
os.environ |= {"OMP_WAIT_POLICY": "passive", "GOMP_SPINCOUNT": "0"}

# The width of tables in a pipe follows COLUMNS, which processes of pytest-xdist have from their terminal.
os.environ.pop("COLUMNS", None)

# Started in the background, all programs that the tests start would not hear Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Tests and their modules stay, so garbage is not looked for among them: that takes seconds."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bounds", action="store_true", help="compile kernels that look at every index; slow")
    parser.addoption("--renew-golden", action="store_true", help="run ../shared/reference anew into tests/golden")
    parser.addoption("--renew-messages", action="store_true", help="write tests/messages.yaml anew; not with -n")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--bounds"):
        from neuro.kernels.numba_internals import check_bounds

        check_bounds()


@pytest.fixture(scope="session", autouse=True)
def progress_is_not_told() -> None:
    """What a test hears on stderr does not depend on how fast the machine is; tests of progress set it themselves."""
    from neuro.core import progress

    progress.EVERY_S = float("inf")


@pytest.fixture
def frozen_heap() -> Iterator[None]:
    """What all tests before left is neither looked at nor freed in this test: it takes a collection seconds."""
    with pytest.MonkeyPatch.context() as patch:
        gc.freeze()
        patch.setattr(gc, "unfreeze", lambda: None)
        yield
    gc.unfreeze()


SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session", autouse=True)
def compiling_is_not_told() -> None:
    """What a test hears on stderr does not depend on whether an earlier run kept the kernels."""
    from neuro.kernels import compile_report

    os.environ[compile_report.REPORTED] = "1"


@pytest.fixture(scope="session", autouse=True)
def small_networks_are_shared_by_threads() -> None:
    """The networks of tests are too small to be worth it, and threads are what some of them are about."""
    from neuro_event.building import thread_partition

    thread_partition.WORTH_MEETING = 0


@pytest.fixture(scope="session")
def nest() -> None:
    """NEST, where there is one: its wheels are for Linux only."""
    if find_spec("nest") is None:
        pytest.skip("NEST is not installed: pip install nest-simulator")


@pytest.fixture(scope="session")
def torch() -> None:
    """torch, where there is one: its wheels are large."""
    if find_spec("torch") is None:
        pytest.skip("torch is not installed: pip install torch")


@pytest.fixture
def own_nest(nest: None) -> Iterator[Any]:
    """NEST for a network of its own, which is gone afterwards: a process has one."""
    import nest as simulator

    simulator.ResetKernel()
    simulator.verbosity = simulator.VerbosityLevel.ERROR
    yield simulator
    simulator.ResetKernel()


@pytest.fixture(scope="session")
def shared() -> Path:
    """Data and reference traces beside the repository."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    return SHARED


@pytest.fixture(scope="session")
def golden() -> Path:
    """Golden traces, which our own run wrote when it was equal to other simulators; see `golden_traces`."""
    return Path(__file__).with_name("golden")


@pytest.fixture
def registries(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test registers, also by files that it runs and that begin with my_, is forgotten."""
    from neuro.core import extension, registry

    for room in registry._REGISTRY_MODULES:
        import_module(room)
    for one in registry._REGISTRIES:
        for name in ("_parts", "_registered"):
            monkeypatch.setattr(one, name, dict(getattr(one, name)))
        monkeypatch.setattr(one, "_closed_by", "")
    monkeypatch.setattr(extension, "_run", {})
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    for name in [name for name in sys.modules if name.startswith("my_")]:
        del sys.modules[name]


@pytest.fixture
def messages(request: pytest.FixtureRequest) -> Messages:
    """Compare messages by case with those of this test in tests/messages.yaml."""
    return messages_of(request)


class Answer(NamedTuple):
    """What a command left: exit status, standard output and error."""

    status: int
    out: str
    err: str


@pytest.fixture(scope="session")
def status_of() -> Callable[..., int]:
    """Run `neuro` with some words in this process; its exit status."""
    from neuro.cli import main

    def run(*words: object) -> int:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["neuro", *map(str, words)])
            with pytest.raises(SystemExit) as leaving:
                main()
        code: Any = leaving.value.code
        return code or 0

    return run


@pytest.fixture
def answer(status_of: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Run `neuro` with some words in this process; its exit status and what it printed."""

    def run(*words: object) -> Answer:
        capsys.readouterr()
        return Answer(status_of(*words), *capsys.readouterr())

    return run


@pytest.fixture
def run(status_of: Callable[..., int]) -> Callable[..., None]:
    """Run `neuro` with some words in this process, which must end with a status."""

    def run(*words: object, status: int = 0) -> None:
        assert status_of(*words) == status

    return run


@pytest.fixture
def browser(tmp_path: Path) -> Callable[..., tuple[str, list[str]]]:
    """Run Chromium without a window; what it printed, and the lines of its console."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
    if program is None:
        pytest.skip("no Chromium on PATH")

    def run(*words: str) -> tuple[str, list[str]]:
        fixed = ("--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}")
        quiet = ("--no-first-run", "--disable-background-networking", "--disable-sync", "--hide-scrollbars")
        log = ("--enable-logging=stderr", "--v=0")
        done = subprocess.run([program, *fixed, *quiet, *log, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]

    return run


@pytest.fixture
def chromium(browser: Callable[..., tuple[str, list[str]]]) -> Callable[..., str]:
    """Run Chromium without a window and without a word on its console; what it printed."""

    def run(*words: str) -> str:
        printed, console = browser(*words)
        assert console == []
        return printed

    return run
