"""Log, launcher, files, folders and terminal text of the program's processes; nothing here is about robots."""
