"""What the kernel of Linux refuses to the process of a script.

Landlock refuses to write files outside of a folder, and to start programs. A seccomp filter lets the system calls pass
that a script needs to build a network, and answers all others with EPERM: sockets, processes, signals to others, modes,
owners and times of files are not among these.

Source: Linux, Documentation/userspace-api/landlock.rst, Documentation/userspace-api/seccomp_filter.rst.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import sys
from importlib import import_module
from typing import Any

__all__ = ["hold", "not_held"]

_NO_NEW_PRIVILEGES = 38
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_OLDEST = 3
"""The version of Landlock, of Linux 6.2, that also refuses to truncate files."""
_MACHINES = ("x86_64", "aarch64")
"""Where the first argument of `clone` are its flags."""
_WRITE_FILE, _MAKE_SPECIAL = 1 << 1, 1 << 6 | 1 << 9 | 1 << 10 | 1 << 11

_CALLS = """
read write readv writev pread64 pwrite64 preadv pwritev preadv2 pwritev2 open openat openat2 creat close close_range
stat lstat fstat newfstatat statx access faccessat faccessat2 lseek getdents getdents64 getcwd chdir fchdir mkdir
mkdirat rmdir unlink unlinkat rename renameat renameat2 link linkat symlink symlinkat readlink readlinkat truncate
ftruncate fallocate fsync fdatasync sync_file_range statfs fstatfs copy_file_range sendfile dup dup2 dup3 pipe pipe2
flock fadvise64 readahead poll ppoll select pselect6 epoll_create epoll_create1 epoll_ctl epoll_wait epoll_pwait
epoll_pwait2 eventfd eventfd2 getxattr lgetxattr fgetxattr listxattr llistxattr flistxattr umask mmap munmap mprotect
mremap madvise msync mincore mlock munlock brk get_mempolicy membarrier futex futex_waitv futex_wait futex_wake
futex_requeue set_robust_list set_tid_address rseq sched_yield sched_getaffinity sched_getparam sched_getscheduler
sched_get_priority_max sched_get_priority_min getpriority clock_gettime clock_getres clock_nanosleep nanosleep
gettimeofday time times getitimer setitimer alarm timer_create timer_settime timer_gettime timer_getoverrun
timer_delete timerfd_create timerfd_settime timerfd_gettime pause rt_sigaction rt_sigprocmask rt_sigreturn
rt_sigpending rt_sigsuspend rt_sigtimedwait sigaltstack restart_syscall getpid getppid gettid getuid geteuid getgid
getegid getresuid getresgid getgroups getpgid getpgrp getsid uname sysinfo getrusage getrlimit setrlimit getcpu
getrandom wait4 waitid exit exit_group
"""
"""Calls that pass."""
_WITH_FIRST: dict[str, tuple[int, ...]] = {
    "prlimit64": (0,),  # of this process
    "sched_setaffinity": (0,),
    "prctl": (15, 16, 0x53564D41),  # the name of a thread, and of memory; not what ends it with its parent
}
"""Calls that pass with these values of their first argument."""
_WITH_SECOND = {
    "fcntl": (0, 1, 2, 3, 4, 5, 6, 7, 36, 37, 38, 1030, 1031, 1032),  # descriptors, flags, locks, sizes of pipes
    "ioctl": (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451),  # of terminals and pipes what is asked; flags
}
"""Calls that pass with these values of their second argument."""
_THREAD = 0x10000
_NOT_OF_A_THREAD = 0x7E023080  # new namespaces, ptrace, a new cgroup, a descriptor of the process
"""Flags of `clone`."""


def not_held() -> tuple[str, ...]:
    """What the kernel of this machine does not refuse to a script; one sentence each, none where it refuses all."""
    if sys.platform != "linux":
        return ()
    said = []
    if _landlock() < _OLDEST:
        said.append("a script is kept from other folders by Python alone: the kernel has no Landlock as of Linux 6.2")
    if _seccomp() is None:
        parts = "processes, signals, sockets, and from modes, owners and times of files"
        needs = f"pyseccomp and libseccomp.so.2 on {' or '.join(_MACHINES)}"
        said.append(f"a script is kept from {parts} by Python alone: the filter of system calls needs {needs}")
    return tuple(said)


def hold(folder: str) -> None:
    """Refuse from now on, in all threads to come, what a script does not need; for this process alone.

    Args:
        folder: where it may write.

    Raises:
        OSError: the kernel does not accept what it should refuse.
        RuntimeError: other threads run, which are not held.
    """
    if len(os.listdir("/proc/self/task")) > 1:
        raise RuntimeError("other threads run before the script begins")
    seccomp = _seccomp()  # first, since it starts a program to find its library
    if _landlock() > 0:
        _hold_files(folder, _landlock())
    if seccomp is not None:
        _hold_calls(seccomp)


def _hold_files(folder: str, version: int) -> None:
    """Refuse to write outside of a folder, to make devices, sockets and pipes in it, and to start programs.

    Also TCP and signals, as far as this version of Landlock knows of these.
    """
    changes = sum(1 << bit for bit in (1, 4, 5, 6, 7, 8, 9, 10, 11, 12))
    changes |= (1 << 13 if version >= 2 else 0) | (1 << 14 if version >= 3 else 0)
    handled = (ctypes.c_uint64 * 3)(changes | 1, 0b11 if version >= 4 else 0, 0b11 if version >= 6 else 0)
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    rules = _call("syscall", _CREATE_RULESET, ctypes.byref(handled), size, 0)
    for path, allowed in ((folder, changes & ~_MAKE_SPECIAL), (os.devnull, _WRITE_FILE)):
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        beneath = allowed.to_bytes(8, sys.byteorder) + place.to_bytes(4, sys.byteorder)
        _call("syscall", _ADD_RULE, rules, 1, beneath, 0)
        os.close(place)
    _call("prctl", _NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    _call("syscall", _RESTRICT_SELF, rules, 0)
    os.close(rules)


def _hold_calls(seccomp: Any) -> None:
    """Let only the listed system calls pass.

    `clone3`, whose flags a filter cannot see, is answered with ENOSYS, so that the C library takes `clone`, which
    passes for threads. Calls of other architectures end the process.
    """
    calls = seccomp.SyscallFilter(seccomp.ERRNO(errno.EPERM))
    calls.set_attr(seccomp.Attr.ACT_BADARCH, seccomp.KILL_PROCESS)
    calls.set_attr(seccomp.Attr.CTL_TSYNC, 1)

    def answer(action: int, name: str, *arguments: Any) -> None:
        number = seccomp.resolve_syscall(seccomp.Arch.NATIVE, name)
        if number >= 0:  # this architecture, and this version of the library, has the call
            calls.add_rule(action, number, *arguments)

    for name in _CALLS.split():
        answer(seccomp.ALLOW, name)
    for position, table in enumerate((_WITH_FIRST, _WITH_SECOND)):
        for name, values in table.items():
            for value in values:
                answer(seccomp.ALLOW, name, seccomp.Arg(position, seccomp.EQ, value))
    answer(seccomp.ALLOW, "tgkill", seccomp.Arg(0, seccomp.EQ, os.getpid()))  # as abort() does
    thread = seccomp.Arg(0, seccomp.MASKED_EQ, _THREAD | _NOT_OF_A_THREAD, _THREAD)
    answer(seccomp.ALLOW, "clone", thread)
    answer(seccomp.ERRNO(errno.ENOSYS), "clone3")
    calls.load()


def _landlock() -> int:
    """The version of Landlock that the kernel has; below 1 none."""
    return int(ctypes.CDLL(None).syscall(_CREATE_RULESET, None, 0, 1))


def _seccomp() -> Any:
    """The module pyseccomp, or None."""
    if platform.machine() not in _MACHINES:
        return None
    try:
        return import_module("pyseccomp")
    except (ImportError, RuntimeError):  # not installed, or without the library that it calls
        return None


def _call(name: str, *arguments: Any) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    answer = int(getattr(libc, name)(*arguments))
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return answer
