"""What tests of tuning run; other processes find it as a module."""

import os
import time
from pathlib import Path

import neuro


def bowl(x, y=0.0, seed=0):
    return {"loss": (x - 2.0) ** 2 + y**2 + seed, "cost": x + 1.0}


def noting(x, notes, pause=0.0):
    """Note that it was begun, and by whom, so that what is done twice shows."""
    with (Path(notes) / repr(x)).open("a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(pause)
    return x * x


def folded(x, fold, folds, seed=0):
    """What the held-out part is worth tells that it was seen."""
    if fold is None:
        return {"right": 100.0 + x}
    return {"right": x * (fold + 1) / folds + seed}


def uneven(x):
    if x == 1:
        raise ZeroDivisionError("x is one")
    if x == 2:
        return {"loss": float("nan")}
    if x == 3:
        return {"loss": "low"}
    if x == 4:
        os.abort()
    return {"loss": x}


def stepping(x, notes=""):
    """Gets nearer to x with each step; notes how many steps were made."""
    for step in range(10):
        neuro.report_step(x * (step + 1) / 10, step)
        if notes:
            (Path(notes) / repr(x)).write_text(str(step))
    return x


def listed(shape):
    return shape[0] * shape[1]


def lonely(x):
    return {"loss": x, "accuracy": 1.0}


def shifted(x, y, z, seed=0):
    return {"loss": (x - 2.0) ** 2 + y + z * seed, "cost": x + z}


def climbing(x, y, z):
    """Gets nearer to what it is worth with each step; how many there are depends on z."""
    for step in range(4 + int(z)):
        neuro.report_step((x - y + z) * (step + 1) / 6, step)
    return x - y + z
