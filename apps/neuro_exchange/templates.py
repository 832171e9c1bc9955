"""Templates: the files in `c_code/network` and `c_code/templates`, and `pynn/script.txt`."""

from __future__ import annotations

from importlib.resources import files


def filled(file: str, **values: object) -> str:
    """Return a file of this package with each placeholder replaced by its value, e.g. "@size@" by "10" for size=10."""
    text = files("neuro_exchange").joinpath(file).read_text("utf-8")
    for word, value in values.items():
        text = text.replace(f"@{word}@", str(value))
    return text
