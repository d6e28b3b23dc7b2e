"""Files to take away: figures, films, and the jobs that make them."""
