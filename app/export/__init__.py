"""Export of files: figures, films, and the jobs that make them."""
