"""Tuning: gains of a scenario that an optimiser chooses, judged on many true arms."""
