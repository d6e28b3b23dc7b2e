"""Scenario as data: its schema, reading, writing and editing it, all that follows from it alone; a user's own code."""
