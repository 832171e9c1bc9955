"""What a script of PyNN cannot do: to what reads its report, to other files, processes and machines."""

import ctypes
import os
import platform
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

import neuro
from neuro.cli.commands import app
from neuro_exchange.pynn import kernel
from neuro_exchange.pynn.report import MOST_BYTES, BuiltNetwork, Damaged, Failure, Remark, Report

TRIED = yaml.safe_load(Path(__file__).with_name("confined.yaml").read_text("utf-8"))

pytest.importorskip("pyNN", reason="PyNN is not installed")
needs_filter = pytest.mark.skipif(
    kernel._seccomp() is None or platform.machine() != "x86_64",
    reason="pyseccomp or libseccomp.so.2 is missing, or the numbers of calls are others",
)

BEGIN = """import pyNN.nest as sim
sim.setup(timestep=0.1)
p = sim.Population(3, sim.IF_curr_exp(), label="cells")
sim.run(10.0)
"""


@pytest.fixture
def outside(tmp_path):
    """A folder beside that of the script, with a network in it."""
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "secret.yaml").write_text(
        "neuro: 1\nname: secret\nresolution: 1.0\npopulations:\n  a: {model: parrot_neuron}\n"
    )
    return folder


@pytest.fixture
def failure(tmp_path):
    """Run a script by the command; the one line in which it ends, without the script's name."""

    def run(code, seconds=60):
        folder = tmp_path / "scripts"
        folder.mkdir(exist_ok=True)
        path = folder / "script.py"
        path.write_text(BEGIN + code)
        out = tmp_path / "out.yaml"
        words = ["convert", str(path), str(out), "--run-script", "--seconds", str(seconds)]
        error = CliRunner().invoke(app, words).exception
        if error is None:
            return ""
        assert type(error) is neuro.ModelError
        assert not out.exists()
        return error.alone().replace("script.py:", "").strip()

    return run


# -- the report


FORGED = """
import json, os
text = json.dumps({"networks": [{"file": FILE, "problems": [], "notes": [], "runs": [], "line": 1}], "failure": None})
def write(text):
    for name in os.listdir("/proc/self/fd"):
        if int(name) > 2:
            try:
                os.write(int(name), text.encode())
            except OSError:
                pass
"""
LONG = """
for name in os.listdir("/proc/self/fd"):
    if int(name) > 2 and os.path.exists(f"/proc/self/fd/{name}"):
        try:
            os.truncate(int(name), 2**29)
        except OSError:
            pass
os._exit(0)
"""
DAMAGED = "its report is damaged: "
REPORTS = {
    "open('../outcome.json', 'w').write(text); os._exit(0)": "its process ends with 0 before its network is complete",
    "write(text); os._exit(0)": f"{DAMAGED}networks[0].file = FILE: expected a number and .yaml, or problems",
    "write('[' * 10**6); os._exit(0)": f"{DAMAGED}no JSON",
    "write('[]'); os._exit(0)": f"{DAMAGED}report: expected failure, networks",
    LONG: f"{DAMAGED}536,870,912 bytes: expected at most 67,108,864",
}


@pytest.mark.parametrize(
    "code", [pytest.param(c, marks=[pytest.mark.slow] if k != 1 else []) for k, c in enumerate(REPORTS)]
)
def test_a_forged_report_is_refused(failure, outside, code):
    file = repr(str(outside / "secret.yaml"))
    expected = f"the script fails: {REPORTS[code].replace('FILE', file)}"
    assert failure(FORGED.replace("FILE", file) + code).endswith(expected)


REPLACED = {
    "os.remove('../networks/0.yaml'); os.symlink('OUTSIDE/secret.yaml', '../networks/0.yaml')": "",
    "os.rename('../networks', '../others'); os.symlink('OUTSIDE', '../networks')": "",
    "os.remove('../networks/0.yaml'); os.mkfifo('../networks/0.yaml')": "PermissionError",
    "os.remove('../networks/0.yaml'); os.symlink('/dev/zero', '../networks/0.yaml')": "",
}


@pytest.mark.parametrize(
    "code", [pytest.param(c, marks=[pytest.mark.slow] if k else []) for k, c in enumerate(REPLACED)]
)
def test_networks_that_are_replaced_are_not_read(failure, outside, code):
    message = failure("sim.reset()\nimport os\n" + code.replace("OUTSIDE", str(outside)))
    assert (REPLACED[code] or "it replaced the files of its network") in message


@pytest.mark.slow
def test_a_report_that_is_a_pipe_or_without_end_is_not_read(failure):
    deep = "import os\nos.makedirs('a/b/c/d/e/f')\nos.chdir('a/b/c/d/e/f')\n"
    link = "os.symlink('../../../dev/zero', '../../../../../../../outcome.json')\nos._exit(0)"
    assert failure(deep + link, 10).endswith("its process ends with 0 before its network is complete")
    assert "Operation not permitted" in failure("import os; os.mkfifo('../outcome.json'); os._exit(0)", 10)


