"""Gateway for several audiences: a server in front, and behind it one process per session, as in JupyterHub."""
