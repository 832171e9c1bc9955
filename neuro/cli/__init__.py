"""The command `neuro`."""

from __future__ import annotations

import gc
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its status: 0 success, 1 failed check, 2 user's error, 130 Ctrl-C."""
    try:
        from neuro.cli.commands import app
        from neuro.cli.mistakes import telling

        with telling():
            status = app(prog_name="neuro", standalone_mode=False)
        sys.exit(status)
    except KeyboardInterrupt:  # raised while modules are imported
        sys.exit(130)
    finally:
        # The process frees all memory as it ends. A last garbage collection takes 0.4 s after kernels were compiled.
        gc.freeze()