def reread(tmp_path, content):
    with (tmp_path / "report").open("wb+") as file:
        file.write(content)
        file.flush()
        return Report.read(file)


def test_a_report_comes_back_as_it_was_written(tmp_path):
    notes = (Remark("script.py", 3, "rounded"), Remark("", 0, "ohne Ort: \u00e4"))
    report = Report(
        (BuiltNetwork("0.yaml", (), notes, (10.0, 2.5), 2), BuiltNetwork("", notes, (), (), 0)),
        Failure("ends", 4, True, "x"),
    )
    with (tmp_path / "report").open("wb+") as file:
        report.write(os.dup(file.fileno()))
        assert Report.read(file) == report
    assert reread(tmp_path, b"") is None


def test_a_report_of_another_form_is_refused(tmp_path, messages):
    text = '{"networks": [{"file": "0.yaml", "problems": [], "notes": [], "runs": [], "line": 1}], "failure": null}'
    assert reread(tmp_path, text.encode()).networks[0].file == "0.yaml"
    said = {}
    for old, new in TRIED["reports"]:
        with pytest.raises(Damaged) as error:
            reread(tmp_path, text.replace(old, new, 1).encode("latin-1"))
        said[f"{old} -> {new}"] = str(error.value)
    messages(said)


def test_a_report_that_is_too_long_is_refused(tmp_path):
    with (tmp_path / "report").open("wb+") as file:
        file.truncate(MOST_BYTES + 1)
        with pytest.raises(Damaged, match="67,108,865 bytes: expected at most 67,108,864"):
            Report.read(file)


def test_a_report_does_not_steer_a_terminal(tmp_path):
    text = '{"networks": [], "failure": {"message": "a\\u001b[2Jb\\nc", "line": 0, "harmless": false, "kind": ""}}'
    assert reread(tmp_path, text.encode()).failure.message == "a [2Jb c"


# -- what the kernel refuses


LIBC = """
import ctypes, errno, os, threading
maps = open("/proc/self/maps").read().splitlines()
base = min(int(line.partition("-")[0], 16) for line in maps if line.endswith(LIBRARY))
types = [ctypes.c_long] * 7
libc = ctypes.CFUNCTYPE(ctypes.c_long, *types, use_errno=True)(base + OFFSET)
def call(*arguments):
    buffers = [ctypes.create_string_buffer(a) if isinstance(a, bytes) else None for a in arguments]
    words = [ctypes.addressof(b) if b is not None else a for a, b in zip(arguments, buffers)]
    ctypes.set_errno(0)
    answer = libc(*words, *[0] * (7 - len(words)))
    if answer == 0 and arguments[0] in (56, 57, 58):
        os._exit(0)
    return errno.errorcode.get(ctypes.get_errno(), "done") if answer < 0 else "done"
"""
LINKED = """
def answers():
    return {name: call(*arguments) for name, arguments in CALLS.items()}
inside = {}
thread = threading.Thread(target=lambda: waited.wait() and inside.update(answers()))
waited = threading.Event()
thread.start()
secret = os.open(SECRET, os.O_RDONLY)
CALLS = {NAMED}
here = answers()
waited.set()
thread.join()
wrong = {name: (answer, inside[name]) for name, answer in here.items() if (answer, inside[name]) != ("EPERM", "EPERM")}
assert not wrong, wrong
assert call(435, bytes(88), 88) == "ENOSYS"
"""


def through_libc(code):
    """A script that calls the function `syscall` of the C library by its address, which hooks of Python do not see."""
    address = ctypes.cast(ctypes.CDLL(None).syscall, ctypes.c_void_p).value
    lines = [line.split() for line in Path("/proc/self/maps").read_text().splitlines()]
    at = ((int(edge, 16) for edge in line[0].split("-")) for line in lines)
    library = next(line[-1] for line, (low, high) in zip(lines, at, strict=True) if low <= address < high)
    base = min(int(line[0].partition("-")[0], 16) for line in lines if line[-1] == library)
    return LIBC.replace("LIBRARY", repr(library)).replace("OFFSET", str(address - base)) + code


@needs_filter
def test_the_kernel_refuses_calls_of_the_c_library_in_all_threads(failure, outside):
    secret = outside / "secret.yaml"

    def state():
        status = secret.stat()
        return status.st_mode, status.st_uid, status.st_mtime_ns, status.st_ctime_ns

    before = state()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.setblocking(False)
        victim = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
        try:
            address = b"\x02\x00" + heard.getsockname()[1].to_bytes(2, "big") + b"\x7f\x00\x00\x01" + bytes(8)
            named = ", ".join(f"{name!r}: ({arguments},)" for name, arguments in TRIED["calls"].items())
            named = named.replace("ADDRESS", repr(address)).replace("VICTIM", str(victim.pid))
            code = LINKED.replace("{NAMED}", "{" + named + "}").replace("SECRET", repr(os.fsencode(secret)))
            assert failure(through_libc(code)) == ""
            assert victim.poll() is None
        finally:
            victim.communicate(b"\n")
        assert victim.returncode == 0
        with pytest.raises(BlockingIOError):
            heard.recv(1)
    assert state() == before


