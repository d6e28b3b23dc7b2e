"""The `vsmrc` command: a file for each of its commands, their table in `commands.py`."""
