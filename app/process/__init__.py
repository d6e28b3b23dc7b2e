"""What every process of ours needs and nothing of robots: log, launcher, files, folders, terminal text."""
