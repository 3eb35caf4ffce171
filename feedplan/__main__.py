"""``python -m feedplan``: the command without its script on the PATH."""

from feedplan.cli import main

main()
