"""One run that people look at: its thread, commands, snapshots, past, previews and autosave; or none at all."""
