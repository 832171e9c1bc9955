"""Import of PyNN scripts by other authors: the scripts that become networks, and the errors of the others.

python benchmarks/pynn_scripts.py ../shared/reference/pynn [examples | spynnaker | scenarios]
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import neuro

SCENARIO = "import pyNN.nest as sim\nfrom scenarios.{module} import {name}\n{name}(sim)\n"


def scripts(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield names and paths of the scripts in a folder."""
    yield from ((path.stem, path) for path in sorted(folder.glob("*.py")))


def scenarios(folder: Path, work: Path) -> Iterator[tuple[str, Path]]:
    """Yield a script with pyNN.nest for each of PyNN's system scenarios."""
    shutil.copytree(folder, work / "scenarios")
    for path in sorted(folder.glob("test_*.py")):
        for names, name in re.findall(
            r"@run_with_simulators\((.*?)\)[^\n]*\ndef (\w+)\(sim\)", path.read_text("utf-8")
        ):
            if '"nest"' in names:
                script = work / f"{name}.py"
                script.write_text(SCENARIO.format(module=path.stem, name=name))
                yield f"{path.stem}.{name}", script


def verdict(script: Path) -> str:
    """Return a line about the network of a script, or about the error of the import."""
    try:
        return f"ok: {neuro.from_pynn(script, run_script=True)!r}"
    except neuro.ModelError as error:
        first = error.others[0] if error.others else error
        return first.alone()[:160]


def main(root: Path, kinds: list[str]) -> None:
    """Print a line for each script, and the number of imported scripts."""
    with tempfile.TemporaryDirectory() as work:
        for kind in kinds:
            found = scenarios(root / kind, Path(work)) if kind == "scenarios" else scripts(root / kind)
            verdicts = {name: verdict(path) for name, path in found}
            for name, said in verdicts.items():
                print(f"{name:45} {said}")
            print(f"{kind}: {sum(said.startswith('ok') for said in verdicts.values())} of {len(verdicts)}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or ["examples", "spynnaker", "scenarios"])
