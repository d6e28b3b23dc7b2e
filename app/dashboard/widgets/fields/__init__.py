"""Widgets that show and edit the fields of a scenario."""
