"""The command `neuro`."""

from __future__ import annotations

import gc
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit: 0 well, 1 a check failed, 2 a mistake of the user, 130 interrupted."""
    try:
        from neuro.cli.commands import app
        from neuro.cli.mistakes import telling

        with telling():
            status = app(prog_name="neuro", standalone_mode=False)
        sys.exit(status)
    except KeyboardInterrupt:  # while modules are imported
        sys.exit(130)
    finally:
        # The end of the process frees all memory. A last search for cycles takes 0.4 s where kernels were compiled.
        gc.freeze()
