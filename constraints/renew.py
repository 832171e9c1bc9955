"""Resolve requirements anew and write what pip would install here: `python constraints/renew.py REQUIREMENT ...`.

The file is that of the Python which runs this. Nothing is installed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

HEAD = """\
# What `make test` and `make demo` install with Python {version}, and what builds the package itself.
# Renewed by `make constraints PYTHON=python{version}`; not edited by hand.
"""


def resolved(requirements: list[str]) -> list[str]:
    """One pin a package, without the mark of a local build (`+cpu`), which other indexes do not have."""
    command = ["pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-", *requirements]
    report = subprocess.run([sys.executable, "-m", *command], check=True, stdout=subprocess.PIPE).stdout
    packages = (one["metadata"] for one in json.loads(report)["install"] if not one["is_direct"])
    return sorted(f"{one['name'].lower()}=={one['version'].partition('+')[0]}" for one in packages)


def main() -> None:
    """Write the file once all is resolved."""
    version = "{}.{}".format(*sys.version_info)
    pins = resolved(sys.argv[1:])
    file = Path(__file__).with_name(f"{version}.txt")
    file.write_text(HEAD.format(version=version) + "\n".join(pins) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