@pytest.mark.skipif(kernel._landlock() < kernel._OLDEST, reason="the kernel has no Landlock as of Linux 6.2")
def test_the_kernel_refuses_files_outside(failure, outside):
    secret = outside / "secret.yaml"
    before = secret.read_text()
    named = ", ".join(f"{name!r}: ({arguments},)" for name, arguments in TRIED["files"].items())
    named = named.replace("SECRET", repr(os.fsencode(secret))).replace("FOLDER", repr(os.fsencode(outside)))
    code = "answers = {name: call(*words) for name, words in {" + named + "}.items()}\n"
    check = "wrong = {name: answer for name, answer in answers.items() if answer not in ('EACCES', 'EXDEV')}\n"
    assert failure(through_libc(code + check + "assert not wrong, wrong")) == ""
    assert [(file.name, file.read_text()) for file in outside.iterdir()] == [("secret.yaml", before)]


INT_80 = """
import mmap
page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
page.write(bytes.fromhex("b814000000cd80c3"))  # mov eax, 20; int 0x80; ret
ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(page)))()
"""


@needs_filter
@pytest.mark.slow
@pytest.mark.parametrize("code", ["call(0x40000000 + 39)", INT_80])
def test_calls_of_other_architectures_end_the_script(failure, code):
    message = failure(through_libc(code))
    assert message.endswith("the script fails: its process is ended by SIGSYS before its network is complete")


@needs_filter
@pytest.mark.slow
def test_a_script_can_abort_itself(failure):
    assert "its process is ended by SIGABRT" in failure("import os\nos.abort()")
    assert "its process is ended by signal 40" in failure(
        "import os\n" + through_libc("call(234, os.getpid(), os.getpid(), 40)")
    )


@needs_filter
@pytest.mark.slow
def test_folders_deeper_than_any_recursion_are_removed(failure, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    code = "for k in range(3000):\n    call(83, b'd', 0o700)\n    call(80, b'd')\n"  # mkdir and chdir
    assert failure(through_libc(code + "assert call(83, b'closed', 0) == 'done'")) == ""
    assert not list(tmp_path.glob("neuro-script-*"))


@pytest.mark.slow
def test_a_mode_is_not_changed_by_an_open_file(failure, outside):
    code = f"import os\nos.fchmod(os.open({str(outside / 'secret.yaml')!r}, os.O_RDONLY), 0o777)"
    mode = (outside / "secret.yaml").stat().st_mode
    assert failure(code) == "6: the script fails: a script may not change the mode, owner or times of an open file"
    assert (outside / "secret.yaml").stat().st_mode == mode


ORDINARY = """
import asyncio, getpass, os, pathlib, shutil, sqlite3, tempfile, threading, uuid
from concurrent.futures import ThreadPoolExecutor
import h5py, numpy as np
import matplotlib.pyplot as plt
shutil.copy("script.py", "copy.py")
shutil.copy2("script.py", "copy2.py")
os.makedirs("a/b")
pathlib.Path("a/b/c").touch()
pathlib.Path("a/b/c").touch()
pathlib.Path("a/b/c").chmod(0o600)
shutil.copytree("a", "d")
with ThreadPoolExecutor(4) as pool:
    assert sum(pool.map(abs, range(10))) == 45
assert np.isfinite(np.linalg.svd(np.random.default_rng(1).random((200, 200)))[1]).all()
np.savez("a.npz", a=np.ones(3))
with h5py.File("a.h5", "w") as file:
    file["x"] = np.ones(3)
with tempfile.NamedTemporaryFile() as file:
    file.write(b"x")
base = sqlite3.connect("a.db")
base.execute("create table t (a)")
base.commit()
getpass.getuser(), uuid.uuid1()
plt.plot([1, 2])
plt.savefig("a.png")
os.rename("a.png", "b.png")
"""


def test_what_scripts_do_beside_networks_still_works(failure):
    assert failure(ORDINARY) == ""


def test_what_the_kernel_does_not_hold_is_said(tmp_path, monkeypatch):
    path = tmp_path / "script.py"
    path.write_text("")

    def warnings():
        words = ["convert", str(path), str(tmp_path / "out.yaml"), "--run-script", "--network", "0"]
        done = CliRunner().invoke(app, words)
        return [line for line in done.output.splitlines() if line.startswith("warning: ")]

    monkeypatch.setattr(kernel, "_landlock", lambda: 3)
    monkeypatch.setattr(kernel, "_seccomp", lambda: object())
    assert warnings() == []
    monkeypatch.undo()
    monkeypatch.setattr(kernel, "_landlock", lambda: 2)
    monkeypatch.setitem(sys.modules, "pyseccomp", None)
    assert warnings() == [
        "warning: only Python keeps the script from writing into other folders: the kernel lacks Landlock of Linux 6.2 "
        "or later",
        "warning: only Python keeps the script from starting processes, signals, sockets, and changing modes, owners "
        "and times of files: the filter of system calls needs pyseccomp and libseccomp.so.2 on x86_64 or aarch64",
    ]
