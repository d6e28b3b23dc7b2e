"""Scenario as data: its schema, reading, writing and editing it, and all that follows from it alone."""
