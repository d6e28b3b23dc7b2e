"""A scenario as data: its schema, reading, writing and editing it, and what follows from it alone."""
