"""Export of files: figures, playbacks, and the jobs that make them."""
