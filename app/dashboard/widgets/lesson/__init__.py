"""Widgets of a lesson: its steps, answers and charts, and the questions to a class."""
