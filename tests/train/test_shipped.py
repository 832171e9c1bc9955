"""Every network that ships for `neuro train` learns by the command."""

import numpy as np
import pytest

import neuro as snn

pytest.importorskip("torch", reason="PyTorch is not installed")

SMALL = ("height=12", "width=12", "classes=3", "resolution=5", "in_std=0.3", "out_std=0.3")
NETWORKS = {
    "dense": (("hidden=10",), ()),
    "conv": (("maps=3", "kernel=3"), ()),
    "recurrent": (("hidden=10",), ()),
    "learnt_delays": (("hidden=10",), ("--learn", "in_hidden", "--learn", "hidden_out=weight,delay")),
}


def listed(values):
    """Values, also those of a file."""
    return getattr(values, "values", values)


@pytest.mark.parametrize("name", NETWORKS)
def test_it_learns_by_the_command(neuro, folder, name):
    values, words = NETWORKS[name]
    sets = [word for value in (*SMALL, *values) for word in ("--set", value)]
    status, out, err = neuro(
        name, "--data", folder, "--duration", 60, "--epochs", 15, "--batch", 6, "--rate", 0.03, *sets, *words,
        "--test", folder, "--backends", "event",
    )  # fmt: skip
    assert (status, err) == (0, "")
    rows = [line.split() for line in out.splitlines() if line.split()[:1] in (["torch"], ["event"])]
    assert len(rows) == 2
    for row in rows:
        assert float(row[1].rstrip("%")) >= 66.0
    assert "9 of 9" in out
    net = snn.load("trained.yaml")
    for part in net.projections.values():
        assert np.isfinite(listed(part.weight)).all()
    if name == "learnt_delays":
        assert len(np.unique(listed(net.projections["hidden_out"].delay))) > 3


def test_a_word_that_cannot_learn_is_told(neuro, folder, file):
    status, _, err = neuro(file, "--data", folder, "--learn", "hidden_out=weigt")
    assert (status, err.splitlines()[0]) == (
        2,
        "error: unknown word of projection 'hidden_out' that learns 'weigt'",
    )
