"""Tuning: an optimiser searches for better gains of a scenario, judged on many true arms."""
