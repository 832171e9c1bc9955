"""What tests of sweeps run; other processes find it as a module."""

import os
import time
from pathlib import Path


def add(a, b=0, seed=0):
    return {"sum": a + b + seed, "product": a * b}


def noting(a, notes, pause=0.0, seed=0):
    """Note that it was begun, and by whom, so that what is done twice shows."""
    with (Path(notes) / f"{a}-{seed}").open("a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(pause)
    return a * 2


def uneven(a):
    """Every fifth raises, one never ends, one eats memory, one ends its process, one prints, two stop in other ways."""
    if a % 5 == 4:
        raise ZeroDivisionError(f"a = {a}")
    if a == 1:
        time.sleep(1000)
    if a == 2:
        return len(bytearray(4 * 10**9))
    if a == 3:
        os.abort()
    if a == 5:
        print("of five")
    if a == 6:
        raise KeyboardInterrupt
    if a == 7:
        raise BaseException("enough")
    return a


def forking(a, notes):
    """Children that go on, that come back as if they were the run, one whose parent ends, and one of a long run."""
    if a in (1, 3, 5):
        if not os.fork():
            (Path(notes) / f"child-{a}").write_text(str(os.getpid()))
            time.sleep(1000)
        while not ((child := Path(notes) / f"child-{a}").exists() and child.read_text()):
            time.sleep(0.01)
        if a == 3:
            os.abort()
        time.sleep(1000 if a == 5 else 0)
    if a == 2 and not os.fork():
        raise RuntimeError("a child comes back")
    return a


def printing(a):
    for _ in range(1000):
        print("x" * 1_000_000)
    return a


def dying(a, notes):
    """End the process the first time."""
    noting(a, notes)
    if len((Path(notes) / f"{a}-0").read_text().split()) == 1:
        os.abort()
    return a
