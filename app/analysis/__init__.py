"""Figures and curves from recordings."""
