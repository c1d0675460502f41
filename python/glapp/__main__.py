"""`python -m glapp` is the command line, where the folder of the `glapp` command is not on the path."""

from .cli import main

main()
