"""`python -m neuro` is the command `neuro`."""

import sys

from neuro.cli import main

sys.exit(main())
