"""Restrictions that the Linux kernel applies to the process that runs a script.

Landlock refuses to write files outside of a folder, and to start programs. A seccomp filter allows only the system
calls that building a network needs. All other calls fail with EPERM, e.g. calls for sockets, for processes, for signals
to other processes, and for modes, owners and times of files.

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

__all__ = ["missing_restrictions", "restrict"]

_NO_NEW_PRIVILEGES = 38
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_OLDEST = 3
"""Oldest sufficient version of Landlock (Linux 6.2), which can refuse to truncate files."""
_MACHINES = ("x86_64", "aarch64")
"""Architectures on which the flags of `clone` are its first argument."""
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
"""Allowed system calls."""
_WITH_FIRST: dict[str, tuple[int, ...]] = {
    "prlimit64": (0,),  # of this process
    "sched_setaffinity": (0,),
    "prctl": (15, 16, 0x53564D41),  # names of threads and of memory, but not the parent-death signal
}
"""System calls that are allowed with these values of their first argument."""
_WITH_SECOND = {
    "fcntl": (0, 1, 2, 3, 4, 5, 6, 7, 36, 37, 38, 1030, 1031, 1032),  # descriptors, flags, locks, sizes of pipes
    "ioctl": (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451),  # queries of terminals and pipes; flags
}
"""System calls that are allowed with these values of their second argument."""
_THREAD = 0x10000
_NOT_OF_A_THREAD = 0x7E023080  # new namespaces, ptrace, a new cgroup, a descriptor of the process
"""Flags of `clone`."""


def missing_restrictions() -> tuple[str, ...]:
    """Return a warning for each restriction that the kernel of this machine lacks."""
    if sys.platform != "linux":
        return ()
    warnings = []
    if _landlock() < _OLDEST:
        reason = "the kernel lacks Landlock of Linux 6.2 or later"
        warnings.append(f"only Python keeps the script from writing into other folders: {reason}")
    if _seccomp() is None:
        actions = "starting processes, signals, sockets, and changing modes, owners and times of files"
        reason = f"the filter of system calls needs pyseccomp and libseccomp.so.2 on {' or '.join(_MACHINES)}"
        warnings.append(f"only Python keeps the script from {actions}: {reason}")
    return tuple(warnings)


def restrict(folder: str) -> None:
    """Restrict this process and its future threads to the actions that a script needs.

    Args:
        folder: folder in which the process may write.

    Raises:
        OSError: the kernel does not accept the restrictions.
        RuntimeError: other threads run, to which the restrictions would not apply.
    """
    if len(os.listdir("/proc/self/task")) > 1:
        raise RuntimeError("other threads run before the script begins")
    seccomp = _seccomp()  # first, since the import starts a program to find the library
    if _landlock() > 0:
        _restrict_files(folder, _landlock())
    if seccomp is not None:
        _restrict_calls(seccomp)


def _restrict_files(folder: str, version: int) -> None:
    """Refuse to write outside of a folder, to make devices, sockets and pipes inside, and to start programs.

    TCP and signals are refused as well, if the version of Landlock supports them.
    """
    changes = sum(1 << bit for bit in (1, 4, 5, 6, 7, 8, 9, 10, 11, 12))
    changes |= (1 << 13 if version >= 2 else 0) | (1 << 14 if version >= 3 else 0)
    handled = (ctypes.c_uint64 * 3)(changes | 1, 0b11 if version >= 4 else 0, 0b11 if version >= 6 else 0)
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    rules = _call("syscall", _CREATE_RULESET, ctypes.byref(handled), size, 0)
    for path, allowed in ((folder, changes & ~_MAKE_SPECIAL), (os.devnull, _WRITE_FILE)):
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
        beneath = allowed.to_bytes(8, sys.byteorder) + descriptor.to_bytes(4, sys.byteorder)
        _call("syscall", _ADD_RULE, rules, 1, beneath, 0)
        os.close(descriptor)
    _call("prctl", _NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    _call("syscall", _RESTRICT_SELF, rules, 0)
    os.close(rules)


def _restrict_calls(seccomp: Any) -> None:
    """Allow only the listed system calls.

    A filter cannot read the flags of `clone3`. So `clone3` fails with ENOSYS, and the C library uses `clone`, which is
    allowed for threads. Calls of other architectures end the process.
    """
    calls = seccomp.SyscallFilter(seccomp.ERRNO(errno.EPERM))
    calls.set_attr(seccomp.Attr.ACT_BADARCH, seccomp.KILL_PROCESS)
    calls.set_attr(seccomp.Attr.CTL_TSYNC, 1)

    def answer(action: int, name: str, *arguments: Any) -> None:
        number = seccomp.resolve_syscall(seccomp.Arch.NATIVE, name)
        if number >= 0:  # below 0 if the architecture or the library lacks the call
            calls.add_rule(action, number, *arguments)

    for name in _CALLS.split():
        answer(seccomp.ALLOW, name)
    for position, table in enumerate((_WITH_FIRST, _WITH_SECOND)):
        for name, values in table.items():
            for value in values:
                answer(seccomp.ALLOW, name, seccomp.Arg(position, seccomp.EQ, value))
    answer(seccomp.ALLOW, "tgkill", seccomp.Arg(0, seccomp.EQ, os.getpid()))  # for abort()
    thread = seccomp.Arg(0, seccomp.MASKED_EQ, _THREAD | _NOT_OF_A_THREAD, _THREAD)
    answer(seccomp.ALLOW, "clone", thread)
    answer(seccomp.ERRNO(errno.ENOSYS), "clone3")
    calls.load()


def _landlock() -> int:
    """Return the kernel's version of Landlock; below 1 if there is none."""
    return int(ctypes.CDLL(None).syscall(_CREATE_RULESET, None, 0, 1))


def _seccomp() -> Any:
    """Return the module pyseccomp, or None."""
    if platform.machine() not in _MACHINES:
        return None
    try:
        return import_module("pyseccomp")
    except (ImportError, RuntimeError):  # the package, or libseccomp, is not installed
        return None


def _call(name: str, *arguments: Any) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    answer = int(getattr(libc, name)(*arguments))
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return answer
