"""`python -m neuro` is the command `neuro`."""

from neuro.cli import main

main()
