"""Session: one run that people look at, with its thread, commands, snapshots, past, previews and autosave; or a
headless run."""
