"""Log, launcher, files, folders and terminal text of our processes; nothing here is about robots."""
