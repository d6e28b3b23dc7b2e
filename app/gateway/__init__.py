"""Several audiences: a server in front, and behind it one process per session, as JupyterHub does it."""
