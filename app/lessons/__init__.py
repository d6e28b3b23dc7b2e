"""Lessons: predict, run, see, explain; read from Markdown, played, scored and checked without a screen."""
